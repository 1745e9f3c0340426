"""Pictures with known motion, for training and measuring."""
