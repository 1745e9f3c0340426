"""Renders photos of places by a camera that moves during readout: exact motion, blur and noise."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from unshutter.motion import Motion, RotationMotion, RowMotion
from unshutter.motion.rotations import rotation_vector
from unshutter.motion.shapes import Float64, UInt8
from unshutter_lab.synthesis.panorama import Camera, Place, paper_matrices
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import draw_quadratic, encoded_light, linear_light

_CANVAS = 356 / 256  # ratio of canvas rows to kept rows in the predecessor's generator
_STEP_PX = 0.75  # largest step between two moments of an exposure
_MOST_MOMENTS = 33


class Moving(ABC):
    """The motion of a camera during readout, relative to its attitude at the first row."""

    @abstractmethod
    def matrices(self, rows: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3 3"]:
        """Returns the row matrices at rows, which may be fractions, and lie before the first or after the last."""

    @abstractmethod
    def motion(self) -> Motion:
        """Returns the motion of the picture, with the first row as the reference."""


@dataclass(frozen=True)
class Rotating(Moving):
    """A camera that rotates as recorded in a log; its first row is read at the log's time 0."""

    camera: Camera
    log: RotationLog
    readout_s: float  # time from the first row to that after the last

    def matrices(self, rows: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3 3"]:
        """See :class:`Moving`."""
        return self._rotations(rows).transpose(0, 2, 1)

    def motion(self) -> RotationMotion:
        """See :class:`Moving`."""
        vectors = rotation_vector(self._rotations(np.arange(self.camera.height)))
        vectors[0] = 0.0
        camera = {"width": self.camera.width, "focal_px": self.camera.focal_px}
        return RotationMotion(rotations=vectors, **camera)

    def _rotations(self, rows: np.ndarray) -> np.ndarray:
        times = np.append(rows, 0.0) * (self.readout_s / self.camera.height)
        rotations = self.log.rotations(times)
        return rotations[:-1] @ rotations[-1].T


@dataclass(frozen=True)
class Quadratic(Moving):
    """The paper's motion, as drawn by Rengarajan et al. 2017."""

    camera: Camera
    coefficients: tuple[tuple[float, float], tuple[float, float]]  # of u and u^2: t_x [px], r_z [rad]; u = row / rows

    @classmethod
    def drawn(cls, rng: np.random.Generator, camera: Camera) -> Quadratic:
        """Draws a motion for the rows of a camera."""
        rows = camera.height
        crop = draw_quadratic(rng, rows, rows + 2 * round((_CANVAS - 1) * rows / 2)).crop
        u = np.arange(rows) / rows
        values = np.stack([crop.tx_px, crop.rz_rad], -1)
        linear, square = np.linalg.lstsq(np.stack([u, u**2], -1), values, rcond=None)[0]
        return cls(camera, ((linear[0], square[0]), (linear[1], square[1])))

    def matrices(self, rows: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3 3"]:
        """See :class:`Moving`."""
        return paper_matrices(*self._values(rows), self.camera.focal_px)

    def motion(self) -> RowMotion:
        """See :class:`Moving`."""
        return RowMotion(self.camera.width, *self._values(np.arange(self.camera.height)))

    def _values(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u = rows / self.camera.height
        tx, rz = (linear * u + square * u**2 for linear, square in self.coefficients)
        return tx, rz


def take_photo(
    place: Place, camera: Camera, moving: Moving | None, exposed_rows: float = 0.0
) -> UInt8[np.ndarray, "height width 3"]:
    """Returns a photo, RGB.

    Args:
        place: what is photographed.
        camera: the camera when its first row is read.
        moving: its motion; None if it stands still.
        exposed_rows: how many rows are read during the exposure of one, which shows the mean of its own time.
    """
    rows = np.arange(camera.height, dtype=np.float64)
    if moving is None or not exposed_rows:
        return place.seen(camera, None if moving is None else moving.matrices(rows))
    moments = [place.seen(camera, moving.matrices(rows + at)) for at in _moments(camera, moving, exposed_rows)]
    linear, _ = linear_light(moments[0].dtype)
    light = sum((linear[moment] for moment in moments), np.zeros(moments[0].shape, np.float32))
    return encoded_light(light / len(moments), moments[0].dtype)


def _moments(camera: Camera, moving: Moving, exposed_rows: float) -> np.ndarray:
    """Returns the moments of an exposure, in rows from its middle, so close that nothing moves far between two."""
    rows = np.linspace(0, camera.height, 33)
    before, after = (moving.matrices(rows + end) for end in (-exposed_rows / 2, exposed_rows / 2))
    corners = np.array([[x * camera.width, y * camera.height, 2 * camera.focal_px] for x in (-1, 1) for y in (-1, 1)])
    moved = np.linalg.norm((after - before) @ (corners.T / 2), axis=1).max()
    count = int(np.clip(math.ceil(moved / _STEP_PX), 1, _MOST_MOMENTS))
    return ((np.arange(count) + 0.5) / count - 0.5) * exposed_rows


def with_noise(
    picture: UInt8[np.ndarray, "height width 3"], deviation: float, rng: np.random.Generator
) -> UInt8[np.ndarray, "height width 3"]:
    """Adds normal noise [levels of 255] to every value."""
    noisy = picture + rng.normal(0, deviation, picture.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
