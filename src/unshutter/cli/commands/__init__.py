"""The commands of ``unshutter``; ``COMMANDS`` in the package above says where each is."""
