"""Smooth paths: least-squares fits of cubic splines, and a quadratic programme that smooths rotations.

A path p has a rotation vector for each frame, in the camera's axes. The smoothed path is s = p - c, where the
corrections c minimise

    stiffness * sum |second differences of s|^2 + sum weight * |c - target|^2      subject to  sides c <= room

The first term alone makes a fourth-order low-pass filter that preserves even pans and halves oscillations with a period
of ``period`` frames. The constraints limit how far each frame may be turned before its border shows. Only where they
bind is the path less smooth than the filter would make it, and there it is as smooth as they allow. A primal-dual
interior-point method solves the programme (Nocedal & Wright, Numerical Optimization, 16.6). All matrices are banded:
time and memory grow with the number of frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from unshutter.motion.shapes import Float, Float64

ORDER = 4  # number of B-splines that are non-zero at any time


def basis(at: Float[np.ndarray, "*times"], knots: int) -> Float64[np.ndarray, "*times knots"]:
    """Returns the uniform cubic B-splines at times counted in knot intervals."""
    first = np.clip(np.floor(at).astype(int), 0, knots - ORDER)
    u = at - first
    weights = np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, 3 * (u + u**2 - u**3) + 1, u**3], axis=-1) / 6
    values = np.zeros((*at.shape, knots))
    np.put_along_axis(values, first[..., None] + np.arange(ORDER), weights, axis=-1)
    return values


def roughness(knots: int) -> Float64[np.ndarray, "knots knots"]:
    """Returns the quadratic form of the sum of squared second differences between a spline's coefficients.

    With knots h apart, the integral of the squared second derivative is about ``roughness(knots) / h**3``.
    """
    differences = np.diff(np.eye(knots), 2, axis=0)
    return differences.T @ differences


def solve_banded(
    matrix: Float64[np.ndarray, "n n"], right: Float64[np.ndarray, "n columns"], block: int
) -> tuple[Float64[np.ndarray, "n columns"], list[Float64[np.ndarray, "k k"]]]:
    """Solves a symmetric, positive definite system that is zero beyond a band, block by block.

    Args:
        matrix: zero where row and column differ by more than ``block``.

    Returns:
        The solution, and the Schur complement of each diagonal block (see :func:`log_determinant`).
    """
    n = len(right)
    edges = [*range(0, n, block), n]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    x = right.copy()
    left = []
    solved = []
    before = parts[0]
    for part, following in zip(parts, [*parts[1:], slice(n, n)], strict=True):
        above = matrix[part, following]
        left.append(matrix[part, part] if not left else matrix[part, part] - matrix[before, part].T @ solved[-1])
        every = np.linalg.solve(left[-1], np.concatenate([above, x[part]], axis=1))
        solved.append(every[:, : above.shape[1]])
        x[part] = every[:, above.shape[1] :]
        x[following] -= above.T @ x[part]
        before = part
    for part, following, share in zip(parts[-2::-1], parts[:0:-1], solved[-2::-1], strict=True):
        x[part] -= share @ x[following]
    return x, left


def log_determinant(left: list[Float64[np.ndarray, "k k"]]) -> float:
    """Returns the logarithm of a matrix's determinant, from the diagonal blocks left by :func:`solve_banded`."""
    return float(sum(2 * np.log(np.diag(np.linalg.cholesky(block))).sum() for block in left))


_EDGE = 6  # unknowns of a block that appear in its neighbour's equations: two frames
_CENTRING = 0.15  # of the interior-point method
_GAP = 1e-4  # px^2 at which it stops


def stiffness_for(period: float) -> float:
    """Returns the stiffness that halves oscillations of a period [frames]."""
    return (2 * np.sin(np.pi / max(period, 2.0))) ** -4.0


# limits on each frame's correction c: ``sides @ c <= px`` [frames, constraints, 3] and [frames, constraints]; where
# no room remains, a tiny one is left
Room: TypeAlias = "tuple[Float64[np.ndarray, 'frames constraints 3'], Float64[np.ndarray, 'frames constraints']]"


