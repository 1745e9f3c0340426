"""Readout time and direction of a clip by regression: how skewed and stretched each frame is against the previous one.

Row y of frame k, counted from the middle of H rows, is exposed at k + r y / H, where r is the readout ratio. If the
picture moves along a path X(t), then rows move differently from frame to frame, by (r / H) (X'(k+1) - X'(k)) a row. Of
an affine motion d = c + A p between two frames,

    skew = A_xy + A_yx    and    stretch = A_yy - A_xx

are zero whatever a global shutter sees of turning, rolling and zooming. So skew follows r / H times the change of the
speed across, and stretch that of the speed down. The changes are those of a cubic spline through the path; depth makes
skew and stretch follow the speed itself, so that speeds are further unknowns of the regression. It is robust, and its
standard errors allow for errors that are correlated over some frames. A negative r means that rows were read from the
bottom to the top.

There are two controls. The change of speed some frames earlier or later must explain nothing: where it does, the
standard error is too small by that much. And columns in place of rows must explain nothing, unless the picture was
turned by 90 degrees.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from unshutter.frames.camera import padded_ends
from unshutter.frames.tracks import Tracks, straightened
from unshutter.motion.robust import falling_weights, median, weighted_least_squares
from unshutter.motion.shapes import Bool, Float64
from unshutter.readout_time import ReadoutRatio, ReadoutSource


@dataclass(frozen=True)
class RegressionParams:
    """Weights in a regression, and when it is trusted (docs/research/clips.md; lab/benchmarks/real_clips.py)."""

    min_tracks: int = 30  # of a pair of frames
    least_spread: float = 0.5  # of their rows, as a share of the height
    repeated_px: float = 0.01  # a picture that moves by less is a copy
    shortest_run: int = 7  # pairs in a row: fewer have no path
    end: int = 2  # pairs at both ends of a run that are left out: a spline's ends are unsure
    min_pairs: int = 15  # of a regression
    lag: int = 3  # pairs over which errors may be correlated
    shifts: tuple[int, ...] = (-17, -13, -11, -9, -7, 7, 9, 11, 13, 17)  # frames, of the first control
    uneven: float = 0.6  # intervals: pairs whose frames are farther apart than usual by this are left out
    rounds: int = 8  # of reweighting
    sure: float = 6.0  # t above which a readout is certain
    precise: float = 20.0  # t above which the ratio's error is below 5 %
    likely: float = 3.0  # t above which a ratio is likely
    likely_error: float = 0.1  # largest error of a likely ratio
    none: float = 0.05  # ratio below which there is none
    none_error: float = 0.02  # largest standard error of a ratio that is none
    would_show: float = 0.15  # error at which any readout would show
    # of the ratio, where errors are small: a spline misses fast shaking, and a focal length that is found is not exact
    model_error: float = 0.05


_PARAMS = RegressionParams()


@dataclass(frozen=True)
class PairMotion:
    """Motion of the picture between two frames, by its tracks."""

    shift: Float64[np.ndarray, "2"]  # of the middle of the picture, (across, down) [px]
    shape: Float64[np.ndarray, "2"]  # (skew, stretch) [px at half the height]

    @property
    def moved(self) -> bool:
        """Whether the second frame differs from the first: encoders repeat frames to fill gaps."""
        return float(np.hypot(*self.shift) + np.hypot(*self.shape)) > _PARAMS.repeated_px

    @classmethod
    def through_lens(cls, pairs: Sequence[Tracks], focal: float | None = None) -> list[PairMotion | None]:
        """Returns the motions as a lens shows them that keeps lines straight; None where tracks are too few."""
        seen = [replace(pair, start=straightened(pair.start, pair), end=straightened(pair.end, pair)) for pair in pairs]
        return cls.of(seen, focal)

    @classmethod
    def of(cls, pairs: Sequence[Tracks], focal: float | None = None) -> list[PairMotion | None]:
        """Returns the motions that most tracks support; None where they are too few, or all in a narrow strip.

        Args:
            focal: focal length [heights of the frame]; None: a very long one.
        """
        enough = [k for k, pair in enumerate(pairs) if _are_enough(pair)]
        motions: list[PairMotion | None] = [None] * len(pairs)
        if enough:
            for k, fitted in zip(enough, _fitted([pairs[k] for k in enough], focal), strict=True):
                motions[k] = cls(fitted[:2], fitted[4:6])
        return motions


def _are_enough(pair: Tracks) -> bool:
    return len(pair) >= _PARAMS.min_tracks and np.ptp(pair.start[:, 1]) >= _PARAMS.least_spread * (pair.height - 1)


def _fitted(pairs: Sequence[Tracks], focal: float | None) -> Float64[np.ndarray, "pairs 8"]:
    """Fits to the tracks of each pair: shift across and down, roll, zoom, skew, stretch, and two of a plane's tilt.

    Skew is what a rotation of the camera adds whose speed across changes from row to row; stretch, whose speed down
    does. With a short focal length, they move the sides of the picture more than its middle.
    """
    ends, used = padded_ends(pairs)
    moved = ends[1] - ends[0]
    sizes = np.array([(pair.width, pair.height) for pair in pairs], np.float64)
    half = (sizes[:, 1] - 1) / 2
    x, y = np.moveaxis((ends[0] - sizes[:, None] / 2) / half[:, None, None], -1, 0)
    none = np.zeros_like(x)
    one = np.ones_like(x)
    bent = 0.0 if focal is None else y / (2 * focal) ** 2  # of rows [half heights]
    across = np.stack([one, none, -y, x, y + bent * x * x, bent * x * y, x * x, x * y], axis=-1)
    down = np.stack([none, one, x, y, bent * x * y, y + bent * y * y, x * y, y * y], axis=-1)
    rows = np.stack([across, down], axis=2)
    weights = used.astype(np.float64)
    unknowns = np.zeros((len(pairs), 8))
    for _ in range(_PARAMS.rounds):
        unknowns = weighted_least_squares(
            rows.reshape(len(pairs), -1, 8), moved.reshape(len(pairs), -1), np.repeat(weights, 2, axis=-1)
        )
        squared = np.square(moved - (rows @ unknowns[:, None, :, None])[..., 0]).sum(axis=-1)
        middle = median(np.where(used, squared, np.inf), used.sum(axis=-1))
        scale = np.maximum(1.4826**2 * middle / 1.4, 1e-5)
        weights = used * falling_weights(squared / (4 * scale[:, None]), power=2)
    return unknowns


@dataclass(frozen=True, eq=False)
class Run:
    """Pairs of consecutive frames whose motions are known."""

    shifts: Float64[np.ndarray, "pairs 2"]  # shift of each pair, per frame interval [px]
    shapes: Float64[np.ndarray, "pairs 2"]  # skew and stretch of each [px at half the height]
    changes: Float64[np.ndarray, "pairs 2"]  # change of the speed from its first to its second frame [px per interval]
    used: Bool[np.ndarray, "pairs"]  # pairs that count
    aspect: float  # height of a frame / width

    @classmethod
    def of(cls, pairs: Sequence[PairMotion], gaps: Sequence[float], aspect: float) -> Run:
        """Returns the run of some pairs; gaps are the times between their frames [usual frame intervals]."""
        shifts = np.array([pair.shift for pair in pairs])
        between = np.asarray(gaps, np.float64)
        path = np.concatenate([np.zeros((1, 2)), np.cumsum(shifts, axis=0)])
        speed = spline_slopes(np.concatenate([[0.0], np.cumsum(between)]), path)
        used = np.abs(between - np.median(between)) < _PARAMS.uneven
        used[: _PARAMS.end] = False
        used[-_PARAMS.end :] = False
        shapes = np.array([pair.shape for pair in pairs])
        return cls(shifts / between[:, None], shapes, np.diff(speed, axis=0), used, aspect)


def runs_of(pairs: Iterable[tuple[PairMotion | None, float | None]], aspect: float) -> list[Run]:
    """Returns the runs in a series of pairs.

    Args:
        pairs: motion of each pair, None if it is unknown; and the time between its frames [usual frame intervals], None
            if they are not neighbours.
        aspect: height of a frame / width.
    """
    runs: list[Run] = []
    motions: list[PairMotion] = []
    gaps: list[float] = []
    repeated = 0.0  # intervals since the last frame that is no copy of the one before it
    for motion, gap in [*pairs, (None, None)]:
        if motion is not None and gap is not None:
            if not motion.moved:
                repeated += gap
                continue
            motions.append(motion)
            gaps.append(gap + repeated)
            repeated = 0.0
            continue
        if len(motions) >= _PARAMS.shortest_run:
            runs.append(Run.of(motions, gaps, aspect))
        motions = []
        gaps = []
        repeated = 0.0
    return runs


@dataclass(frozen=True)
class Estimate:
    """A ratio found by regression."""

    ratio: float
    error: float  # its standard error

    @property
    def t(self) -> float:
        """The ratio in units of its standard error."""
        return self.ratio / self.error


@dataclass(frozen=True)
class Regression:
    """Readout ratio of a clip, by regression."""

    rows: Estimate  # read one after another, from the top; negative: from the bottom
    columns: Estimate  # read one after another, from the left; negative: from the right
    spread: float  # scatter of t where the path is shifted in time; 1 where errors are as large as they seem
    pairs: int  # pairs of frames that count
    change_px: float  # root mean square of what a ratio of 1 would explain, at the top and bottom rows [px]

    @property
    def wobble_px(self) -> float:
        """What the ratio explains from frame to frame, root mean square at the top and bottom rows [px]."""
        return abs(self.rows.ratio) * self.change_px

    @property
    def most_ratio(self) -> float:
        """The largest ratio, of either sign, that the frames leave possible."""
        return abs(self.rows.ratio) + 2 * self.error

    @property
    def most_wobble_px(self) -> float:
        """What that ratio explains [px]."""
        return self.most_ratio * self.change_px

    @property
    def error(self) -> float:
        """Standard error of the ratio, estimated from shifted paths."""
        return self.rows.error * max(1.0, self.spread)

    @property
    def t(self) -> float:
        """The ratio in units of that error."""
        return self.rows.ratio / self.error

    @property
    def readout_ratio(self) -> ReadoutRatio:
        """The ratio of a clip that was read from the top to the bottom, with an error that includes the model's."""
        error = float(np.hypot(self.error, _PARAMS.model_error * self.rows.ratio))
        return ReadoutRatio(min(self.rows.ratio, 1.0), error, ReadoutSource.REGRESSION)

    @property
    def is_sure(self) -> bool:
        """Whether it is certain that rows were read one after another, and how fast."""
        return abs(self.t) > _PARAMS.sure and abs(self.columns.t) < abs(self.rows.t)

    @property
    def is_precise(self) -> bool:
        """Whether it is so certain that no more frames are needed."""
        return self.is_sure and abs(self.t) > _PARAMS.precise

    @property
    def is_likely(self) -> bool:
        """Whether rows were probably read one after another, at about this ratio."""
        quiet = abs(self.columns.t) < abs(self.rows.t) / 2
        return abs(self.t) > _PARAMS.likely and self.error < _PARAMS.likely_error and quiet

    @property
    def is_none(self) -> bool:
        """Whether it is certain that all rows were exposed at once, or look as if they had been."""
        return abs(self.rows.ratio) < _PARAMS.none and self.error < _PARAMS.none_error

    @property
    def is_turned(self) -> bool:
        """Whether columns were read one after another: the picture was turned by 90 degrees."""
        t = self.columns.t / max(1.0, self.spread)
        return abs(t) > _PARAMS.sure and abs(self.columns.t) > 2 * abs(self.rows.t)

    @property
    def wobbles(self) -> bool:
        """Whether rows were probably read one after another, from the top, however fast."""
        return self.t > _PARAMS.likely and abs(self.columns.t) < abs(self.rows.t)

    @property
    def would_show(self) -> bool:
        """Whether a rolling shutter, if there was one, would have shown in the frames so far."""
        return self.error < _PARAMS.would_show


