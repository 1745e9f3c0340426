"""Estimates the camera's rotation from tracks between consecutive frames: a spline over time, by linear least squares.

The unknown is the rotation T(t) of the picture [rad, about three axes], with the rate defined in motion/rotations.py.
Time t is counted in frame intervals, and row y of frame k is exposed at k + ratio (y + 1/2) / height. A track from
(x0, y0) in frame k to (x1, y1) in frame k + 1 measures the difference of T between the times of its two rows. With
directions (x, y, 1) half way between both,

    x1 - x0 = -x y D_x + (1 + x^2) D_y - y D_z        y1 - y0 = -(1 + y^2) D_x + x y D_y + x D_z

where D is that difference: linear in T, and so in the coefficients of its spline. (Adding up the rotations within one
frame interval is exact to about 1e-4 of the square of their size.) Directions need a focal length; with a long one
D_y, D_x, D_z act like translations t_x, t_y and a rotation r_z, for cameras that no focal length fits.

A fourth unknown is the change of scale, x1 - x0 = x D_4, y1 - y0 = y D_4: without it, a camera that drives forwards
would be mistaken for one that rotates. It is estimated but not corrected.

So is the skew and stretch that depth adds to each pair (parallax.py) and, where tracks bear it, the velocity that depth
adds all over the picture (parallax_grid.py).

Errors of tracks are modelled by Student's t, so that outliers have little influence, and the spline's second derivative
as white noise. The size of both is estimated too, by maximising the probability of the tracks (the evidence).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from unshutter.frames.parallax import PairShapes, Solution
from unshutter.frames.parallax_grid import Parallax, ParallaxGrid, faded
from unshutter.frames.smoothing import ORDER, basis, log_determinant, roughness, solve_banded
from unshutter.frames.tracks import Tracks
from unshutter.motion.lens import Lens
from unshutter.motion.robust import falling_weights, student_log_likelihoods, student_weights
from unshutter.motion.shapes import Bool, Float64
from unshutter.progress import Count, uncounted


@dataclass(frozen=True, eq=False)
class RotationEquations:
    """For each track: its displacement = jacobian @ (spline @ coefficients).

    The product of both factors is six times as large as the two together, and is never formed.
    """

    # difference of each spline, among those that a pair's times overlap, between a track's two ends
    spline: Float64[np.ndarray, "pairs most local"]
    jacobian: Float64[np.ndarray, "pairs most 2 unknowns"]  # displacement of a track per unknown
    spans: Float64[np.ndarray, "pairs most"]  # time between a track's two ends [usual frame intervals]

    def left(
        self, coefficients: Float64[np.ndarray, "pairs local k"], moved: Float64[np.ndarray, "pairs most 2"]
    ) -> Float64[np.ndarray, "pairs most 2"]:
        """Returns what the first k unknowns leave of each track's displacement [px]."""
        rotated = self.spline @ coefficients
        return moved - (self.jacobian[..., : coefficients.shape[-1]] @ rotated[..., None])[..., 0]

    def normal(
        self, weights: Float64[np.ndarray, "pairs most"], moved: Float64[np.ndarray, "pairs most 2"]
    ) -> tuple[Float64[np.ndarray, "pairs n n"], Float64[np.ndarray, "pairs n"]]:
        """Returns each pair's normal equations for its coefficients, spline by spline: matrix and right-hand side."""
        pairs, _, local = self.spline.shape
        unknowns = self.jacobian.shape[-1]
        first, second = np.triu_indices(local)
        half = self._spline_products @ (self._jacobian_products * weights[..., None])
        one, other = np.triu_indices(unknowns)
        each = np.empty((len(first), pairs, unknowns, unknowns))
        each[..., one, other] = each[..., other, one] = half.swapaxes(0, 1)
        blocks = np.empty((pairs, local, unknowns, local, unknowns))
        blocks[:, first, :, second], blocks[:, second, :, first] = each, each
        of_moved = (self.jacobian * moved[..., None]).sum(axis=2)  # J^T moved of each track
        right = self.spline.swapaxes(1, 2) @ (of_moved * weights[..., None])
        return blocks.reshape(pairs, local * unknowns, -1), right.reshape(pairs, -1)

    @cached_property
    def _spline_products(self) -> np.ndarray:
        """[pairs, local (local + 1) / 2, most] products of every two splines."""
        first, second = np.triu_indices(self.spline.shape[-1])
        each = np.ascontiguousarray(self.spline.swapaxes(1, 2))
        return each[:, first] * each[:, second]

    @cached_property
    def _jacobian_products(self) -> np.ndarray:
        """[pairs, most, unknowns (unknowns + 1) / 2] J^T J of each track, the upper half."""
        one, other = np.triu_indices(self.jacobian.shape[-1])
        return (self.jacobian[..., one] * self.jacobian[..., other]).sum(axis=2)