@dataclass(frozen=True, eq=False)
class Smoothing:
    """The smoothing of one uninterrupted path."""

    times: Float64[np.ndarray, "frames"]  # [frames] times of the frames, increasing [usual frame intervals]
    stiffness: float  # weight of the second differences (:func:`stiffness_for`)
    weights: Float64[np.ndarray, "frames 3"]  # [frames, 3] weights of the corrections

    def corrections(
        self,
        path: Float64[np.ndarray, "frames 3"],
        target: Float64[np.ndarray, "frames 3"],
        room: Room | None = None,
    ) -> Float64[np.ndarray, "frames 3"]:
        """Returns the corrections c of a path that make ``path - c`` smooth.

        Args:
            target: preferred corrections, regardless of smoothness.
        """
        right = self._bent(path) + self.weights * target
        own = np.zeros((len(path), 3, 3))
        own[:, range(3), range(3)] = self.weights
        return self._solved(own, right) if room is None else self._within(room, own, right)

    def _within(self, room: Room, own: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Returns the corrections within their room, by the interior-point method."""
        A, px = room
        b = np.maximum(px, 1e-3)  # room that constraints always leave around the unturned frame
        c = np.zeros_like(right)
        slack = np.maximum(b, 1.0)
        force = np.ones_like(b)
        for _ in range(60):
            gap = float((slack * force).mean())
            r_dual = self._bent(c) + self.weights * c - right + _weighted(A, force)
            r_room = _reach(A, c) + slack - b
            if gap < _GAP and np.abs(r_room).max() < _GAP:
                break
            pull = force / slack
            curvature = own + np.einsum("nmi,nm,nmj->nij", A, pull, A, optimize=True)
            towards = pull * r_room - force + _CENTRING * gap / slack
            d_c = self._solved(curvature, -r_dual - _weighted(A, towards))
            d_slack = -r_room - _reach(A, d_c)
            d_force = _CENTRING * gap / slack - force - pull * d_slack
            step = min(_longest(slack, d_slack), _longest(force, d_force))
            c = c + step * d_c
            slack = slack + step * d_slack
            force = force + step * d_force
        return c

    # ---- the banded equations ----------------------------------------------------------------------------

    def _bands(self) -> np.ndarray:
        """[3, frames] diagonals of the quadratic form of the second differences, from the main one upwards."""
        n = len(self.times)
        gaps = np.diff(self.times)
        bands = np.zeros((3, n))
        if n > 2:
            before = 1 / gaps[:-1]
            after = 1 / gaps[1:]
            parts = (before, -(before + after), after)
            for k, one in enumerate(parts):
                for j, other in enumerate(parts[k:]):
                    bands[j, k : n - 2 + k] += one * other
        return self.stiffness * bands

    def _bent(self, path: np.ndarray) -> np.ndarray:
        """Returns the quadratic form times a path."""
        bands = self._bands()
        result = bands[0, :, None] * path
        for k in (1, 2):
            result[:-k] += bands[k, :-k, None] * path[k:]
            result[k:] += bands[k, :-k, None] * path[:-k]
        return result

    def _solved(self, own: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Solves (quadratic form + each frame's own matrix [frames, 3, 3]) x = right, by blocks of frames."""
        bands = self._bands()
        n = len(right)
        starts = list(range(0, n, 32))
        if len(starts) > 1 and n - starts[-1] < 2:
            starts.pop()  # a block may only be coupled to its neighbours
        ends = [*starts[1:], n]
        carried = np.zeros((0, 0))
        values = np.zeros(0)
        solved: list[np.ndarray] = []
        for start, end in zip(starts, ends, strict=True):
            matrix = self._block(bands, own, start, end)
            side = right[start:end].reshape(-1, 1)
            if solved:
                matrix[:_EDGE, :_EDGE] -= carried
                side = side.copy()
                side[:_EDGE, 0] -= values
            onward = np.zeros((len(matrix), _EDGE if end < n else 0))
            corner = self._corner(bands, end) if end < n else np.zeros((0, 0))
            onward[len(matrix) - len(corner) :] = corner
            both = np.linalg.solve(matrix, np.concatenate([side, onward], axis=1))
            solved.append(both)
            if end < n:
                values = corner.T @ both[-_EDGE:, 0]
                carried = corner.T @ both[-_EDGE:, 1:]
        x = np.empty((n, 3))
        following = np.zeros(0)
        for start, end, both in zip(reversed(starts), reversed(ends), reversed(solved), strict=True):
            part = both[:, 0] - both[:, 1:] @ following
            x[start:end], following = part.reshape(-1, 3), part[:_EDGE]
        return x

    @staticmethod
    def _block(bands: np.ndarray, own: np.ndarray, start: int, end: int) -> np.ndarray:
        """[3 m, 3 m] the equations within a block of m frames."""
        size = end - start
        scalar = np.diag(bands[0, start:end])
        for k in (1, 2):
            if size > k:
                beside = np.diag(bands[k, start : end - k], k)
                scalar += beside + beside.T
        matrix = np.kron(scalar, np.eye(3))
        for k in range(size):
            matrix[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += own[start + k]
        return matrix

    @staticmethod
    def _corner(bands: np.ndarray, end: int) -> np.ndarray:
        """[6, 6] coupling between the last two frames before a block's end and the first two after it."""
        scalar = np.array([[bands[2, end - 2], 0.0], [bands[1, end - 1], bands[2, end - 1]]])
        return np.kron(scalar, np.eye(3))


def _reach(sides: np.ndarray, c: np.ndarray) -> np.ndarray:
    return np.einsum("nmi,ni->nm", sides, c, optimize=True)


def _weighted(sides: np.ndarray, force: np.ndarray) -> np.ndarray:
    return np.einsum("nmi,nm->ni", sides, force, optimize=True)


def _longest(values: np.ndarray, change: np.ndarray) -> float:
    """Returns the longest step, at most 1, that keeps all values positive."""
    shrinking = change < 0
    return min(1.0, 0.97 * float((values[shrinking] / -change[shrinking]).min(initial=np.inf)))
