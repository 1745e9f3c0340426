"""Synthesises pictures with known motion from undistorted photos, for training and evaluation."""
