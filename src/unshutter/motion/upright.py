"""Turning a picture upright once its motion is undone: level, or with parallel verticals as well.

A camera that turns about its centre moves the picture by a homography K R K^-1. Tilted upwards and rolled clockwise, it
sees the scene's axes (right, down, ahead) through R = R_z(-roll) R_x(tilt), as in single/likelihood.py. The upright
picture is what it would have seen without R. The picture's centre and the width there are unchanged, unless a tilt is
undone: then the picture is moved along the scene's vertical, and made smaller if necessary, to show all that the camera
saw above and below its centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.shapes import ArrayLike, Float64, Numbers
from unshutter.options import Upright
from unshutter.reasons import Code, Reason

_MOST_ROLL_DEG, _MOST_TILT_DEG = 8.0, 25.0  # more is meant, or a mistake: undone only if the user states it
_SIDES = ((0, -1), (1, 0), (0, 1), (-1, 0))


@dataclass(frozen=True)
class Angle:
    """An angle of the camera's attitude (:class:`~unshutter.options.Camera`)."""

    deg: float  # [degrees]
    stated: bool = False  # whether the user stated it; otherwise it was measured
    error_deg: float | None = None  # standard deviation [degrees]; None: unknown


@dataclass(frozen=True)
class Pose:
    """How the camera was held when the reference row was read, and its focal length."""

    roll_deg: float  # clockwise from upright [degrees]
    tilt_deg: float | None  # upwards [degrees]; None: unknown, or not to be undone
    focal: float  # focal length, in rows of the readout frame
    up: tuple[int, int] = (0, -1)  # unit vector (right, down) in the readout frame to the top of the scene
    roll_error_deg: float | None = None  # standard deviation of a roll that was measured [degrees]; None: unknown

    def __post_init__(self) -> None:
        object.__setattr__(self, "up", tuple(self.up))  # a list in a motion file
        angles = self.roll_deg, self.tilt_deg or 0.0
        if self.up not in _SIDES or not (max(map(abs, angles)) <= 360 and 1e-3 <= self.focal <= 1e9):
            raise UnshutterError(f"no camera was held like this: {self}")

    def rolled(self, clockwise_rad: float) -> Pose:
        """Returns the pose of a camera that sees the scene turned clockwise by this angle [rad]."""
        return replace(self, roll_deg=self.roll_deg - math.degrees(clockwise_rad))

    def undone_for(self, wish: Upright, roll: Angle | None, tilt: Angle | None) -> Pose | Reason:
        """Returns the part of the pose to undo, or why not.

        Args:
            roll, tilt: what is known of the camera apart from the photo's pixels.
        """
        upwards = 0.0 if wish == "level" else self.tilt_deg
        if upwards is None:
            return Reason(Code.POSE_UNKNOWN)
        if abs(self.roll_deg) > _MOST_ROLL_DEG and not (roll and roll.stated):
            return Reason.of(Code.TOO_ASKEW, deg=round(abs(self.roll_deg), 1))
        if abs(upwards) > (89 if tilt and tilt.stated else _MOST_TILT_DEG):  # straight up or down, nothing is upright
            return Reason.of(Code.TOO_STEEP, deg=round(abs(upwards), 1))
        return self if wish == "full" else replace(self, tilt_deg=None)

    def described(self) -> str:
        """Describes what was undone: ``levelled by 2.3 degrees``."""
        if self.tilt_deg is None:
            return f"levelled by {abs(self.roll_deg):.1f} degrees"
        return f"made upright: turned by {abs(self.roll_deg):.1f} degrees, tilted by {abs(self.tilt_deg):.1f}"

    # ---- mapping ---------------------------------------------------------------------------------------

    def leaning(
        self, col: ArrayLike, row: ArrayLike, height: int, width: int, back: bool = False
    ) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps positions [px] of the upright picture to the one that this camera took; with ``back``, the reverse.

        Both are readout frames of height x width. Positions that the camera had behind it become NaN.
        """
        matrix = self._placed(width / height)
        matrix = np.linalg.inv(matrix) if back else matrix
        x = (np.asarray(col, float) - (width - 1) / 2) / height
        y = (np.asarray(row, float) - (height - 1) / 2) / height
        x, y, z = (m[0] * x + m[1] * y + m[2] for m in matrix)
        z = np.where(z > 0, z, np.nan)
        return height * x / z + (width - 1) / 2, height * y / z + (height - 1) / 2

    def largest_px(self, height: int, width: int) -> float:
        """Largest displacement [px] of a corner of a picture of height x width."""
        col = np.array([0.0, width - 1.0] * 2)
        row = np.array([0.0] * 2 + [height - 1.0] * 2)
        there = self.leaning(col, row, height, width)
        return float(np.nan_to_num(np.hypot(there[0] - col, there[1] - row), nan=np.inf).max())

    def _placed(self, aspect: float) -> np.ndarray:
        """[3, 3] as :attr:`_centred`, placed to show the most of the scene; ``aspect``: width / height of the frame."""
        matrix = self._centred
        if not self.tilt_deg:
            return matrix
        # t rows from the centre towards the top of the scene, the camera saw what is at t along / (depth + t slope)
        up = np.array(self.up)
        *along, slope = matrix[:, :2] @ up
        depth = matrix[2, 2]
        half = np.array([aspect, 1.0]) / 2
        border = (half / np.maximum(np.abs(along), 1e-9)).min()
        length = float(half @ np.abs(up))
        ends = [border * depth / max(1 - side * border * slope, 1e-9) for side in (1, -1)]
        top, bottom = (min(end, 2 * length) for end in ends)
        smaller = max((top + bottom) / (2 * length), 1.0)
        placed = np.diag([smaller, smaller, 1.0])
        placed[:2, 2] = up * (top - bottom) / 2
        return matrix @ placed

    @property
    def _centred(self) -> np.ndarray:
        """[3, 3] from the upright picture to the leaning one, with the same centre; centred positions, in rows."""
        turn = math.atan2(self.up[0], -self.up[1])
        tilt = math.radians(self.tilt_deg or 0.0)
        cos = math.cos(tilt)
        sin = math.sin(tilt)
        lifted = np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])
        rotation = _about_axis(turn - math.radians(self.roll_deg)) @ lifted @ _about_axis(-turn)
        placed = np.diag([1 / cos, 1 / cos, 1.0])  # or it would be wider by 1 / cos
        placed[:2, 2] = rotation[2, :2] / rotation[2, 2]  # and its centre elsewhere
        lens = np.array([self.focal, self.focal, 1.0])
        return lens[:, None] * (rotation @ placed) / lens


def _about_axis(angle: float) -> np.ndarray:
    """[3, 3] clockwise rotation about the viewing axis [rad]."""
    cos = math.cos(angle)
    sin = math.sin(angle)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
