"""File structures that several formats share."""
