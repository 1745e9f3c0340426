"""Writes files and objects atomically, and never over an original."""
