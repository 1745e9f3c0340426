"""Applies motions to pixels."""
