"""The ten unknowns of a photo: how it moved, and how its camera looked at streets and houses.

Hypotheses are rows of an array [S, 10]: coefficients of u, u^2, u^3 of t_x [rows] and of r_z [rad], with u = row
coordinate + 1/2; the camera's roll and tilt [rad]; the logarithm of its focal length [rows]; its yaw against the
streets [rad]. Coordinates are centred, in rows (lines/segments.py).
"""

UNKNOWNS = 10
MOTION, ROLL, TILT, LOG_FOCAL, YAW = slice(0, 6), 6, 7, 8, 9
CAMERA = slice(MOTION.stop, UNKNOWNS)
