"""The geometry of a rolling shutter: rows, rotations and the readout direction."""
