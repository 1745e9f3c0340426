"""Training data: drawn scenes of line segments, and photos distorted by random motions."""
