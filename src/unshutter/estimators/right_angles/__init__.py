"""What right angles say about a motion."""
