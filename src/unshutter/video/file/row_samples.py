"""The motion of a frame as it is stored, in memory and in files: the rotation of every fourth row, rounded.

Every motion of a frame is interpolated from it (:func:`as_kept`): so a saved one gives the same pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from unshutter.frames.frame_motion import Step
from unshutter.motion import RotationMotion
from unshutter.motion.finding import Finding
from unshutter.motion.lens import Lens
from unshutter.motion.shapes import Float64
from unshutter.orientation import ScanDirection

ROWS = 65  # of the small pictures to which the motions of clips refer
GYRO_ROWS = 257  # if a gyro recorded the camera's vibration
STRIDE = 4  # rows
_DECIMALS = 9
_PARALLAX_DECIMALS = 6  # of a height: 0.002 px of 2160 rows


@dataclass(frozen=True, eq=False)
class RowSamples:
    """The motion of a small picture, first row as the reference."""

    rotations: Float64[np.ndarray, "samples 3"]  # of every fourth row, zero at the first [rad]
    focal_heights: float  # focal length [heights of the readout frame]
    width: int  # of the small picture [px]
    scan_direction: ScanDirection
    # displacement of the grid's nodes by depth (motion/parallax_field.py) [heights]; None: the camera only rotates
    parallax: Float64[np.ndarray, "nodes 2"] | None = None

    @classmethod
    def of(cls, motion: RotationMotion) -> RowSamples:
        """Returns the samples of a motion."""
        rotations = motion.rotations[::STRIDE]
        focal_heights = round(motion.focal_px / motion.height, _DECIMALS)
        parallax = None if motion.parallax is None else np.round(motion.parallax / motion.height, _PARALLAX_DECIMALS)
        return cls(_rounded(rotations - rotations[0]), focal_heights, motion.width, motion.scan_direction, parallax)

    def motion(self, lens: Lens | None) -> RotationMotion:
        """Returns the motion of all rows."""
        first, weights = _between(len(self.rotations))
        rotations = np.zeros((len(first), 3))
        for number, weight in enumerate(weights):  # BLAS would round by where an array lies in memory
            rotations += weight[:, None] * self.rotations[first + number]
        focal_px = self.focal_heights * len(rotations)
        parallax = None if self.parallax is None else self.parallax * len(rotations)
        camera = focal_px, lens, parallax
        return RotationMotion(self.width, rotations - rotations[0], *camera, scan_direction=self.scan_direction)


def as_kept(found: Finding, lens: Lens | None) -> Finding:
    """Returns a small picture's motion as precisely as a file would store it."""
    motion = found.motion
    return replace(found, motion=RowSamples.of(motion).motion(lens)) if isinstance(motion, RotationMotion) else found


def step_as_kept(step: Step | None) -> Step | None:
    """Returns the rotation since the previous frame as precisely as a file would store it."""
    return None if step is None else replace(step, rotation=_rounded(step.rotation))


def _rounded(rotations: np.ndarray) -> np.ndarray:
    return np.round(rotations, _DECIMALS)


@cache
def _between(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """For cubics through four samples, by row: the first of them, and their weights [4, rows]."""
    at = np.arange((samples - 1) * STRIDE + 1) / STRIDE
    first = np.clip(np.floor(at).astype(int) - 1, 0, samples - 4)
    weights = np.ones((4, len(at)))
    for j in range(4):
        for k in set(range(4)) - {j}:
            weights[j] *= (at - first - k) / (j - k)
    return first, weights
