"""Metadata, with one file per standard: reading them, and updating them when the pixels change."""
