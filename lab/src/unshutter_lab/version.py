"""The version, in its own file so that the build can read it."""

__version__ = "1.1.0"
