"""The velocity that depth adds to what a camera's rotation moves, on a coarse grid of the picture.

A camera that walks sees near surfaces pass faster than far ones. In a few frames its speed hardly changes, and neither
does the depth of what a place of the picture shows: what the rotation leaves of the tracks is nearly the same velocity
in each of them, while a hand's shaking averages out. So it is the smooth grid of velocities that fits the tracks of
several frames best, the nearest ones most. Places between nodes are interpolated bilinearly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from unshutter.motion.parallax_field import NODES, node_weights
from unshutter.motion.robust import median
from unshutter.motion.shapes import Bool, Float64

_REACH = 5.0  # frames, within which tracks count
_BEND = 1.0  # weight of the grid's bends, against that of a track
_RIDGE = 1e-3  # of a node without tracks
_BORNE = 0.58  # of the squared error that a grid must leave of tracks that had no part in it, at most


@dataclass(frozen=True, eq=False)
class Parallax:
    """Velocities of some moments."""

    times: Float64[np.ndarray, "pairs"]  # [frame intervals], increasing
    # (across, down) at each node, row by row [px of ROWS rows per frame interval]
    velocities: Float64[np.ndarray, "pairs nodes 2"]

    def at(self, time: float) -> Float64[np.ndarray, "nodes 2"]:
        """Returns the velocities at a time; those of the first or last moment beyond them."""
        place = float(np.interp(time, self.times, np.arange(len(self.times))))
        before = int(place)
        after = min(before + 1, len(self.times) - 1)
        return self.velocities[before] + (place - before) * (self.velocities[after] - self.velocities[before])

    def later(self, frames: int) -> Parallax:
        """Returns them with times counted from a later frame."""
        return replace(self, times=self.times - frames)


def faded(now: Parallax | None, earlier: Parallax | None, at: float, over: float) -> Parallax | None:
    """Fades earlier velocities into those that follow, as :meth:`Fit.after` fades paths; None: there are none."""
    known = now or earlier
    if known is None:
        return None
    share = np.clip((at + over - known.times) / over, 0.0, 1.0)[:, None, None]
    none = np.zeros_like(known.velocities)
    was = none if earlier is None else np.array([earlier.at(time) for time in known.times])
    return replace(known, velocities=share * was + (1 - share) * (none if now is None else now.velocities))


@dataclass(frozen=True, eq=False)
class ParallaxGrid:
    """The tracks of pairs of frames as equations for the nodes of a grid."""

    nodes: Float64[np.ndarray, "pairs most nodes"]  # weights of the nodes about the middle of each track
    times: Float64[np.ndarray, "pairs"]  # [frame intervals]

    @classmethod
    def of(
        cls, at: Float64[np.ndarray, "pairs most 2"], size: tuple[float, float], times: Float64[np.ndarray, "pairs"]
    ) -> ParallaxGrid:
        """Returns the equations of tracks.

        Args:
            at: their places (col, row) from the corner of the picture [px].
            size: height and width of the picture [px].
        """
        return cls(node_weights(at[..., 0] / size[1], at[..., 1] / size[0]), times)

    @cached_property
    def _shares(self) -> np.ndarray:
        """[pairs, pairs] how much the tracks of each pair count for the grid of another."""
        return np.maximum(0.0, 1 - np.abs(self.times[:, None] - self.times) / _REACH)

    def velocities(
        self,
        left: Float64[np.ndarray, "pairs most 2"],
        spans: Float64[np.ndarray, "pairs most"],
        weights: Float64[np.ndarray, "pairs most"],
    ) -> Float64[np.ndarray, "pairs nodes 2"]:
        """Returns the velocities of the nodes [px per frame interval].

        Args:
            left: what the rotation leaves of each track [px].
            spans: time between its ends [frame intervals].
            weights: about 1 for a usual track, 0 for none.
        """
        weighted = (self.nodes * weights[..., None]).swapaxes(1, 2)
        normal = np.tensordot(self._shares, weighted @ self.nodes, 1)
        right = np.tensordot(self._shares, weighted @ (left / np.maximum(spans, 0.1)[..., None]), 1)
        return np.linalg.solve(normal + _PRIOR, right)

    def displaced(
        self, velocities: Float64[np.ndarray, "pairs nodes 2"], spans: Float64[np.ndarray, "pairs most"]
    ) -> Float64[np.ndarray, "pairs most 2"]:
        """Returns how far each track is displaced [px]."""
        return self.nodes @ velocities * spans[..., None]

    def is_borne(
        self,
        left: Float64[np.ndarray, "pairs most 2"],
        spans: Float64[np.ndarray, "pairs most"],
        weights: Float64[np.ndarray, "pairs most"],
        used: Bool[np.ndarray, "pairs most"],
    ) -> bool:
        """Whether a grid by every other track explains much of what is left of the others."""
        first = np.arange(left.shape[1]) % 2 == 0
        then = left - self.displaced(self.velocities(left, spans, weights * first), spans)
        checked = used & ~first
        if not checked.any():
            return False
        before, after = (float(median((each[checked] ** 2).sum(axis=-1))) for each in (left, then))
        return after < _BORNE * before


def _bends() -> Float64[np.ndarray, "nodes nodes"]:
    """Returns the quadratic form of a grid's second differences."""
    each = np.eye(NODES[0] * NODES[1]).reshape(*NODES, -1)
    across = each[:, 2:] - 2 * each[:, 1:-1] + each[:, :-2]
    down = each[2:] - 2 * each[1:-1] + each[:-2]
    twist = np.sqrt(2) * (each[1:, 1:] - each[1:, :-1] - each[:-1, 1:] + each[:-1, :-1])
    rows = np.concatenate([bend.reshape(-1, each.shape[-1]) for bend in (across, down, twist)])
    return rows.T @ rows


_PRIOR = _BEND * _bends() + _RIDGE * np.eye(NODES[0] * NODES[1])
