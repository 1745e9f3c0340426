"""Adjusts all unknowns of an alignment together until it best predicts the tracks of a clip.

A camera turns a direction d that it sees at one moment into R(t1) R(t0)^T d. A track of a corner from row y0 of one
frame to row y1 of the next shows the rotation between the exposures of the two rows. Thus the log's rates, rotated to
the camera's axes and shifted by an offset, predict every track, and the errors of the predictions show how to correct
the axes, the offset, the focal length and the readout ratio: Gauss-Newton, with Student's t for the errors of tracks.

Translation adds an unknown motion to each pair of frames, whose size is estimated too: if the camera only turns, it is
small, and whole frames are informative; if it walks, the differences between rows of a frame still are. It is modelled
as the motion of a plane (eight numbers), with a part that is constant or changes linearly over the clip.

``GyroRotations`` is the result: the rotation of every row, which is removed from tracks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from unshutter.frames.camera import ROWS, padded_ends
from unshutter.frames.self_calibration import fewer
from unshutter.frames.tracks import Tracks
from unshutter.motion.lens import Lens
from unshutter.motion.robust import student_weights
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.motion.shapes import Float64
from unshutter.progress import Count, uncounted
from unshutter.video.gyro.gyro_log import Alignment, GyroLog, Pair

HALF = ROWS / 2  # px: a turn about the viewing axis moves the picture's edge by this times the angle


@dataclass(frozen=True)
class AdjustmentParams:
    """How an alignment is adjusted."""

    rounds: int = 20
    negligible: float = 0.05  # standard deviations: smaller changes of unknowns count as none
    most_tracks: int = 40  # per pair: more only take longer
    stretch: int = 8  # number of consecutive pairs of frames with correlated errors
    common: float = 4.0  # errors of tracks are correlated: n tracks count as n / common
    begun_px: float = 3.0  # size of each pair's own motion at the start
    steady_px: float = 100.0  # of its steady part
    spreads_px: tuple[float, float] = (1e-3, 10.0)  # least and greatest


_PARAMS = AdjustmentParams()

# Unknowns: tilt of the axes (3) [rad], offset [s], drift, bias (3) [rad/s], logarithm of the focal length, ratio.
_FOCAL = 8
_RATIO = 9
_PRIORS = [0.15] * 3 + [0.1, 3e-4] + [0.02] * 3 + [0.5, 0.3]  # standard deviations of the changes
_STEPS = np.diag([1e-4] * 3 + [1e-4, 1e-5] + [1e-4] * 3 + [1e-3] * 2)  # steps of numerical differentiation
_MOST_CHANGE = np.array([0.1] * 3 + [0.01, 1e-3] + [0.02] * 3 + [0.15, 0.2])  # per round
_COMMONS = 8  # parameters of the motion of a plane between two frames


@dataclass(eq=False)
class Adjustment:
    """The tracks of a clip and the log that should predict them."""

    log: GyroLog
    pairs: Sequence[Pair]  # tracks between frames; at most ``_PARAMS.most_tracks`` of each pair are used
    usual_focal_px: float  # expected focal length [px of ROWS rows]
    focal_known: bool = False  # whether to keep the focal length fixed
    ratio_known: bool = False  # whether to keep the readout ratio fixed
    _rotations: dict[tuple[float, ...], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.pairs = [replace(pair, tracks=fewer(pair.tracks, _PARAMS.most_tracks)) for pair in self.pairs]
        ends, self.used = padded_ends([pair.tracks for pair in self.pairs])
        self.ends = ends * ROWS / self.pairs[0].tracks.height  # px of ROWS rows

    # ---- tracks and predictions ------------------------------------------------------------------------

    @cached_property
    def taken(self) -> np.ndarray:
        """Times at which the frames were taken [2, pairs, 1] [s]."""
        return np.array([[pair.begin_s for pair in self.pairs], [pair.end_s for pair in self.pairs]])[..., None]

    @property
    def width(self) -> float:
        """Width of the frames [px of ROWS rows]."""
        tracks = self.pairs[0].tracks
        return tracks.width * ROWS / tracks.height

    def predicted(self, alignment: Alignment) -> np.ndarray:
        """Predicts the ends of tracks [pairs, most, 2] [px of ROWS rows] from the rotations in the log."""
        middle = np.array([self.width / 2, HALF])
        rotated = alignment.to_camera_axes(*self.gyro_rotations(alignment))
        return _seen((self.ends[0] - middle) / alignment.focal_px, rotated, self.lens) * alignment.focal_px + middle

    @property
    def lens(self) -> Lens | None:
        """The camera's lens, if it bends straight lines."""
        return self.pairs[0].tracks.lens

    def gyro_rotations(self, alignment: Alignment) -> tuple[np.ndarray, np.ndarray]:
        """Returns rotations of the device between rows of each track [pairs, most, 3, 3], and their durations [s]."""
        clock = (alignment.offset_s, alignment.drift, alignment.ratio)
        if clock not in self._rotations:
            times = alignment.log_time(self.taken, np.clip(self.ends[..., 1] / ROWS, 0, 1))
            begin = self.log.rotations(times[0])
            end = self.log.rotations(times[1])
            self._rotations.clear()
            self._rotations[clock] = end @ begin.swapaxes(-1, -2), times[1] - times[0]
        return self._rotations[clock]

    def residuals(self, alignment: Alignment) -> np.ndarray:
        """Returns the prediction errors of tracks [pairs, 2 most] [px of ROWS rows]; 0 for padding."""
        off = (self.ends[1] - self.predicted(alignment)) * self.used[..., None]
        return off.reshape(len(self.pairs), -1)

    @cached_property
    def shares(self) -> np.ndarray:
        """Derivatives [pairs, 2 most, 8] of tracks with respect to the motion of a plane seen by a moving camera."""
        x, y = np.moveaxis((self.ends.mean(axis=0) - [self.width / 2, HALF]) / HALF, -1, 0)
        one = np.ones_like(x)
        none = np.zeros_like(x)
        columns = np.stack([one, none, x, y, none, none, x * x, x * y], axis=-1)
        rows = np.stack([none, one, none, none, x, y, x * y, y * y], axis=-1)
        shares = np.stack([columns, rows], axis=-2) * self.used[..., None, None]
        return shares.reshape(len(self.pairs), -1, _COMMONS)

    @cached_property
    def steady(self) -> np.ndarray:
        """Derivatives [pairs, 2 most, 16] for that motion's constant part and its linear change over the clip."""
        at = self.taken[0, :, 0]
        at = (at - at.mean()) / max(np.ptp(at), 1e-9)
        return np.concatenate([self.shares, self.shares * at[:, None, None]], axis=-1)

    # ---- solution --------------------------------------------------------------------------------------

    def solve(self, start: Alignment, count: Count = uncounted) -> tuple[Alignment, float, float]:
        """Finds the alignment that best predicts the tracks.

        Args:
            count: called after each round, with the number of pairs.

        Returns:
            The alignment, the noise of the tracks [px of ROWS rows], and the standard deviation of the readout ratio,
            0 if it was known.
        """
        priors = np.array(_PRIORS)
        priors[[_FOCAL, _RATIO]] *= [not self.focal_known, not self.ratio_known]
        free = np.flatnonzero(priors)
        expected = np.zeros(len(priors))
        expected[_FOCAL] = np.log(self.usual_focal_px / start.focal_px)
        change = np.zeros(len(priors))
        common = np.zeros((len(self.pairs), _COMMONS))
        spread = np.full(_COMMONS, _PARAMS.begun_px)
        steady = np.zeros(2 * _COMMONS)
        noise = np.nan
        precision = np.concatenate([priors[free] ** -2.0, np.full(len(steady), _PARAMS.steady_px**-2.0)])
        for _ in range(_PARAMS.rounds):
            off = self.residuals(changed(start, change))
            slopes = [(off - self.residuals(changed(start, change + step))) / step.sum() for step in _STEPS[free]]
            count(len(self.pairs))
            slopes = np.concatenate([np.stack(slopes, axis=-1), self.steady], axis=-1)
            weights, noise = self._weights(off - self._along(common) - self.steady @ steady, noise)
            weighted = (self.shares * weights[..., None]).transpose(0, 2, 1)
            inner = np.linalg.inv(weighted @ self.shares + np.diag(spread**-2.0))
            matrix, moments = self._normal(slopes, weights, weighted, inner, off)
            matrix = matrix / _PARAMS.common + np.diag(precision)
            moments = moments / _PARAMS.common
            moments[: len(free)] += precision[: len(free)] * (expected - change)[free]
            delta = np.linalg.solve(matrix, moments)
            change[free] += np.clip(delta[: len(free)], -_MOST_CHANGE[free], _MOST_CHANGE[free])
            steady = delta[len(free) :]
            left = off - slopes @ delta
            common = np.einsum("pcd,pdn,pn->pc", inner, weighted, left, optimize=True)
            counted = (1 - np.einsum("pcc->pc", inner) / spread**2).sum(axis=0)  # how many of them the tracks determine
            spread = np.clip(np.sqrt((common**2).sum(axis=0) / np.maximum(counted, 1e-3)), *_PARAMS.spreads_px)
            errors = np.zeros(len(priors))
            errors[free] = self._errors(matrix, slopes, weights * (left - self._along(common)))[: len(free)]
            if (np.abs(delta[: len(free)]) < _PARAMS.negligible * errors[free]).all():
                break
        return changed(start, change), float(noise), errors[_RATIO]

    def _along(self, common: np.ndarray) -> np.ndarray:
        """Returns the displacements [pairs, 2 most] of tracks by each pair's own motion."""
        return (self.shares @ common[..., None])[..., 0]

    def _normal(
        self, slopes: np.ndarray, weights: np.ndarray, weighted: np.ndarray, inner: np.ndarray, off: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns the normal equations of the unknowns, with each pair's own motion eliminated."""
        across = weighted @ slopes  # [pairs, 8, unknowns]
        matrix = np.einsum("pnu,pn,pnv->uv", slopes, weights, slopes, optimize=True)
        matrix -= np.einsum("pcu,pcd,pdv->uv", across, inner, across, optimize=True)
        moments = np.einsum("pnu,pn,pn->u", slopes, weights, off, optimize=True)
        moments -= np.einsum("pcu,pcd,pdn,pn->u", across, inner, weighted, off, optimize=True)
        return matrix, moments

    def _errors(self, matrix: np.ndarray, slopes: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Returns standard deviations, from the noise of tracks or, if larger, differences between parts of the clip.

        Args:
            matrix: [unknowns, unknowns] inverse of the covariance resulting from the noise.
            slopes: [pairs, 2 most, unknowns] derivatives of the tracks with respect to the unknowns.
            left: [pairs, 2 most] weighted residuals of the tracks.
        """
        inverse = np.linalg.inv(matrix)
        scores = np.einsum("pnu,pn->pu", slopes, left)
        parts = np.array_split(scores, max(len(scores) // _PARAMS.stretch, 2))
        stretches = np.array([part.sum(axis=0) for part in parts])
        between = inverse @ (stretches.T @ stretches) @ inverse / _PARAMS.common**2
        return np.sqrt(np.maximum(np.diag(inverse), np.diag(between)))

    def _weights(self, off: np.ndarray, noise: float) -> tuple[np.ndarray, float]:
        """Returns weights [pairs, 2 most] of the tracks under Student's t, and its scale [px]."""
        squared = (off.reshape(*self.used.shape, 2) ** 2).sum(axis=-1)
        weights, noise = student_weights(squared, self.used, noise)
        return np.repeat(weights, 2, axis=1), noise


def changed(alignment: Alignment, change: np.ndarray) -> Alignment:
    """Returns an alignment with its unknowns changed."""
    tilt, (offset, drift), bias, (focal, ratio) = change[:3], change[3:5], change[5:8], change[8:]
    return replace(
        alignment,
        axes=rotation_matrix(tilt) @ alignment.axes,
        offset_s=alignment.offset_s + offset,
        drift=alignment.drift + drift,
        bias=alignment.bias + bias,
        focal_px=alignment.focal_px * np.exp(focal),
        ratio=alignment.ratio + ratio,
    )


def _seen(at: np.ndarray, rotated: np.ndarray, lens: Lens | None) -> np.ndarray:
    """Returns where positions [..., 2] [focal lengths] are seen after rotations [..., 3, 3]."""
    if lens is not None:
        rays = np.stack(lens.direction(at[..., 0], at[..., 1]), axis=-1)
        return np.stack(lens.position(*np.einsum("...ij,...j->i...", rotated, rays)), axis=-1)
    seen = np.einsum("...ij,...j->...i", rotated, np.concatenate([at, np.ones((*at.shape[:-1], 1))], axis=-1))
    return seen[..., :2] / seen[..., 2:]


@dataclass(frozen=True, eq=False)
class GyroRotations:
    """Rotations of a clip's camera from its gyro log (``KnownRotations`` for frames/sequence.py)."""

    log: GyroLog
    alignment: Alignment  # alignment of the log with the clip

    def focal_px(self, height: int) -> float:
        """Returns the focal length for frames with this number of rows [px]."""
        return self.alignment.focal_px * height / ROWS

    def within_frame(self, begin_s: float, rows: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3"]:
        """Returns rotation vectors of a frame's rows since the first of them [rad] (motion/rotations.py)."""
        return self.between((np.full(1, begin_s), rows[:1]), (np.full(len(rows), begin_s), rows))[1]

    def from_frame(self, begin_s: float, end_s: float, row: float) -> Float64[np.ndarray, "3"]:
        """Returns the rotation vector [rad] of a row from one frame to another."""
        at = np.array([row])
        return self.between((np.array([begin_s]), at), (np.array([end_s]), at))[1][0]

    def without(self, tracks: Tracks, begin_s: float, end_s: float) -> Tracks:
        """Returns tracks as seen by a camera that did not turn between the two frames."""
        if not len(tracks):
            return tracks
        unit = ROWS / tracks.height
        focal_px = self.alignment.focal_px
        middle = np.array([tracks.width, tracks.height]) / 2 - 0.5
        rows = [np.clip((at[:, 1] + 0.5) / tracks.height, 0, 1) for at in (tracks.start, tracks.end)]
        rotated, _ = self.between((np.full(len(tracks), begin_s), rows[0]), (np.full(len(tracks), end_s), rows[1]))
        seen = _seen((tracks.start - middle) * unit / focal_px, rotated, tracks.lens)
        predicted = seen * focal_px / unit + middle
        return replace(tracks, end=tracks.start + (tracks.end - predicted))

    def between(
        self, begin: tuple[np.ndarray, np.ndarray], end: tuple[np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Computes rotations of the scene, in the camera's axes, from rows of frames to rows of other frames.

        Returns:
            [..., 3, 3] rotations, and [..., 3] their rotation vectors [rad].
        """
        times = [self.alignment.log_time(*each) for each in (begin, end)]
        before, after = (self.log.rotations(each) for each in times)
        rotated = self.alignment.to_camera_axes(after @ before.swapaxes(-1, -2), times[1] - times[0])
        return rotated, rotation_vector(rotated)


# ---- which way is up --------------------------------------------------------------------------------------------

_SPREAD_S = 2.0  # standard deviation of the average: longer than steps and swings, shorter than the gyro's drift
_RATE_HZ = 20.0  # rate of the averaged samples


def has_gravity(log: GyroLog) -> bool:
    """Whether the log contains acceleration that shows which way is up."""
    return len(log.force) >= 16


def up_directions(
    rotations: GyroRotations, frame_s: Float64[np.ndarray, "frames"], row: float
) -> Float64[np.ndarray, "frames 3"]:
    """Returns unit vectors pointing up, in the camera's axes (right, down, forward), when a row of a frame was exposed.

    Args:
        rotations: those of the camera, by a log that :func:`has_gravity`.
        row: row as a fraction of the height.
    """
    log = rotations.log
    alignment = rotations.alignment
    times = log.force[:, 0]
    force = log.force[:, 1:]
    still = np.einsum("nji,nj->ni", log.rotations(times), force)  # as if the device had not turned
    grid = np.arange(times[0], times[-1] + 1 / _RATE_HZ, 1 / _RATE_HZ)
    even = np.stack([np.interp(grid, times, axis) for axis in still.T], axis=-1)
    reach = round(3 * _SPREAD_S * _RATE_HZ)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (_SPREAD_S * _RATE_HZ)) ** 2)
    total = np.convolve(np.ones(len(grid)), kernel)[reach:-reach]
    mean = np.stack([np.convolve(axis, kernel)[reach:-reach] / total for axis in even.T], axis=-1)
    at_s = alignment.log_time(frame_s, np.full(len(frame_s), row))
    up = np.stack([np.interp(at_s, grid, axis) for axis in mean.T], axis=-1)
    up = np.einsum("ij,njk,nk->ni", alignment.axes, log.rotations(at_s), up)
    return up / np.linalg.norm(up, axis=1, keepdims=True).clip(1e-9)
