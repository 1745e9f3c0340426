"""Evidence that right angles in the scene give about a motion: the Manhattan likelihood, its prior, and the search."""
