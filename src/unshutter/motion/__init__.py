"""Camera motion during the readout of a single photo.

``Motion`` is the interface shared by all kinds of motion. ``RowMotion`` is the paper's model: t_x and r_z of every row
map positions by Eq. 1. Methods that return richer models have their own kinds with their own mappings: ``RowMapMotion``
(the paper's row block) and ``RotationMotion`` (rotations about three axes and a focal length).

All kinds are imported here so that motion files of every kind can be read wherever ``Motion`` is available.
"""

from unshutter.motion.motion import Motion
from unshutter.motion.rotation_motion import RotationMotion
from unshutter.motion.row_map import RowMap
from unshutter.motion.row_map_motion import RowMapMotion
from unshutter.motion.row_motion import RowMotion

__all__ = ["Motion", "RotationMotion", "RowMap", "RowMapMotion", "RowMotion"]
