"""Models the skew and stretch that depth adds to the motion between two frames, which follow its speed.

Near and far move at different speeds. Where the ground is near and lies at the bottom of the picture, lower rows move
faster: as skewed and stretched as by a rolling shutter whose camera speeds up, so that a path would have to bend to
imitate it. So each pair k of frames has its own skew and stretch n_k [px at half the height of the picture], which

    n_k = G_k b + e_k

model: G_k holds 1 and the picture's speed, times functions of time that rise and fall within ``_HAT`` frames; b has
mean about 0 and walks slowly; and e_k is a small remainder. A track at (x, y), in half heights from the middle, is
displaced by N n_k, N = [[y, -x], [x, y]] / 2, in addition to the camera's motion. All are linear. e_k appears in the
equations of one pair only, and is eliminated there; b's few columns are eliminated last.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from unshutter.frames.smoothing import solve_banded
from unshutter.motion.shapes import Float64

# px: standard deviation of the skew and stretch that depth adds to a pair of frames, for a px of speed
DEPTH = 0.006
_HAT = 48  # frames
_WALK = 0.3  # change of b from hat to hat, as a share of its own standard deviation
_REMAINDER_PX = 0.01  # standard deviation of e_k [px of ROWS rows, at half the height]


@dataclass(frozen=True, eq=False)
class PairShapes:
    """Skew and stretch of each pair as unknowns in addition to the coefficients of the camera's motion."""

    displacement: Float64[np.ndarray, "pairs most 2 2"]  # N, of each track
    jacobian: Float64[np.ndarray, "pairs most unknowns 2"]  # J^T N: of the camera's unknowns and the shapes
    follows: Float64[np.ndarray, "pairs columns"]  # G_k, the same for skew and stretch
    hats: int  # number of functions of time, for each of which there are as many columns

    @classmethod
    def of(
        cls,
        at: Float64[np.ndarray, "pairs most 2"],
        jacobian: Float64[np.ndarray, "pairs most 2 unknowns"],
        speeds: Float64[np.ndarray, "pairs 2"],
        times: Float64[np.ndarray, "pairs"],
    ) -> PairShapes:
        """Returns the unknowns of tracks.

        Args:
            at: places of the tracks from the middle of the picture [half heights].
            jacobian: displacement of a track per unknown of the camera's motion.
            speeds: of the picture [px per frame interval].
            times: of the pairs [frame intervals].
        """
        x, y = np.moveaxis(at, -1, 0)
        shapes = np.stack([np.stack([y, -x], -1), np.stack([x, y], -1)], -2) / 2
        hats = max(2, 1 + round(float(np.ptp(times)) / _HAT))
        place = (times - times.min()) / max(float(np.ptp(times)), 1.0) * (hats - 1)
        hat = np.maximum(0.0, 1 - np.abs(place[:, None] - np.arange(hats)))
        kinds = np.concatenate([np.ones((len(times), 1)), speeds], axis=1)
        follows = (hat[:, :, None] * kinds[:, None]).reshape(len(times), -1)
        return cls(shapes, np.swapaxes(jacobian, 2, 3) @ shapes, follows, hats)

    @cached_property
    def _size(self) -> Float64[np.ndarray, "pairs most"]:
        """N^T N of each track, a multiple of the identity."""
        return (self.displacement[..., 0] ** 2).sum(axis=-1)

    def _prior(self, spread: float) -> Float64[np.ndarray, "m m"]:
        """Returns the quadratic form of b's prior."""
        steps = np.diff(np.eye(self.hats), axis=0) / _WALK
        mean = np.ones((1, self.hats)) / self.hats
        hat = steps.T @ steps + mean.T @ mean
        kinds = self.follows.shape[1] // self.hats
        return np.kron(hat, np.eye(2 * kinds)) / spread**2

    def eliminated(
        self,
        weights: Float64[np.ndarray, "pairs most"],
        spline: Float64[np.ndarray, "pairs most local"],
        spread: float,
        moved: Float64[np.ndarray, "pairs most 2"],
    ) -> Eliminated:
        """Returns the equations of the pairs' displacements [px], for b's standard deviation [px for a px of speed]."""
        crossed = np.einsum("pml,pmus->plus", spline * weights[..., None], self.jacobian, optimize=True)
        size = (weights * self._size).sum(axis=1)
        along = np.einsum("pmcs,pmc->pms", self.displacement, moved)  # N^T moved
        of_moved = (weights[..., None] * along).sum(axis=1)
        return Eliminated(self.follows, self._prior(spread), crossed.reshape(len(crossed), -1, 2), size, of_moved)


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of the linear equations of a camera's motion."""

    unknowns: Float64[np.ndarray, "n"]  # coefficients of the camera's motion
    left: list[Float64[np.ndarray, "k k"]]  # what :func:`solve_banded` leaves of the diagonal blocks
    shapes: Float64[np.ndarray, "pairs 2"] | None = None  # skew and stretch of each pair [px]; None: not looked for
    cost: float = 0.0  # -2 log of what the shapes contribute to the evidence


