"""The Kannala-Brandt model of lenses that bend straight lines (OpenCV's fisheye): directions, positions and back.

A direction at the angle theta from the viewing axis is seen at the distance

    r = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)

from the picture's middle, in focal lengths: OpenCV's fisheye model, which also describes a lens with moderate radial
distortion (:meth:`Lens.of_radial`). A lens that keeps lines straight, r = tan(theta), is None.

Source: OpenCV's documentation of the module fisheye (the model).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias, TypeVar

import numpy as np

from unshutter.errors import UnshutterError, visible
from unshutter.reasons import JsonObject

Angles = TypeVar("Angles", float, np.ndarray)  # from the axis [rad]
Vectors: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]

_ANGLES = np.linspace(0, np.pi, 1025)  # rad
_SMALL = 1e-9


@dataclass(frozen=True)
class Lens:
    """A lens. Its methods take and return positions in focal lengths from the picture's middle. NumPy only."""

    focal: float  # focal length [heights of the readout frame]
    k: tuple[float, ...]  # k1 to k4
    # of its axis from the picture's middle, to the right and down [focal lengths]
    shift: tuple[float, float] = (0.0, 0.0)
    source: str = ""  # where it was found
    error: float = 0.0  # standard deviation of a corner's distance from the middle, as a share of it; 0 if unknown

    def __post_init__(self) -> None:
        if (
            len(self.k) != 4
            or not np.isfinite([self.focal, *self.k, *self.shift]).all()
            or self.focal <= 0
            or self._limit < 0.1
        ):
            raise UnshutterError("the lens cannot be: its picture folds over itself")

    @classmethod
    def of_radial(
        cls, focal: float, k: Sequence[float], shift: tuple[float, float] = (0.0, 0.0), reach: float = 1.0
    ) -> Lens:
        """Returns the lens with radial distortion r = t (1 + k1 t^2 + k2 t^4 + k3 t^6), t = tan(theta) (Brown).

        Args:
            reach: largest distance from the axis that matters [focal lengths].
        """
        angles = _ANGLES[1:][_ANGLES[1:] <= np.radians(65)]  # beyond it, the model is not followed
        tan = np.tan(angles)
        seen = tan * (1 + sum(each * tan ** (2 * n + 2) for n, each in enumerate(k)))
        grows = np.append(True, np.diff(seen) > 0).cumprod().astype(bool) & (seen <= max(reach, seen[8]))
        angles = angles[grows]
        seen = seen[grows]
        powers = angles[:, None] ** np.array([3, 5, 7, 9])
        fitted = np.linalg.lstsq(powers, seen - angles, rcond=None)[0]
        return cls(focal, tuple(map(float, fitted)), shift)

    def degrees(self, aspect: float) -> float:
        """Returns the field of view from corner to corner of frames of this width per height [degrees]."""
        return 2 * float(np.degrees(self.angle(np.hypot(aspect, 1.0) / 2 / self.focal)))

    # ---- angle and distance ------------------------------------------------------------------------------

    def distance(self, angle: np.ndarray) -> np.ndarray:
        """Returns the distance from the axis [focal lengths] at which an angle from it [rad] is seen; any shape."""
        inside = np.minimum(angle, self._limit)
        return self._polynomial(inside) + self._slope(inside) * (angle - inside)

    def angle(self, distance: np.ndarray | float) -> np.ndarray:
        """Returns the angle [rad] seen at a distance; the inverse of :meth:`distance`, by Newton's method."""
        angle = np.asarray(np.interp(distance, self._distances, _ANGLES[: len(self._distances)]))
        for _ in range(2):
            angle = angle - (self._polynomial(angle) - distance) / self._slope(angle)
        last = self._distances[-1]
        beyond = self._limit + (distance - last) / self._slope(self._limit)
        return np.where(distance > last, beyond, angle)

    def _polynomial(self, angle: Angles) -> Angles:
        k1, k2, k3, k4 = self.k
        s = angle * angle
        return angle * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))

    def _slope(self, angle: Angles) -> Angles:
        k1, k2, k3, k4 = self.k
        s = angle * angle
        return 1 + s * (3 * k1 + s * (5 * k2 + s * (7 * k3 + s * 9 * k4)))

    @cached_property
    def _limit(self) -> float:
        """Largest angle at which the model describes a lens [rad]."""
        folded = np.flatnonzero(self._slope(_ANGLES) < 0.1)  # beyond, the model has left the lens, and r grows evenly
        return float(_ANGLES[max(folded[0] - 1, 0) if folded.size else -1])

    @cached_property
    def _distances(self) -> np.ndarray:
        return self._polynomial(_ANGLES[: np.searchsorted(_ANGLES, self._limit, "right")])

    # ---- positions and directions ------------------------------------------------------------------------

    def direction(self, x: np.ndarray, y: np.ndarray) -> Vectors:
        """Returns the unit vectors (right, down, forward) that are seen at positions."""
        x = x - self.shift[0]
        y = y - self.shift[1]
        distance = np.hypot(x, y)
        angle = self.angle(distance)
        scale = np.where(distance > _SMALL, np.sin(angle) / np.maximum(distance, _SMALL), 1.0)
        return x * scale, y * scale, np.cos(angle)

    def position(self, x: np.ndarray, y: np.ndarray, z: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Returns the positions at which directions, of any length, are seen."""
        _, across, _ = self._of_direction(x, y, z)
        return x * across + self.shift[0], y * across + self.shift[1]

    def slopes(self, x: np.ndarray, y: np.ndarray, z: np.ndarray | float) -> tuple[Vectors, Vectors]:
        """Returns how the columns and the rows of positions change with the three parts of unit vectors."""
        side, across, angle = self._of_direction(x, y, z)
        outward = self._slope(np.minimum(angle, self._limit))
        u, v = (np.where(side > _SMALL, each / np.maximum(side, _SMALL), 0.0) for each in (x, y))
        more = outward * z - across
        return (
            (across + u * u * more, u * v * more, -x * outward),
            (u * v * more, across + v * v * more, -y * outward),
        )

    def _of_direction(self, x: np.ndarray, y: np.ndarray, z: np.ndarray | float) -> Vectors:
        """Returns a direction's part across the axis, its distance in the picture per that part, and its angle."""
        side = np.hypot(x, y)
        angle = np.arctan2(side, z)
        across = np.where(side > _SMALL, self.distance(angle) / np.maximum(side, _SMALL), 1.0)
        return side, across, angle

    def as_json(self) -> JsonObject:
        """Returns the lens for motion files and logs."""
        numbers = {"focal_heights": self.focal, "fisheye_k": list(self.k), "axis_shift": list(self.shift)}
        return {**numbers, "source": self.source, "error": self.error}

    @classmethod
    def of_json(cls, data: JsonObject) -> Lens:
        """Reads what :meth:`as_json` wrote; raises KeyError, TypeError or ValueError if it is something else."""
        right, down = map(float, data["axis_shift"])
        return cls(
            focal=float(data["focal_heights"]),
            k=tuple(map(float, data["fisheye_k"])),
            shift=(right, down),
            source=visible(str(data.get("source", ""))),
            error=float(data.get("error", 0.0)),
        )