ROWS = 256  # errors and curvatures are in pixels of a picture with this many rows
PER_FRAME = 4  # knots
COARSE = 2  # knots per frame that suffice to compare readout ratios and focal lengths
_UNKNOWNS = 4  # at any time: three rotations and the change of scale
_RIDGE = 1e-6  # px^-2; T has an arbitrary origin, which this fixes
_STIFFNESS = tuple(10.0**k for k in range(-3, 6))  # px^-2 frames^3: values tried
_ROUNDS = 4
_SETTLED_PX = 0.01  # change from knot to knot, root mean square
_LEAST_OFF = 0.02  # lower limit of the tracks' error [px]


@dataclass(frozen=True, eq=False)
class Fit:
    """The camera's rotation over time, estimated from tracks."""

    # [knots, 4] of the spline [px of ROWS rows; divided by the focal length: rad]
    coefficients: Float64[np.ndarray, "knots 4"]
    focal_px: float  # focal length [px of ROWS rows]
    noise_px: float  # noise of the tracks [px of ROWS rows]
    stiffness: float  # weight of the spline's curvature
    log_evidence: float  # log probability of the tracks, up to a constant
    per_frame: int = PER_FRAME  # knots
    parallax: Parallax | None = None  # velocities that depth adds; None: they were not looked for

    @classmethod
    def none(cls, focal_px: float) -> Fit:
        """Returns the fit of a camera that does not move."""
        return cls(np.zeros((ORDER, _UNKNOWNS)), focal_px, 0.0, _STIFFNESS[-1], 0.0)

    def later(self, frames: int) -> Fit:
        """Returns the fit with times counted from a later frame, from which another fit can start."""
        parallax = self.parallax and self.parallax.later(frames)
        return replace(self, coefficients=self.coefficients[self.per_frame * frames :], parallax=parallax)

    def after(self, earlier: Fit, at: float, over: float) -> Fit:
        """Fades an earlier fit into this one, so that the path has no step.

        Windows that overlap agree about how the camera moved from frame to frame, but not quite about how far it turned
        within all frames alike, which is barely visible.

        Args:
            earlier: fit of the frames before, for times counted as here.
            at: time up to which the path is the earlier one's [frame intervals].
            over: time that it takes to become this one's [frame intervals].
        """
        shared = min(len(self.coefficients), len(earlier.coefficients))
        share = np.clip((at + over - np.arange(shared) / self.per_frame) / over, 0.0, 1.0)[:, None]
        scaled = earlier.coefficients[:shared] * (self.focal_px / earlier.focal_px)
        apart = scaled - self.coefficients[:shared]
        fading = (share > 0) & (share < 1)
        apart -= apart[fading[:, 0]].mean(axis=0) if fading.any() else apart[-1]
        coefficients = self.coefficients.copy()
        coefficients[:shared] += share * apart
        return replace(self, coefficients=coefficients, parallax=faded(self.parallax, earlier.parallax, at, over))

    def of_knots(self, knots: int) -> Float64[np.ndarray, "knots 4"]:
        """Returns the coefficients of the first ``knots`` knots; extrapolates linearly beyond the known ones."""
        known = self.coefficients[:knots]
        steps = np.arange(1, knots - len(known) + 1)[:, None]
        return np.concatenate([known, known[-1] + steps * (known[-1] - known[-2])])

    def rotation(self, at: Float64[np.ndarray, "times"]) -> Float64[np.ndarray, "times 3"]:
        """T [rad] at times [frame intervals since the first frame's first row]; constant beyond the ends."""
        last = (len(self.coefficients) - 3) / self.per_frame
        inside = np.clip(at, 0.0, last)
        rotation = basis(inside * self.per_frame, len(self.coefficients)) @ self.coefficients[:, :3]
        return rotation / self.focal_px


