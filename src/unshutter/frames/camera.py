"""From the tracks of consecutive frames to how the camera turned: a spline over time, by linear least squares.

Unknown is the turn T(t) of the picture [rad, about three axes], whose rate is that of geometry/rotations.py. Time t is
counted in frame intervals, and row y of frame k is exposed at k + ratio (y + 1/2) / height. A track from (x0, y0) in
frame k to (x1, y1) in frame k + 1 says T at the one row's time less T at the other's. With directions (x, y, 1) half
way between both,

    x1 - x0 = -x y D_x + (1 + x^2) D_y - y D_z        y1 - y0 = -(1 + y^2) D_x + x y D_y + x D_z

where D is that difference: linear in T, and so in its spline's coefficients. (The turns of one frame interval add up
to about 1e-4 of the square of their size.) Directions need a focal length; a long one makes D_y, D_x, D_z what
translations t_x, t_y and a rotation r_z do, for cameras of which no focal length fits.

A fourth unknown is the growth of the picture, x1 - x0 = x D_4, y1 - y0 = y D_4: a camera that drives ahead would
otherwise be taken for one that turns. It is found and left unchanged.

Errors of tracks are taken as Student's t, so that outliers do not pull; the spline's second derivative is taken as
white noise. How strong both are is found with the rest, as what makes the tracks most probable (the evidence).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from unshutter.frames.splines import ORDER, basis, log_determinant, roughness, solve_banded
from unshutter.frames.tracks import Tracks
from unshutter.frames.turn_equations import DEGREES, TurnEquations, student_weights

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

ROWS = 256  # errors and curvatures are counted in pixels of a picture of so many rows
_PER_FRAME = 4  # knots
_UNKNOWNS = 4  # of a moment: three turns and the growth of the picture
_RIDGE = 1e-6  # px^-2; T is counted from anywhere: this ties it
_STIFFNESS = tuple(10.0**k for k in range(-3, 6))  # px^-2 frames^3: what is tried
_ROUNDS = 4
_FASTER = 1.5  # than the tracks of all frames say, within one frame: so much is a hand's
_PAIR_ROUNDS, _LEAST_OFF = 12, 0.02  # of the turn between two frames; px that tracks are off by at least
_SLACK = 0.5  # px of ROWS rows, beyond that


@dataclass(frozen=True, eq=False)
class Fit:
    """How the camera turned, as it follows from tracks.

    Attributes:
        coefficients: [knots, 4] of the spline [px of ROWS rows, times the focal length in them: rad].
        focal_px: focal length [px of ROWS rows].
        noise_px: of the tracks [px of ROWS rows].
        stiffness: what the spline's curvature was weighted with.
        log_evidence: logarithm of the probability of the tracks, up to a constant.
    """

    coefficients: Float64[np.ndarray, "knots 4"]
    focal_px: float
    noise_px: float
    stiffness: float
    log_evidence: float

    @classmethod
    def none(cls, focal_px: float) -> Fit:
        """A camera that does not move."""
        return cls(np.zeros((ORDER, _UNKNOWNS)), focal_px, 0.0, _STIFFNESS[-1], 0.0)

    @property
    def knots_per_frame(self) -> int:
        """How densely the spline can bend."""
        return _PER_FRAME

    def turn(self, at: Float64[np.ndarray, "times"]) -> Float64[np.ndarray, "times 3"]:
        """T [rad] at times [frame intervals since the first frame's first row]; goes on straight beyond the ends."""
        last = (len(self.coefficients) - 3) / _PER_FRAME
        inside = np.clip(at, 0.0, last)
        turn = basis(inside * _PER_FRAME, len(self.coefficients)) @ self.coefficients[:, :3]
        return turn / self.focal_px


@dataclass(frozen=True, eq=False)
class Problem:
    """Tracks between consecutive frames, put together as equations.

    Attributes:
        pairs: tracks from each frame to the next.
        focal_px: focal length [px of ROWS rows].
        starts: times of the first frame and of each later one [usual frame intervals], the first below 1; None: frames
            were taken at even intervals.
    """

    pairs: Sequence[Tracks]
    focal_px: float
    starts: Sequence[float] | None = None
    _unit: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_unit", ROWS / self.pairs[0].height)

    # ---- the equations ---------------------------------------------------------------------------------

    @cached_property
    def _taken(self) -> np.ndarray:
        """[pairs, 2] when each pair's frames were taken [usual frame intervals]."""
        starts = np.arange(len(self.pairs) + 1.0) if self.starts is None else np.asarray(self.starts, np.float64)
        return np.stack([starts[:-1], starts[1:]], axis=-1)

    @cached_property
    def _local(self) -> int:
        """Splines that the times of two frames reach, counted from the last whole interval before them."""
        spans = np.ceil(self._taken[:, 1] - np.floor(self._taken[:, 0]) - 1e-9)
        return _PER_FRAME * (int(spans.max()) + 1) + 4

    @cached_property
    def _used(self) -> np.ndarray:
        """[pairs, most] bool: which places of the padded arrays hold a track."""
        most = max(1, *(len(pair) for pair in self.pairs))
        return np.array([np.arange(most) < len(pair) for pair in self.pairs])

    @cached_property
    def _ends(self) -> np.ndarray:
        """[2, pairs, most, 2] starts and ends of the tracks, (col, row) [px of ROWS rows]."""
        ends = np.zeros((2, *self._used.shape, 2))
        for k, pair in enumerate(self.pairs):
            ends[0, k, : len(pair)], ends[1, k, : len(pair)] = pair.start, pair.end
        return (ends + 0.5) * self._unit

    @cached_property
    def _moved(self) -> np.ndarray:
        """[pairs, most, 2] by how much each track moved [px of ROWS rows]."""
        return self._ends[1] - self._ends[0]

    @cached_property
    def _jacobian(self) -> np.ndarray:
        """[pairs, most, 2, 4] by how much each track moves for a turn of 1 / focal length."""
        return turn_jacobian(self._ends.mean(axis=0), self.pairs[0].width * self._unit, self.focal_px)

    def _equations(self, ratio: float) -> TurnEquations:
        since = self._taken - np.floor(self._taken[:, :1])
        times = ratio * np.clip(self._ends[..., 1] / ROWS, 0, 1) + since.T[:, :, None]
        spline = basis(np.minimum(times, self._local / _PER_FRAME - 0.76) * _PER_FRAME, self._local)
        return TurnEquations(spline[1] - spline[0], self._jacobian, self._moved)

    @property
    def _knots(self) -> int:
        return int(np.floor(self._taken[:, 0]).max()) * _PER_FRAME + self._local

    @cached_property
    def _places(self) -> np.ndarray:
        """[pairs, 4 local] which unknowns each pair's times reach."""
        first = np.floor(self._taken[:, :1]).astype(int)
        return _UNKNOWNS * _PER_FRAME * first + np.arange(_UNKNOWNS * self._local)

    @cached_property
    def _prior(self) -> np.ndarray:
        """[unknowns, unknowns]: the quadratic form of a stiffness of 1."""
        return np.kron(roughness(self._knots) * _PER_FRAME**3, np.eye(_UNKNOWNS))

    @property
    def moments(self) -> Float64[np.ndarray, "frames"]:
        """When the frames were taken [usual frame intervals]."""
        return np.append(self._taken[:, 0], self._taken[-1, 1])

    @cached_property
    def fastest(self) -> float:
        """How far nine of ten tracks move in a frame interval, in the pair in which they move farthest [px of ROWS]."""
        shifts = [np.hypot(*(pair.end - pair.start).T) for pair in self.pairs]
        gaps = np.diff(self._taken, axis=1)[:, 0]
        speeds = [np.quantile(shift, 0.9) / gap for shift, gap in zip(shifts, gaps, strict=True) if len(shift)]
        return float(max(speeds, default=0.0)) * self._unit

    # ---- solved ----------------------------------------------------------------------------------------

    def fit(self, ratio: float, stiffness: float | None = None, near: Fit | None = None) -> Fit:
        """The most probable motion.

        Args:
            ratio: readout time in frame intervals, 0 ... 1.
            stiffness: weight of the curvature; None: the one of the highest evidence.
            near: a fit of another ratio or stiffness to begin from: it saves time.
        """
        equations = self._equations(ratio)
        if stiffness is not None:
            return self._solved(equations, stiffness, near)
        best = near
        fits: dict[float, Fit] = {}
        at = _STIFFNESS.index(near.stiffness) if near is not None else _STIFFNESS.index(1.0)
        while True:  # the evidence has one maximum: it is climbed
            for k in (at, at - 1, at + 1):
                if 0 <= k < len(_STIFFNESS) and _STIFFNESS[k] not in fits:
                    fits[_STIFFNESS[k]] = best = self._solved(equations, _STIFFNESS[k], best)
            highest = max(fits.values(), key=lambda fit: fit.log_evidence)
            if _STIFFNESS.index(highest.stiffness) == at:
                return highest
            at = _STIFFNESS.index(highest.stiffness)

    def _solved(self, equations: TurnEquations, stiffness: float, near: Fit | None) -> Fit:
        """The most probable motion of one stiffness, by reweighted least squares."""
        prior = stiffness * self._prior + _RIDGE * np.eye(_UNKNOWNS * self._knots)
        weights, noise = self._used.astype(np.float64), np.nan
        unknowns = near.coefficients.ravel() if near is not None else None
        left: list[np.ndarray] = []
        for _ in range(_ROUNDS if near is not None else 2 * _ROUNDS):
            if unknowns is not None:
                weights, noise = student_weights(self._squared(equations, unknowns), self._used, noise)
            matrix, right = prior.copy(), np.zeros(_UNKNOWNS * self._knots)
            normal, moments = equations.normal(weights)
            for k, place in enumerate(self._places):
                span = slice(place[0], place[-1] + 1)
                matrix[span, span] += normal[k]
                right[span] += moments[k]
            unknowns, left = solve_banded(matrix, right, _UNKNOWNS * self._local)
        assert unknowns is not None
        squared = self._squared(equations, unknowns)[self._used]
        likelihood = -2 * len(squared) * np.log(noise)
        likelihood -= (DEGREES + 2) / 2 * np.log1p(squared / (DEGREES * noise**2)).sum()
        free = len(unknowns) - 2 * _UNKNOWNS  # the prior says nothing of place and speed
        evidence = (
            likelihood - unknowns @ prior @ unknowns / 2 + free * np.log(stiffness) / 2 - log_determinant(left) / 2
        )
        return Fit(unknowns.reshape(-1, _UNKNOWNS), self.focal_px, float(noise), stiffness, float(evidence))

    def _squared(self, equations: TurnEquations, unknowns: np.ndarray) -> np.ndarray:
        """[pairs, most] squared distance of each track's end from where the motion takes it."""
        return equations.squared(unknowns[self._places].reshape(len(self.pairs), -1, _UNKNOWNS))


def steady(problem: Problem, ratio: float, stiffness: float | None) -> Fit:
    """The most probable motion that moves within no frame by much more than the tracks from frame to frame do.

    An oscillation that comes again with every frame leaves no trace in the tracks, and one that grows from frame to
    frame looks like a scene of which the lower rows move faster, as near ground does. Such a fit is not believed: a
    stiffer spline takes its place.

    Args:
        problem: the tracks.
        ratio: readout time in frame intervals.
        stiffness: as of :meth:`Problem.fit`.
    """
    fit = problem.fit(ratio, stiffness)
    most = _FASTER * ratio / 2 * problem.fastest + _SLACK
    while fit.stiffness < _STIFFNESS[-1] and _within_frames(fit, problem, ratio) > most:
        fit = problem.fit(ratio, fit.stiffness * 10)
    return fit


def _within_frames(fit: Fit, problem: Problem, ratio: float) -> float:
    """By how much a motion moves a frame's rows from where its middle row is, at most [px of ROWS rows]."""
    rows = np.linspace(0, 1, 9)
    turns = fit.turn((problem.moments[:, None] + ratio * rows).ravel()).reshape(-1, len(rows), 3)
    reach = np.abs(turns - turns[:, [len(rows) // 2]]) * [fit.focal_px, fit.focal_px, ROWS / 2]
    return float(reach.max())


def turn_between(tracks: Tracks, focal_px: float) -> Float64[np.ndarray, "3"]:
    """The turn [rad] between two frames that most of their tracks show, all rows taken for one moment's.

    Args:
        tracks: from the one to the other; strays do not matter.
        focal_px: focal length [px of ROWS rows].
    """
    unit = ROWS / tracks.height
    start, end = (tracks.start + 0.5) * unit, (tracks.end + 0.5) * unit
    jacobian, moved = turn_jacobian((start + end) / 2, tracks.width * unit, focal_px), end - start
    weights = np.ones(len(tracks))
    unknowns = np.zeros(_UNKNOWNS)
    for _ in range(_PAIR_ROUNDS):
        weighted = jacobian * weights[:, None, None]
        normal = np.einsum("nij,nik->jk", weighted, jacobian) + _RIDGE * np.eye(_UNKNOWNS)
        unknowns = np.linalg.solve(normal, np.einsum("nij,ni->j", weighted, moved))
        off = np.hypot(*(moved - jacobian @ unknowns).T)
        scale = max(float(np.median(off)), _LEAST_OFF)
        weights = 1 / (1 + (off / scale) ** 2) ** 2
    return unknowns[:3] / focal_px


def turn_jacobian(
    at: Float64[np.ndarray, "*points 2"], width: float, focal_px: float
) -> Float64[np.ndarray, "*points 2 4"]:
    """By how much points (col, row) [px of ROWS rows] move for a turn of 1 / focal length about each axis, and growth.

    Args:
        at: the points.
        width: of the picture [px of ROWS rows].
        focal_px: focal length [px of ROWS rows].
    """
    x, y = np.moveaxis((at - [width / 2, ROWS / 2]) / focal_px, -1, 0)
    columns = np.stack([-x * y, 1 + x * x, -y, x], axis=-1)
    rows = np.stack([-(1 + y * y), x * y, x, y], axis=-1)
    return np.stack([columns, rows], axis=-2)
