"""The small transformer that estimates row motion from line segments, in NumPy: features, network, weights file."""
