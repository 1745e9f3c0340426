"""Evidence about the motion from right angles in the scene: the Manhattan likelihood, its prior, and the search."""
