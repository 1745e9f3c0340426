"""What networks learn from: drawn scenes of line segments, and photos distorted by random motions."""
