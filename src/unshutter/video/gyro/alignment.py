"""Aligns a gyro log with the frames of a clip: offset, orientation of the axes, focal length and readout ratio.

The rotation of every pair of frames is compared with the log at each offset and in each of the 24 possible orientations
of the axes; then all unknowns are adjusted together (synchronisation.py). If the clip was stabilised by the camera, or
the log belongs to another clip, the rotations do not follow the log's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from unshutter.frames.camera import track_jacobian
from unshutter.frames.self_calibration import usual_focal
from unshutter.frames.tracks import GUESSED_RATIO
from unshutter.motion.robust import falling_weights
from unshutter.motion.shapes import Float64
from unshutter.progress import Count, uncounted
from unshutter.reasons import Code, Reason
from unshutter.video.gyro.gyro_log import Alignment, GyroLog, Pair
from unshutter.video.gyro.synchronisation import HALF, Adjustment, GyroRotations


@dataclass(frozen=True)
class AlignmentParams:
    """How a log is aligned with a clip, and when it is used (docs/research/clips.md)."""

    focals: tuple[float, float] = (0.25, 6.0)  # shortest and longest, as multiples of the usual one
    lag_s: float = 0.004  # spacing of the offsets to try
    long_lag_s: float = 0.008  # their spacing if there are many
    many_lags: int = 20_000  # offsets
    lags_at_once: int = 1 << 14  # offsets
    finer: int = 4  # a log is sampled at this fraction of their spacing
    margin_s: float = 2.0  # at both ends of the part of a log that is adjusted
    # minimum correlation. Measured: real clips 0.97 or more, stabilised ones up to 0.5 (0.83 if slightly)
    follows: float = 0.84
    least_px: float = 0.1  # px of ROWS rows: smaller rotations between frames do not show the offset of a log
    no_signal: float = 0.01  # share of the log's rotations: less counts as no signal
    candidates: int = 3  # offsets to adjust
    close: float = 0.3  # their least distance [pairs of frames]
    rival: float = 1.1  # their largest initial cost ratio
    better: float = 0.95  # share of the first one's noise that a rival must not exceed
    rounds: int = 20  # of all adjustments of a clip, usually
    sure_ratio: float = 0.02  # maximum error of an accepted ratio
    ratios: tuple[float, float] = (0.02, 1.03)  # possible range of ratios


PARAMS = AlignmentParams()


@dataclass(frozen=True)
class Synchronisation:
    """Alignment of a log with a clip, and how well the clip follows the log."""

    alignment: Alignment
    ratio_error: float  # standard deviation of its readout ratio; 0 if that was known
    # correlation of the rotations of frames with the log's; of the rotations or of their changes, whichever is less
    follows: float
    rotations_px: float  # size of the rotations between frames in the log, without the constant part [px of ROWS rows]
    ratio_known: bool  # whether the readout ratio was known beforehand

    @property
    def reason(self) -> Reason | None:
        """The reason why the log must not be used; None if the clip follows it."""
        if self.rotations_px < PARAMS.least_px:
            return Reason(Code.GYRO_TOO_CALM)
        if self.follows < PARAMS.follows:
            return Reason.of(Code.GYRO_DISAGREES, correlation=max(self.follows, 0.0))
        return None

    @property
    def shows_ratio(self) -> bool:
        """Whether the clip and its log determine the readout ratio."""
        shortest, longest = PARAMS.ratios
        possible = shortest < self.alignment.ratio < longest
        return not self.ratio_known and self.reason is None and possible and self.ratio_error < PARAMS.sure_ratio


def synchronised(
    log: GyroLog,
    pairs: Sequence[Pair],
    interval_s: float,
    offsets_s: Sequence[tuple[float, float]],
    ratio: float | None = None,
    focal_px: float | None = None,
    count: Count = uncounted,
) -> Synchronisation:
    """Aligns a log with a clip.

    Args:
        pairs: tracks between frames of the clip, all of one size, some of them not empty.
        offsets_s: ranges of possible offsets of the log's clock [s].
        ratio: readout time in frame intervals, if it is known.
        focal_px: focal length [px of ROWS rows], if it is known.
        count: called for each round of an adjustment, with the number of pairs.
    """
    tracks = pairs[0].tracks
    usual = focal_px or usual_focal(tracks)
    lags = sum(last - first for first, last in offsets_s) / PARAMS.lag_s
    lag_s = PARAMS.lag_s if lags < PARAMS.many_lags else PARAMS.long_lag_s
    at = float(np.mean([pair.begin_s for pair in pairs]))
    begun = GUESSED_RATIO if ratio is None else ratio
    starts = [
        Alignment(
            axes=axes,
            offset_s=offset_s,
            drift=0.0,
            at_s=at,
            bias=np.zeros(3),
            focal_px=focal_px or coarse_px,
            ratio=begun,
            interval_s=interval_s,
        )
        for axes, offset_s, coarse_px in _coarse(log, pairs, offsets_s, lag_s, usual)
    ]
    ends = min(pair.begin_s for pair in pairs) - PARAMS.margin_s, max(pair.end_s for pair in pairs) + PARAMS.margin_s
    solved = []
    for start in starts:
        part = log.between(start.offset_s + ends[0], start.offset_s + ends[1])
        adjustment = Adjustment(part, pairs, usual, focal_known=focal_px is not None, ratio_known=ratio is not None)
        solved.append((*adjustment.solve(start, count), part))
    best, *rivals = solved
    for rival in rivals:
        best = rival if rival[1] < PARAMS.better * best[1] else best  # by the noise of the tracks
    alignment, _, ratio_error, part = best
    follows, rotations_px = _agreement(part, pairs, alignment)
    return Synchronisation(alignment, ratio_error, follows, rotations_px, ratio is not None)


def _agreement(log: GyroLog, pairs: Sequence[Pair], alignment: Alignment) -> tuple[float, float]:
    """Correlates frames' rotations with the log's (see :class:`Synchronisation`); also returns the size of the latter.

    The rotations are those shown by the tracks, and those that the tracks would show according to the log: if every row
    of a frame turned differently, they are only a mean. The correlation between two halves of the tracks shows how much
    of the picture's rotations is not noise.
    """
    scale = np.array([1, 1, HALF / alignment.focal_px])
    gyro = GyroRotations(log, alignment)
    halves = []
    logged = []
    for pair in pairs:
        tracks = pair.tracks
        still = gyro.without(tracks, pair.begin_s, pair.end_s)
        predicted = replace(tracks, end=tracks.start + tracks.end - still.end)
        odd = np.arange(len(tracks)) % 2 > 0
        parts = (tracks.only(odd), tracks.only(~odd), predicted)
        one, other, by_log = (
            frame_rotations(replace(pair, tracks=part), alignment.focal_px)[:3] * scale for part in parts
        )
        halves.append((one, other))
        logged.append(by_log)
    seen = np.array(halves)
    rotated = np.array(logged)
    seen = seen - seen.mean(axis=0)
    rotated = rotated - rotated.mean(axis=0)
    size = float(np.sqrt((rotated**2).sum(axis=1).mean()))
    changes = np.diff(seen, axis=0), np.diff(rotated, axis=0)
    return min(_correlation(seen, rotated), _correlation(*changes)), size


def _correlation(seen: np.ndarray, rotated: np.ndarray) -> float:
    """Correlates both halves [n, 2, 3] of seen rotations with those of the log [n, 3]; 1 if there is only noise."""
    signal = (seen[:, 0] * seen[:, 1]).sum()
    logged = (rotated**2).sum()
    if logged < len(rotated) * PARAMS.least_px**2:
        return 1.0
    together = (seen.mean(axis=1) * rotated).sum()
    return float(min(together / np.sqrt(max(signal, PARAMS.no_signal * logged) * logged), 1.0))


# ---- search over offsets and orientations of the axes -----------------------------------------------------------


def _ways() -> np.ndarray:
    ways = []
    for order in permutations(range(3)):
        for signs in np.ndindex(2, 2, 2):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = 1 - 2 * np.array(signs)
            if np.linalg.det(matrix) > 0:
                ways.append(matrix)
    return np.array(ways)


def frame_rotations(pair: Pair, focal_px: float) -> Float64[np.ndarray, "4"]:
    """Fits rotations about three axes and growth to a pair of frames [px of ROWS rows: angle times focal length]."""
    jacobian, moved = track_jacobian(pair.tracks, focal_px)
    jacobian = jacobian.reshape(-1, 4)
    moved = moved.ravel()
    weights = np.ones(len(moved))
    answer = np.zeros(4)
    for _ in range(4):
        answer = np.linalg.lstsq(jacobian * weights[:, None], moved * weights, rcond=None)[0]
        off = np.abs(moved - jacobian @ answer)
        weights = falling_weights((off / (2 * np.median(off) + 1e-3)) ** 2, power=0.5)
    return answer


def _coarse(
    log: GyroLog, pairs: Sequence[Pair], offsets_s: Sequence[tuple[float, float]], lag_s: float, focal_px: float
) -> list[tuple[np.ndarray, float, float]]:
    """Finds axes, offset [s] and focal length [px of ROWS rows] at which frames and log agree best, and rivals."""
    seen = np.array([frame_rotations(pair, focal_px)[:3] for pair in pairs]) * [1, 1, HALF / focal_px]
    seen -= seen.mean(axis=0)
    begin, end = (np.array([getattr(pair, name) for pair in pairs]) for name in ("begin_s", "end_s"))
    ways = _ways()
    tried = []
    for first, last in offsets_s:
        for start in np.arange(first, last + lag_s, PARAMS.lags_at_once * lag_s):
            lags = np.arange(start, min(start + (PARAMS.lags_at_once - 0.5) * lag_s, last + lag_s), lag_s)
            sums = _sums(log, seen, begin, end, lags[0], lag_s / PARAMS.finer, len(lags) * PARAMS.finer)
            cross, energy = (each[:: PARAMS.finer] for each in sums)
            along = np.einsum("lij,wij->lwi", cross, ways)
            power = np.einsum("lj,wij->lwi", energy, np.abs(ways))
            sideways = along[..., 0] + along[..., 1]
            width = power[..., 0] + power[..., 1]
            focal = np.clip(sideways / (width + 1e-12), PARAMS.focals[0] * focal_px, PARAMS.focals[1] * focal_px)
            cost = (seen**2).sum() + focal**2 * width - 2 * focal * sideways
            cost += HALF**2 * power[..., 2] - 2 * HALF * along[..., 2]
            best = np.arange(len(lags)), cost.argmin(axis=1)
            tried.append((lags, cost[best], best[1], focal[best]))
    lags, cost, way, focal = (np.concatenate(each) for each in zip(*tried, strict=True))
    most = cost.min() + (PARAMS.rival - 1) * abs(cost.min())
    found = []
    while len(found) < PARAMS.candidates and cost.min() <= most:
        k = cost.argmin()
        found.append((ways[way[k]], float(lags[k]), float(focal[k])))
        cost[np.abs(lags - lags[k]) < PARAMS.close * float(np.median(end - begin))] = np.inf
    return found


def _sums(
    log: GyroLog, seen: np.ndarray, begin: np.ndarray, end: np.ndarray, first_s: float, step_s: float, lags: int
) -> tuple[np.ndarray, np.ndarray]:
    """Sums over pairs the products of seen and logged rotations [lags, 3, 3], and the squares of the latter [lags, 3].

    As correlations along the log, by Fourier transforms: a long log is compared at a million offsets.

    Args:
        seen: rotations of the pairs [pairs, 3].
        begin, end: times of their frames [s].
        first_s, step_s, lags: the first offset, the distance to the next [s], and their number.
    """
    count = int((end.max() - begin.min()) / step_s) + 2
    size = 1 << (lags + count - 1).bit_length()
    times = begin.min() + first_s + step_s * np.arange(lags + count)
    usual_s = float(np.median(end - begin))
    angles = log.angles(times)
    rotated = log.angles(times + usual_s) - angles

    def kernel(at: np.ndarray, weights: np.ndarray) -> np.ndarray:
        place = (at - begin.min()) / step_s
        before = place.astype(int)
        share = place - before
        return np.bincount(before, (1 - share) * weights, count) + np.bincount(before + 1, share * weights, count)

    def along(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        product = np.fft.rfft(values, size, axis=0) * np.fft.rfft(weights, size, axis=0).conj()
        return np.fft.irfft(product, size, axis=0)[:lags]

    kernels = [kernel(begin, each) - kernel(end, each) for each in seen.T]
    cross = np.stack([along(angles, each[:, None]) for each in kernels], axis=1)
    one = kernel(begin, np.ones(len(begin)))[:, None]
    return cross, np.maximum(along(rotated**2, one) - along(rotated, one) ** 2 / len(begin), 0)
