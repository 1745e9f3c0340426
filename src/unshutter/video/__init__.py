"""Clips: decoded, each frame's motion undone, encoded; all else in their files stays as it is."""
