"""Measured in a clip before rendering: lens, readout time, camera path, and what undoing that path gains."""
