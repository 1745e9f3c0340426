"""The version, on its own so that the build can read it."""

__version__ = "1.1.0"
