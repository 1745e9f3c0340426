"""Pictures with known motion, made from undistorted photos for training and measuring."""