@dataclass(frozen=True, eq=False)
class Problem:
    """The linear equations for the tracks between consecutive frames."""

    pairs: Sequence[Tracks]  # tracks from each frame to the next
    focal_px: float  # focal length [px of ROWS rows]
    # times of the first frame and of each later one [usual frame intervals], the first below 1; None if frames were
    # taken at even intervals
    starts: Sequence[float] | None = None
    # standard deviation of the skew and stretch that depth adds to a pair, for a px of speed [px] (parallax.py); None:
    # there is none
    depth: float | None = None
    count: Count = uncounted  # called after each solution, with the number of pairs
    per_frame: int = PER_FRAME  # knots of the spline
    has_parallax: bool = False  # whether depth adds a velocity all over the picture (parallax_grid.py)
    is_compared: bool = False  # whether the evidence of fits is compared, so that rounds are not left out
    _unit: float = field(init=False)
    # [2, pairs, most, 2] starts and ends of the tracks, (col, row) [px of ROWS rows]
    _ends: Float64[np.ndarray, "2 pairs most 2"] = field(init=False)
    _used: Bool[np.ndarray, "pairs most"] = field(init=False)  # which entries of the padded arrays hold a track

    def __post_init__(self) -> None:
        ends, used = padded_ends(self.pairs)
        unit = ROWS / self.pairs[0].height
        for name, value in (("_unit", unit), ("_ends", ends * unit), ("_used", used)):
            object.__setattr__(self, name, value)

    # ---- the equations ---------------------------------------------------------------------------------

    @cached_property
    def _taken(self) -> np.ndarray:
        """[pairs, 2] times of each pair's frames [usual frame intervals]."""
        starts = np.arange(len(self.pairs) + 1.0) if self.starts is None else np.asarray(self.starts, np.float64)
        return np.stack([starts[:-1], starts[1:]], axis=-1)

    @cached_property
    def _local(self) -> int:
        """Number of splines that overlap the times of two frames, counted from the last whole interval before them."""
        spans = np.ceil(self._taken[:, 1] - np.floor(self._taken[:, 0]) - 1e-9)
        return self.per_frame * (int(spans.max()) + 1) + 4

    @cached_property
    def _moved(self) -> np.ndarray:
        """[pairs, most, 2] displacement of each track [px of ROWS rows]."""
        return self._ends[1] - self._ends[0]

    @cached_property
    def _jacobian(self) -> np.ndarray:
        """[pairs, most, 2, 4] displacement of each track for a rotation of 1 / focal length."""
        first = self.pairs[0]
        return rotation_jacobian(self._ends.mean(axis=0), first.width * self._unit, self.focal_px, first.lens)

    def _equations(self, ratio: float) -> RotationEquations:
        since = self._taken - np.floor(self._taken[:, :1])
        times = ratio * np.clip(self._ends[..., 1] / ROWS, 0, 1) + since.T[:, :, None]
        spline = basis(np.minimum(times * self.per_frame, self._local - 3.04), self._local)
        return RotationEquations(spline[1] - spline[0], self._jacobian, times[1] - times[0])

    @cached_property
    def _shapes(self) -> PairShapes:
        """Skew and stretch of the pairs, as further unknowns."""
        at = (self._ends.mean(axis=0) - [self.pairs[0].width * self._unit / 2, ROWS / 2]) / (ROWS / 2)
        gaps = np.diff(self._taken, axis=1)
        moved = [np.median(pair.end - pair.start, axis=0) if len(pair) else np.zeros(2) for pair in self.pairs]
        speeds = np.array(moved) * self._unit / gaps
        return PairShapes.of(at, self._jacobian, speeds, self._taken.mean(axis=1))

    @cached_property
    def _grid(self) -> ParallaxGrid:
        """Velocities that depth adds, as further unknowns."""
        size = (ROWS, self.pairs[0].width * self._unit)
        return ParallaxGrid.of(self._ends.mean(axis=0), size, self._taken.mean(axis=1))

    @property
    def _knots(self) -> int:
        return int(np.floor(self._taken[:, 0]).max()) * self.per_frame + self._local

    @cached_property
    def _places(self) -> np.ndarray:
        """[pairs, 4 local] indices of the unknowns that each pair's times involve."""
        first = np.floor(self._taken[:, :1]).astype(int)
        return _UNKNOWNS * self.per_frame * first + np.arange(_UNKNOWNS * self._local)

    @cached_property
    def _prior(self) -> np.ndarray:
        """[unknowns, unknowns] quadratic form of the prior for a stiffness of 1."""
        return np.kron(roughness(self._knots) * self.per_frame**3, np.eye(_UNKNOWNS))

    @property
    def moments(self) -> Float64[np.ndarray, "frames"]:
        """Times of the frames [usual frame intervals]."""
        return np.append(self._taken[:, 0], self._taken[-1, 1])

    @cached_property
    def fastest(self) -> float:
        """90th percentile of the displacement per frame interval, in the fastest pair [px of ROWS rows]."""
        shifts = [np.hypot(*(pair.end - pair.start).T) for pair in self.pairs]
        gaps = np.diff(self._taken, axis=1)[:, 0]
        speeds = [np.quantile(shift, 0.9) / gap for shift, gap in zip(shifts, gaps, strict=True) if len(shift)]
        return float(max(speeds, default=0.0)) * self._unit

    # ---- solution --------------------------------------------------------------------------------------

    def fit(self, ratio: float, stiffness: float | None = None, near: Fit | None = None) -> Fit:
        """Returns the most probable motion.

        Args:
            ratio: readout time in frame intervals, 0 ... 1.
            stiffness: weight of the curvature; None selects the one with the highest evidence.
            near: fit for another ratio or stiffness to start from, which saves time.
        """
        equations = self._equations(ratio)
        if stiffness is not None:
            return self._solved(equations, stiffness, near)
        best = near
        fits: dict[float, Fit] = {}
        at = _STIFFNESS.index(near.stiffness) if near is not None else _STIFFNESS.index(1.0)
        while True:  # hill climbing: the evidence has a single maximum
            for k in (at, at - 1, at + 1):
                if 0 <= k < len(_STIFFNESS) and _STIFFNESS[k] not in fits:
                    fits[_STIFFNESS[k]] = best = self._solved(equations, _STIFFNESS[k], best)
            highest = max(fits.values(), key=lambda fit: fit.log_evidence)
            if _STIFFNESS.index(highest.stiffness) == at:
                return highest
            at = _STIFFNESS.index(highest.stiffness)

    def _solved(self, equations: RotationEquations, stiffness: float, near: Fit | None) -> Fit:
        """Returns the most probable motion for one stiffness, by iteratively reweighted least squares."""
        weights = self._used.astype(np.float64)
        noise = np.nan
        unknowns = None if near is None else near.of_knots(self._knots).ravel()
        shapes = None
        solution = None
        moved = self._moved
        velocities = None
        matrix = np.empty_like(self._prior)
        for _ in range(_ROUNDS if near is not None else 2 * _ROUNDS):
            if unknowns is not None:
                if self.has_parallax:
                    moved, velocities = self._without_parallax(equations, unknowns, weights)
                left = self._left(equations, unknowns, shapes, moved)
                weights, noise = student_weights((left**2).sum(axis=-1), self._used, noise)
            np.multiply(self._prior, stiffness, out=matrix)
            matrix.flat[:: len(matrix) + 1] += _RIDGE
            before = unknowns
            solution = self._solution(equations, weights, matrix, moved)
            unknowns = solution.unknowns
            shapes = solution.shapes
            if before is not None and not self.is_compared and _are_alike(before, unknowns):
                break
        assert unknowns is not None
        assert solution is not None
        if self.has_parallax:
            moved, velocities = self._without_parallax(equations, unknowns, weights)
        squared = (self._left(equations, unknowns, shapes, moved) ** 2).sum(axis=-1)[self._used]
        likelihood = student_log_likelihoods(squared, noise).sum()
        free = len(unknowns) - 2 * _UNKNOWNS  # the prior leaves position and speed free
        bent = stiffness * unknowns @ (self._prior @ unknowns) + _RIDGE * unknowns @ unknowns
        evidence = likelihood - (bent + solution.cost - free * np.log(stiffness) + log_determinant(solution.left)) / 2
        self.count(len(self.pairs))
        coefficients = unknowns.reshape(-1, _UNKNOWNS)
        parallax = None if velocities is None else Parallax(self._taken.mean(axis=1), velocities)
        about = self.focal_px, float(noise), stiffness, float(evidence), self.per_frame, parallax
        return Fit(coefficients, *about)

    def _solution(
        self, equations: RotationEquations, weights: np.ndarray, matrix: np.ndarray, moved: np.ndarray
    ) -> Solution:
        """Solves the linear equations for given weights of the tracks; adds to the matrix, which holds the prior."""
        right = np.zeros(len(matrix))
        normal, moments = equations.normal(weights, moved)
        shapes = None
        if self.depth is not None:
            shapes = self._shapes.eliminated(weights, equations.spline, self.depth, moved)
            normal = normal - shapes.normal()
            moments = moments - shapes.right()
        for k, place in enumerate(self._places):
            span = slice(place[0], place[-1] + 1)
            matrix[span, span] += normal[k]
            right[span] += moments[k]
        block = _UNKNOWNS * self._local
        if shapes is not None:
            return shapes.solved(matrix, right, self._places, block)
        unknowns, left = solve_banded(matrix, right[:, None], block)
        return Solution(unknowns[:, 0], left)

    def _left(
        self, equations: RotationEquations, unknowns: np.ndarray, shapes: np.ndarray | None, moved: np.ndarray
    ) -> np.ndarray:
        """[pairs, most, 2] distance of each track's end from its predicted position."""
        if shapes is not None:
            moved = moved - np.einsum("pmcs,ps->pmc", self._shapes.displacement, shapes)
        return equations.left(self._of_pairs(unknowns), moved)

    def _of_pairs(self, unknowns: np.ndarray) -> np.ndarray:
        """[pairs, local, 4] coefficients of the splines that each pair's times overlap."""
        return unknowns[self._places].reshape(len(self.pairs), -1, _UNKNOWNS)

    def _without_parallax(
        self, equations: RotationEquations, unknowns: np.ndarray, weights: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the tracks' displacements less those that depth adds, and the velocities of the grid's nodes."""
        left = equations.left(self._of_pairs(unknowns)[..., :3], self._moved)
        velocities = self._grid.velocities(left, equations.spans, weights / weights.max())
        return self._moved - self._grid.displaced(velocities, equations.spans), velocities

    def shows_parallax(self, fit: Fit, ratio: float) -> bool:
        """Whether what a fit leaves of the tracks is a velocity that depends on their place."""
        equations = self._equations(ratio)
        left = equations.left(self._of_pairs(fit.of_knots(self._knots).ravel()), self._moved)
        weights, noise = student_weights((left**2).sum(axis=-1), self._used, fit.noise_px)
        return self._grid.is_borne(left, equations.spans, weights * noise**2, self._used)


def _are_alike(before: Float64[np.ndarray, "n"], after: Float64[np.ndarray, "n"]) -> bool:
    """Whether two splines turn so alike from knot to knot that no more rounds need to follow."""
    change = np.diff((after - before).reshape(-1, _UNKNOWNS), axis=0)
    return bool((change**2).mean() < _SETTLED_PX**2)


def steady(fit: Fit, problem: Problem, ratio: float) -> Fit:
    """Stiffens a fit until no frame moves much faster during its readout than between frames.

    An oscillation that repeats with every frame leaves no trace in the tracks, and one that grows from frame to
    frame looks like a scene whose lower rows move faster, as near ground does. Such a fit is rejected in favour of a
    stiffer spline.
    """
    most = 1.5 * ratio / 2 * problem.fastest + 0.5  # as much as a hand makes
    rows = np.linspace(0, 1, 9)
    times = (problem.moments[:, None] + ratio * rows).ravel()
    while fit.stiffness < _STIFFNESS[-1]:
        rotations = fit.rotation(times).reshape(-1, len(rows), 3)
        reach = np.abs(rotations - rotations[:, [len(rows) // 2]]) * [fit.focal_px, fit.focal_px, ROWS / 2]
        if reach.max() <= most:  # of any row against its frame's middle row
            break
        fit = problem.fit(ratio, fit.stiffness * 10)
    return fit


def rotation_between(tracks: Tracks, focal_px: float) -> Float64[np.ndarray, "3"]:
    """Returns the rotation [rad] between two frames that most tracks support, ignoring the readout time."""
    jacobian, moved = track_jacobian(tracks, focal_px)
    weights = np.ones(len(tracks))
    unknowns = np.zeros(_UNKNOWNS)
    for _ in range(12):
        weighted = jacobian * weights[:, None, None]
        normal = np.einsum("nij,nik->jk", weighted, jacobian) + _RIDGE * np.eye(_UNKNOWNS)
        unknowns = np.linalg.solve(normal, np.einsum("nij,ni->j", weighted, moved))
        off = np.hypot(*(moved - jacobian @ unknowns).T)
        scale = max(float(np.median(off)), _LEAST_OFF)
        weights = falling_weights((off / scale) ** 2, power=2)
    return unknowns[:3] / focal_px


def track_jacobian(
    tracks: Tracks, focal_px: float
) -> tuple[Float64[np.ndarray, "tracks 2 4"], Float64[np.ndarray, "tracks 2"]]:
    """Returns the :func:`rotation_jacobian` half way along each track, and its displacement [px of ROWS rows]."""
    unit = ROWS / tracks.height
    start = (tracks.start + 0.5) * unit
    end = (tracks.end + 0.5) * unit
    return rotation_jacobian((start + end) / 2, tracks.width * unit, focal_px, tracks.lens), end - start


def padded_ends(
    pairs: Sequence[Tracks],
) -> tuple[Float64[np.ndarray, "2 pairs most 2"], Bool[np.ndarray, "pairs most"]]:
    """Returns the starts and ends of tracks, (col, row) from the corner of the copy, and which entries hold a track."""
    most = max(1, *(len(pair) for pair in pairs))
    ends = np.zeros((2, len(pairs), most, 2))
    for k, pair in enumerate(pairs):
        ends[0, k, : len(pair)], ends[1, k, : len(pair)] = pair.start, pair.end
    return ends + 0.5, np.array([np.arange(most) < len(pair) for pair in pairs])


def rotation_jacobian(
    at: Float64[np.ndarray, "*points 2"],
    width: float,
    focal_px: float | Float64[np.ndarray, "*#points 1"],
    lens: Lens | None = None,
) -> Float64[np.ndarray, "*points 2 4"]:
    """Returns the displacement of points for a rotation of 1 / focal length about each axis, and for scale.

    Args:
        at: the points (col, row) [px of ROWS rows].
        width: width of the picture [px of ROWS rows].
        lens: the lens, if it bends straight lines.
    """
    x, y = np.moveaxis((at - [width / 2, ROWS / 2]) / focal_px, -1, 0)
    if lens is not None:
        x, y, z = lens.direction(x, y)
        none = np.zeros_like(x)
        moved = np.stack([np.stack(each) for each in ((none, -z, y), (z, none, -x), (-y, x, none), (x, y, none))])
        return np.einsum("ij...,kj...->...ik", np.array(lens.slopes(x, y, z)), moved)
    columns = np.stack([-x * y, 1 + x * x, -y, x], axis=-1)
    rows = np.stack([-(1 + y * y), x * y, x, y], axis=-1)
    return np.stack([columns, rows], axis=-2)
