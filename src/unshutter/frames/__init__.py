"""Estimates motion from several frames of one camera, using information that a single photo lacks."""
