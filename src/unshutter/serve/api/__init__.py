"""Request handlers, one per address; each docstring starts with the address. No module here imports another."""
