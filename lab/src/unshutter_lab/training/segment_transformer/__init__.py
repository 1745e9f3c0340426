"""The network of segment-transformer and its training."""
