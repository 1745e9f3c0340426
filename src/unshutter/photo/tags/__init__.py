"""Metadata, one file per standard: read, and kept true when the pixels change."""
