"""Calibrates the default method: the network's errors, the prior of motions, and the confidence."""
