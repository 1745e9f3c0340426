"""How the camera moved while the rows of one photo were read out.

``Motion`` is what all kinds of motion have in common, ``RowMotion`` the paper's: t_x and r_z of every row map positions
by Eq. 1. Methods that answer with more than that have a kind of their own, which maps positions by what they say:
``RowMapMotion`` (the paper's row block), ``RotationMotion`` (rotations about three axes and a focal length).
All kinds are imported here, so that motion files of every kind can be read wherever ``Motion`` is known.
"""

from unshutter.motion.motion import Motion
from unshutter.motion.rotation_motion import RotationMotion
from unshutter.motion.row_map import RowMap
from unshutter.motion.row_map_motion import RowMapMotion
from unshutter.motion.row_motion import RowMotion

__all__ = ["Motion", "RotationMotion", "RowMap", "RowMapMotion", "RowMotion"]
