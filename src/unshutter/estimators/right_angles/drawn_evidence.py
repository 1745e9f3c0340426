"""Evidence of drawn lines about motion and camera: energies added to that of the Manhattan likelihood.

An upright line points to the vertical vanishing point, a level one to some horizontal direction of the scene, receding
or not, and a straight one has no known direction but no bend either. People usually draw level lines along surfaces
that face them, so these lines reveal the camera's roll; the slope of a receding line depends on things that a single
line does not show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

import numpy as np

from unshutter.estimators.right_angles.beliefs import MOTION, ROLL, UNKNOWNS
from unshutter.estimators.right_angles.prior import two_gaussians
from unshutter.estimators.right_angles.residuals import AngleResiduals, EndPoints

# Measured on a separate set of photos (val/), as docs/guide/by-hand.md shows.
_SIGMA_ANGLE = 0.0025  # of a drawn direction [rad],
_SIGMA_END = 0.001  # of its ends [rows],
_SIGMA_BEND = 0.002  # and of the points of a straight line [rows]
_FACING = 0.6  # share of level lines on surfaces that face the camera,
_SIGMA_FACING, _SIGMA_RECEDING = math.radians(1), math.radians(12)  # and slopes of these and of other lines
_OTHER_STREET = 0.05  # share of level lines along neither of the two horizontal directions
_LEAST_LENGTH = 0.01  # of a piece of a line [rows]: shorter ones have no usable direction
_STEP = 1e-6  # of numerical derivatives

Expansion: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]  # energy [S], gradient [S, 10], Hessian [S, 10, 10]


class Evidence(Protocol):
    """The evidence of a set of lines."""

    def expanded(self, unknowns: np.ndarray) -> Expansion:
        """Returns the energy of unknowns [S, 10] to second order."""
        ...


class Pieces:
    """Pieces of lines with a known direction.

    Args:
        lines: points [N, 2] of each, centred, in rows.
        turn: roll [rad] of a camera held upright.
        vertical: whether they are upright; otherwise they run along one of the two horizontal directions.
    """

    def __init__(self, lines: Sequence[np.ndarray], turn: float, vertical: bool):
        self._turn = turn
        begin = np.concatenate([np.zeros((0, 2)), *(points[:-1] for points in lines)])
        end = np.concatenate([np.zeros((0, 2)), *(points[1:] for points in lines)])
        length = np.hypot(*(end - begin).T)
        kept = length > _LEAST_LENGTH
        self._ends = EndPoints(begin[kept]), EndPoints(end[kept])
        sigma = np.hypot(_SIGMA_ANGLE, _SIGMA_END / length[kept])
        self._precision = 1 / sigma**2
        self._points_of = slice(0, 1) if vertical else slice(1, 3)
        share = 1.0 if vertical else (1 - _OTHER_STREET) / 2
        self._peak = share / (sigma * math.sqrt(2 * math.pi))
        self._anywhere = 0.0 if vertical else _OTHER_STREET / math.pi

    def expanded(self, unknowns: np.ndarray) -> Expansion:
        """Expands the energy of the pieces' angles to the vanishing points, measured by their sines."""
        if not len(self._precision):
            return _nothing(unknowns)
        residuals = AngleResiduals(self._ends, unknowns, self._turn)
        energy, precision = self._weighed(residuals)
        sine, J = residuals.sine[:, self._points_of], residuals.jacobian()[:, :, self._points_of]
        return energy, *_normal_equations(J, sine, precision)

    def _weighed(self, residuals: AngleResiduals) -> tuple[np.ndarray, np.ndarray]:
        """Returns the energy E [S], and the precision W [S, 1 or 2, N] in dE/dsine = W sine."""
        exponent = -0.5 * residuals.sine[:, self._points_of] ** 2 * self._precision
        highest = exponent.max(axis=1, keepdims=True) if not self._anywhere else np.zeros(1)
        density = self._peak * np.exp(exponent - highest)
        total = density.sum(axis=1) + self._anywhere
        energy = -(np.log(total) + np.squeeze(highest, axis=1) if not self._anywhere else np.log(total))
        return energy.sum(axis=-1), density / total[:, None] * self._precision


