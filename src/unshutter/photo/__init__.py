"""Pixels and metadata in and out."""

from unshutter.photo.photo import Photo

__all__ = ["Photo"]
