"""How the camera moved while the rows of one photo were read out.

``Motion`` holds t_x and r_z of every row and maps positions by the paper's Eq. 1. Methods that answer with more than
that have a kind of their own, which maps positions by what they say: ``RowMapMotion`` (the paper's row block),
``RotationMotion`` (rotations about three axes and a focal length).
"""

from unshutter.motion.motion import Motion, Reference
from unshutter.motion.rotation_motion import RotationMotion
from unshutter.motion.row_map_motion import RowMapMotion

__all__ = ["Motion", "Reference", "RotationMotion", "RowMapMotion"]
