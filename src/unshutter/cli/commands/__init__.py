"""The commands, one file each; ``COMMAND`` in NAME.py is ``unshutter NAME``."""
