"""A folder of files, and one of objects in memory."""

from support.stores import folder, memory

__all__ = ["folder", "memory"]
