"""Rectifies photos, alone or with the help of their neighbours in time."""
