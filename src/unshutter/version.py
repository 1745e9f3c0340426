"""The version number, defined only here (pyproject.toml reads it)."""

__version__ = "1.1.0"
