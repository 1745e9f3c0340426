"""The commands of ``unshutter``; ``COMMANDS`` in the parent package lists where each is defined."""
