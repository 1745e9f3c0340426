"""What right angles in the scene say about a motion: the Manhattan likelihood, its prior, and the search over both."""
