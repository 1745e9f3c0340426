"""How fast the camera moved, once the time of the readout is known.

A motion of camera rotations says it itself. Of any other, which moves and turns the picture in its plane, it is worked
out from where it maps positions: with F(x, v) the GS position of RS column x, row v, the slope of F along a row says
how far the picture was turned at that moment, and its slope over the rows, turned into the RS picture, falls short of
one row by what the scene moved meanwhile.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.geometry.rotations import rotation_matrix
from unshutter.motion import Motion, RotationMotion


@dataclass(frozen=True, eq=False)
class Speed:
    """Speed of the scene in the picture at the moment of each row; readout frame, signs as those of a Motion.

    Attributes:
        readout_ms: time from the first to the last row [ms].
        angular_deg_s: [H], about the viewing axis, positive clockwise as seen in the picture [deg/s].
        velocity_px_s: [H, 2], (col, row) of the scene in the middle of the picture [px/s].
    """

    readout_ms: float
    angular_deg_s: np.ndarray
    velocity_px_s: np.ndarray

    @classmethod
    def of(cls, motion: Motion, readout_ms: float) -> Speed:
        """The speed of a motion; the same whatever its reference row.

        Raises:
            UsageError: a time that is not positive; UnshutterError: a motion of fewer than two rows.
        """
        check_readout_ms(readout_ms)
        if motion.height < 2:
            raise UnshutterError("a speed needs a motion of at least two rows")
        turning, velocity = _of_rotations(motion) if isinstance(motion, RotationMotion) else _of_positions(motion)
        per_second = 1000 * (motion.height - 1) / readout_ms  # rows
        return cls(readout_ms, np.degrees(turning) * per_second, velocity * per_second)

    def summary(self) -> dict:
        """Mean and peak for people and JSON: signed, but for the peak of the velocity, which is its magnitude."""
        peak = self.angular_deg_s[np.abs(self.angular_deg_s).argmax()]
        return {
            "readout_ms": self.readout_ms,
            "angular_deg_s": {"mean": float(self.angular_deg_s.mean()), "peak": float(peak)},
            "velocity_px_s": {
                "mean": self.velocity_px_s.mean(axis=0).tolist(),
                "peak": float(np.hypot(*self.velocity_px_s.T).max()),
            },
        }


def check_readout_ms(readout_ms: float) -> None:
    """Raises UsageError where this cannot be the time of a readout."""
    if not (math.isfinite(readout_ms) and readout_ms > 0):
        raise UsageError(f"the readout must take a positive time, got {readout_ms:g} ms")


def json_with_speed(motion: Motion, readout_ms: float) -> str:
    """The motion's file form with the key ``speed`` added; :meth:`Motion.from_json` reads it, too."""
    return json.dumps(json.loads(motion.to_json()) | {"speed": Speed.of(motion, readout_ms).summary()})


def _of_positions(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Turning [H] [rad] and velocity [H, 2] [px] of the picture's middle, per row."""
    rows = np.arange(motion.height, dtype=np.float64)
    middle_col, middle_row = (motion.width - 1) / 2, (motion.height - 1) / 2
    col, row = motion.rs_to_gs(middle_col + np.array([[-0.5], [0.0], [0.5]]), rows[None])  # [3, H]
    angle = -np.unwrap(np.arctan2(row[2] - row[0], col[2] - col[0]))
    cos, sin = np.cos(angle), np.sin(angle)
    slope_col, slope_row, turning = (_slope(values) for values in (col[1], row[1], angle))
    # on the row itself, less what the rotation about the middle does there
    across = -(slope_col * cos - slope_row * sin) + turning * (rows - middle_row)
    along = 1 - (slope_col * sin + slope_row * cos)
    return turning, np.stack([across, along], axis=-1)


def _of_rotations(motion: RotationMotion) -> tuple[np.ndarray, np.ndarray]:
    """The same of a camera that turns: the middle's ray (0, 0, 1) moves by the rates (w_x, w_y, w_z) x (0, 0, 1)."""
    rotation = rotation_matrix(motion.rotations)  # [H, 3, 3]
    rates = _slope(rotation) @ rotation.transpose(0, 2, 1)
    wx, wy, wz = rates[:, 2, 1], rates[:, 0, 2], rates[:, 1, 0]
    return wz, motion.focal_px * np.stack([wy, -wx], axis=-1)


def _slope(values: np.ndarray) -> np.ndarray:
    """Change per row of values [H, ...]."""
    return np.gradient(values, axis=0, edge_order=2 if len(values) > 2 else 1)