def regression(runs: Sequence[Run]) -> Regression | None:
    """Returns the readout ratio that the pairs of some runs show, or None if they are too few."""
    pairs = int(sum(run.used.sum() for run in runs))
    if pairs < _PARAMS.min_pairs:
        return None
    shapes, speeds, changes = (np.concatenate(each) for each in zip(*map(_counted, runs), strict=True))
    shifted = [np.concatenate([_counted(run, shift)[2] for run in runs]) for shift in _PARAMS.shifts]
    turned = (np.concatenate(each) for each in zip(*[_counted(_turned(run)) for run in runs], strict=True))
    of_columns, _, changes_of_columns = turned
    ratios, errors = _ratios(
        np.stack([shapes, of_columns, *[shapes] * len(shifted)]),
        np.stack([changes, changes_of_columns, *shifted]),
        speeds,
    )
    rows, columns, *others = map(Estimate, ratios.tolist(), errors.tolist())
    spread = float(np.sqrt(np.mean(np.square([other.t for other in others]))))
    return Regression(rows, columns, spread, pairs, float(np.sqrt(2 * np.mean(changes**2))))


def _turned(run: Run) -> Run:
    """Returns a run with columns in place of rows."""
    skew, stretch = run.shapes.T
    changes = run.changes[:, ::-1] * run.aspect
    return Run(run.shifts, np.stack([skew, -stretch], axis=1), changes, run.used, run.aspect)


