"""Clips: decoded, each frame's motion undone, encoded; all else in their files is kept."""
