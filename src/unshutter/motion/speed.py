"""Camera speed per second, from a motion's rates per row and a known readout time."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion.motion import Motion

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64


@dataclass(frozen=True, eq=False)
class Speed:
    """Speed of the scene in the picture at the time of each row; readout frame, signs as in Motion.

    Attributes:
        readout_ms: time from the first to the last row [ms].
        angular_deg_s: [H] angular rate about the viewing axis, positive clockwise as seen in the picture [deg/s].
        velocity_px_s: [H, 2], (col, row) of the scene in the middle of the picture [px/s].
    """

    readout_ms: float
    angular_deg_s: Float64[np.ndarray, "rows"]
    velocity_px_s: Float64[np.ndarray, "rows 2"]

    @classmethod
    def of(cls, motion: Motion, readout_ms: float) -> Speed:
        """Returns the speed of a motion; independent of its reference row.

        Raises:
            UsageError: the readout time is not positive.
            UnshutterError: the motion has fewer than two rows.
        """
        check_readout_ms(readout_ms)
        if motion.height < 2:
            raise UnshutterError("a speed needs a motion of at least two rows")
        turning, velocity = motion.rates()
        per_second = 1000 * (motion.height - 1) / readout_ms  # rows
        return cls(readout_ms, np.degrees(turning) * per_second, velocity * per_second)

    def summary(self) -> dict:
        """Returns mean and peak, ready for JSON; all signed except the peak velocity, which is a magnitude."""
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
    """Raises UsageError if this is not a valid readout time.

    Examples:
        >>> check_readout_ms(-1)
        Traceback (most recent call last):
        unshutter.errors.UsageError: the readout must take a positive time, got -1 ms
    """
    if not (math.isfinite(readout_ms) and readout_ms > 0):
        raise UsageError(f"the readout must take a positive time, got {readout_ms:g} ms")


def json_with_speed(motion: Motion, readout_ms: float) -> str:
    """Returns the motion as JSON text with an added ``speed`` key; :meth:`Motion.from_json` accepts it.

    Examples:
        >>> motion = unshutter.RowMotion.from_polynomials([0, 60], [0], height=480, width=640)
        >>> round(json.loads(json_with_speed(motion, readout_ms=30))["speed"]["velocity_px_s"]["peak"])
        2000
    """
    return json.dumps(json.loads(motion.to_json()) | {"speed": Speed.of(motion, readout_ms).summary()})