@dataclass(frozen=True, eq=False)
class Eliminated:
    """The equations of the pairs' shapes for one choice of the tracks' weights, e_k eliminated."""

    follows: Float64[np.ndarray, "pairs columns"]  # G_k
    prior: Float64[np.ndarray, "m m"]  # of b
    crossed: Float64[np.ndarray, "pairs n 2"]  # between a pair's coefficients and its shape
    size: Float64[np.ndarray, "pairs"]  # weight of the shape itself
    moved: Float64[np.ndarray, "pairs 2"]  # its right-hand side

    @property
    def _held(self) -> np.ndarray:
        """[pairs] weight of the shape and of the remainder's prior."""
        return self.size + _REMAINDER_PX**-2

    @property
    def _free(self) -> np.ndarray:
        """[pairs] share of a shape that the remainder cannot take."""
        return _REMAINDER_PX**-2 / self._held

    def normal(self) -> Float64[np.ndarray, "pairs n n"]:
        """Returns the correction to subtract from each pair's normal matrix."""
        return self.crossed @ self.crossed.swapaxes(1, 2) / self._held[:, None, None]

    def right(self) -> Float64[np.ndarray, "pairs n"]:
        """Returns the correction to subtract from each pair's right-hand side."""
        return (self.crossed @ (self.moved / self._held[:, None])[..., None])[..., 0]

    def solved(
        self,
        matrix: Float64[np.ndarray, "n n"],
        right: Float64[np.ndarray, "n"],
        places: np.ndarray,
        block: int,
    ) -> Solution:
        """Solves the equations of the camera's motion together with those of b.

        Args:
            matrix: the normal matrix of the camera's motion, from which :meth:`normal` is subtracted; banded.
            right: its right-hand side, from which :meth:`right` is subtracted.
            places: [pairs, k] indices of the unknowns that each pair involves.
            block: width of the band.
        """
        columns = np.zeros((len(right), len(self.prior)))
        scaled = self.crossed * self._free[:, None, None]
        coupled = (self.follows[:, None, :, None] * scaled[:, :, None, :]).reshape(*scaled.shape[:2], -1)
        for place, of_pair in zip(places, coupled, strict=True):
            columns[place[0] : place[-1] + 1] += of_pair
        both, left = solve_banded(matrix, np.concatenate([right[:, None], columns], axis=1), block)
        weight = self._free * self.size
        own = np.kron((self.follows * weight[:, None]).T @ self.follows, np.eye(2)) + self.prior
        complement = own - columns.T @ both[:, 1:]
        own_right = (self.follows.T @ (self._free[:, None] * self.moved)).ravel()
        b = np.linalg.solve(complement, own_right - columns.T @ both[:, 0])
        unknowns = both[:, 0] - both[:, 1:] @ b
        followed = self.follows @ b.reshape(-1, 2)
        explained = np.einsum("pns,pn->ps", self.crossed, unknowns[places]) + self.size[:, None] * followed
        remainder = (self.moved - explained) / self._held[:, None]
        cost = float((remainder**2).sum() / _REMAINDER_PX**2 + b @ self.prior @ b)
        cost += float(2 * np.log(self._held * _REMAINDER_PX**2).sum())
        cost += float(np.linalg.slogdet(complement)[1] - np.linalg.slogdet(self.prior)[1])
        return Solution(unknowns, left, followed + remainder, cost)