def _counted(run: Run, shift: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns shapes, speeds and half of the changes of the pairs that count; the changes may be shifted in time."""
    inner = slice(_PARAMS.end, -_PARAMS.end)
    changes = np.roll(run.changes[inner] / 2, shift, axis=0)
    return run.shapes[run.used], run.shifts[run.used], changes[run.used[inner]]


def _ratios(
    shapes: Float64[np.ndarray, "cases pairs 2"],
    changes: Float64[np.ndarray, "cases pairs 2"],
    speeds: Float64[np.ndarray, "pairs 2"],
) -> tuple[Float64[np.ndarray, "cases"], Float64[np.ndarray, "cases"]]:
    """Returns the ratios by which changes explain skew and stretch, and their standard errors."""
    cases, pairs, _ = shapes.shape
    own = np.broadcast_to(np.concatenate([np.ones((pairs, 1)), speeds], axis=1), (cases, pairs, 3))
    both = np.zeros((cases, 2, pairs, 7))
    values = np.moveaxis(shapes, -1, 1)
    for kind in range(2):
        both[:, kind, :, 0] = changes[..., kind]
        both[:, kind, :, 1 + 3 * kind : 4 + 3 * kind] = own
    alone = np.concatenate([both[..., :1], np.broadcast_to(own[:, None], (cases, 2, pairs, 3))], axis=-1)
    left = fit_robustly(values, alone)[2]
    scale = np.maximum(1.4826 * median(np.abs(left)), 1e-6)[..., None]
    scaled = (both / scale[..., None]).reshape(cases, 2 * pairs, 7)
    unknowns, errors, _ = fit_robustly((values / scale).reshape(cases, -1), scaled)
    return unknowns[:, 0], errors[:, 0]


def fit_robustly(
    values: Float64[np.ndarray, "*cases n"], rows: Float64[np.ndarray, "*cases n unknowns"]
) -> tuple[
    Float64[np.ndarray, "*cases unknowns"], Float64[np.ndarray, "*cases unknowns"], Float64[np.ndarray, "*cases n"]
]:
    """Returns unknowns, standard errors that allow for correlation between neighbours, and what is left."""
    count, size = rows.shape[-2:]
    weights = np.ones_like(values)
    unknowns = np.zeros((*values.shape[:-1], size))
    left = values
    for _ in range(_PARAMS.rounds):
        unknowns = weighted_least_squares(rows, values, weights)
        left = values - (rows @ unknowns[..., None])[..., 0]
        scale = np.maximum(1.4826 * median(np.abs(left)), 1e-9)[..., None]
        weights = falling_weights((left / (2.5 * scale)) ** 2, power=1)
    inverse = np.linalg.pinv((rows * weights[..., None]).swapaxes(-1, -2) @ rows)
    scores = rows * (weights * left)[..., None]
    scatter = scores.swapaxes(-1, -2) @ scores
    for step in range(1, _PARAMS.lag + 1):
        beside = scores[..., step:, :].swapaxes(-1, -2) @ scores[..., :-step, :]
        scatter += (1 - step / (_PARAMS.lag + 1)) * (beside + beside.swapaxes(-1, -2))
    covariance = inverse @ scatter @ inverse * count / max(count - size, 1)
    return unknowns, np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 1e-18)), left


def spline_slopes(
    times: Float64[np.ndarray, "n"], values: Float64[np.ndarray, "n columns"]
) -> Float64[np.ndarray, "n columns"]:
    """Returns the slopes of the cubic spline through values, whose third derivative does not change at the second and
    the last but one (de Boor, A Practical Guide to Splines, IV).
    """
    gaps = np.diff(times)
    slopes = np.diff(values, axis=0) / gaps[:, None]
    n = len(times)
    matrix = np.zeros((n, n))
    inner = np.arange(1, n - 1)
    matrix[inner, inner - 1] = gaps[1:]
    matrix[inner, inner] = 2 * (gaps[:-1] + gaps[1:])
    matrix[inner, inner + 1] = gaps[:-1]
    right = np.zeros_like(values)
    right[1:-1] = 3 * (gaps[1:, None] * slopes[:-1] + gaps[:-1, None] * slopes[1:])
    for end, a, b in ((0, 0, 1), (n - 1, n - 2, n - 3)):
        beside = 1 if end == 0 else n - 2
        span = gaps[a] + gaps[b]
        matrix[end, end] = gaps[b]
        matrix[end, beside] = span
        right[end] = ((gaps[a] + 2 * span) * gaps[b] * slopes[a] + gaps[a] ** 2 * slopes[b]) / span
    return np.linalg.solve(matrix, right)