class Bends:
    """Distances of the points of straight lines from the chords between their ends.

    Args:
        lines: points [N, 2] of each, centred, in rows.
    """

    def __init__(self, lines: Sequence[np.ndarray]):
        self._lines = [
            (
                EndPoints(points[1:-1]),
                EndPoints(points[[0] * (len(points) - 2)]),
                EndPoints(points[[-1] * (len(points) - 2)]),
            )
            for points in lines
        ]

    def expanded(self, unknowns: np.ndarray) -> Expansion:
        """Expands the energy of the inner points' distances from the chords."""
        if not self._lines:
            return _nothing(unknowns)
        offsets, J = self._offsets(unknowns), _differences(self._offsets, unknowns)
        precision = np.full_like(offsets, 1 / _SIGMA_BEND**2)
        energy = 0.5 * (offsets**2 * precision).sum(axis=-1)
        return energy, *_normal_equations(J, offsets, precision)

    def _offsets(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, N] distances of all inner points from their chords [rows]."""
        offsets = [np.zeros((len(unknowns), 0))]
        for inner, begin, end in self._lines:
            point, one, other = (each.rectified(unknowns[:, MOTION]) for each in (inner, begin, end))
            dx, dy = other.col - one.col, other.row - one.row
            across = dx * (point.row - one.row) - dy * (point.col - one.col)
            offsets.append(across / np.maximum(np.hypot(dx, dy), _LEAST_LENGTH))
        return np.concatenate(offsets, axis=1)


class Facing:
    """Slopes of level lines relative to the camera's roll, which are small on surfaces that face the camera.

    Args:
        lines: points [N, 2] of each, centred, in rows.
        turn: roll [rad] of a camera held upright.
    """

    def __init__(self, lines: Sequence[np.ndarray], turn: float):
        self._ends = [(EndPoints(points[:1]), EndPoints(points[-1:])) for points in lines]
        self._turn = turn

    def expanded(self, unknowns: np.ndarray) -> Expansion:
        """Expands the energy of the slopes, modelled by a mixture of two Gaussians."""
        if not self._ends:
            return _nothing(unknowns)
        slopes, J = self._slopes(unknowns), _differences(self._slopes, unknowns)
        energy, precision = two_gaussians(slopes, _SIGMA_FACING, _SIGMA_RECEDING, rare_share=1 - _FACING)
        return energy.sum(axis=-1), *_normal_equations(J, slopes, precision)

    def _slopes(self, unknowns: np.ndarray) -> np.ndarray:
        """[S, N] angles between lines and the horizontal of a camera with this roll [rad]."""
        slopes = []
        for begin, end in self._ends:
            one, other = begin.rectified(unknowns[:, MOTION]), end.rectified(unknowns[:, MOTION])
            angle = np.arctan2(other.row - one.row, other.col - one.col) - unknowns[:, ROLL, None] - self._turn
            slopes.append((angle + math.pi / 2) % math.pi - math.pi / 2)
        return np.concatenate(slopes, axis=1)


def _differences(residuals: Callable[[np.ndarray], np.ndarray], unknowns: np.ndarray) -> np.ndarray:
    """[S, 10, N] derivative of residuals [S, N] that depend only on motion and roll."""
    at = residuals(unknowns)
    J = np.zeros((len(unknowns), UNKNOWNS, at.shape[1]))
    for k in (*range(UNKNOWNS)[MOTION], ROLL):
        changed = unknowns.copy()
        changed[:, k] += _STEP
        J[:, k] = (residuals(changed) - at) / _STEP
    return J


def _normal_equations(J: np.ndarray, residual: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J^T W r [S, 10] and J^T W J [S, 10, 10], where J is [S, 10, ...], r and W are [S, ...]."""
    count = len(J)
    flat = J.reshape(count, UNKNOWNS, -1)
    weighted = flat * precision.reshape(count, 1, -1)
    return (weighted @ residual.reshape(count, -1, 1))[..., 0], weighted @ flat.transpose(0, 2, 1)


def _nothing(unknowns: np.ndarray) -> Expansion:
    count = len(unknowns)
    return np.zeros(count), np.zeros((count, UNKNOWNS)), np.zeros((count, UNKNOWNS, UNKNOWNS))
