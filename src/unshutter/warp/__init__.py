"""A motion applied to pixels."""
