"""The addresses: each function answers one, and says which in its first words. No module here imports another."""
