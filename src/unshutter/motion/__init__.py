"""The camera's motion during the readout of a photo: its geometry, its effect on pixels, and how to undo it.

``Motion`` is the interface shared by all kinds of motion. ``RowMotion`` is the paper's model: t_x and r_z of every row
map positions by Eq. 1. Methods that return richer models have their own kinds with their own mappings:
``RotationMotion`` (rotations about three axes and a focal length).

All kinds are imported here so that motion files of every kind can be read wherever ``Motion`` is available; those of
another package are imported with the method that found the motion.
"""

from unshutter.motion.geometry import RowMotion
from unshutter.motion.motion import Motion
from unshutter.motion.rotation_motion import RotationMotion

__all__ = ["Motion", "RotationMotion", "RowMotion"]
