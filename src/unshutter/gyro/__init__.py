"""Gyro logs: reads them, aligns them with a clip's picture, and computes the rotation of every row."""
