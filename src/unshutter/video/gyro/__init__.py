"""Gyro logs: read, and synchronised with the frames."""
