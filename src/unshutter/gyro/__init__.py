"""Gyro logs: read, aligned with a clip's picture, and turned into the rotation of every row."""
