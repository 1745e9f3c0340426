"""Measures the default method's calibration: the network's errors, the odds of motion, and the confidence."""
