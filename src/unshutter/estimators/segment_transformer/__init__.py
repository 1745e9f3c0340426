"""The small transformer that turns line segments into a row motion, in NumPy: features, network, file of weights."""
