"""Reads and writes photos: pixels and metadata."""

from unshutter.photo.photo import Photo

__all__ = ["Photo"]
