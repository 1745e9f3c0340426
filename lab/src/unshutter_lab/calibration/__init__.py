"""The default method's calibration, measured: the network's errors, the odds of motion, the confidence."""
