"""Presents results as tables, plots and pictures."""
