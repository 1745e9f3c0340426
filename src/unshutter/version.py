"""The version, written once (pyproject.toml reads it here)."""

__version__ = "1.1.0"
