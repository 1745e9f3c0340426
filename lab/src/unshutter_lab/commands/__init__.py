"""The commands that the lab adds to ``unshutter``, one file each."""
