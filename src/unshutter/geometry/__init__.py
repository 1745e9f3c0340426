"""The geometry of a rolling shutter: rows, rotations, the direction of the readout."""
