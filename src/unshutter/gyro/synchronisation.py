"""Aligns a gyro log with the tracks of a clip, and checks whether the picture follows the log at all.

First, the turn of every pair of frames is compared with the log at each offset and in each of the 24 possible
orientations of the axes; then all unknowns are adjusted together (adjustment.py). If the clip was stabilised by the
camera, or the log belongs to another clip, the turns do not follow the log's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from unshutter.frames.camera import ROWS, turn_jacobian
from unshutter.gyro.adjustment import Adjusted, Adjustment
from unshutter.gyro.alignment import Alignment, Pair
from unshutter.gyro.log import GyroLog
from unshutter.gyro.rows import GyroTurns
from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

_HALF = ROWS / 2  # px: a turn about the viewing axis moves the picture's edge by this times the angle
_USUAL = 0.85  # expected focal length, as a multiple of width + height
_FOCALS = (0.25, 6.0)  # shortest and longest, as multiples of the usual one
_GUESSED_RATIO = 0.5
_LAG_S, _LONG_LAG_S, _MANY_LAGS = 0.004, 0.008, 20_000  # spacing of the offsets to try; the spacing if there are many
_LAGS_AT_ONCE = 512
_FOLLOWS = 0.84  # minimum correlation. Measured: real clips 0.97 or more, stabilised ones up to 0.5 (0.83 if slightly)
_LEAST_PX = 0.1  # px of ROWS rows: smaller turns between frames do not show the offset of a log
_NO_SIGNAL = 0.01  # share of the log's turns: less counts as no signal
_CANDIDATES, _CLOSE, _RIVAL = 3, 0.3, 1.1  # offsets to adjust; their distance, and their largest initial cost ratio
_BETTER = 0.95  # share of the first one's noise that a rival must not exceed
_SURE_RATIO, _RATIOS = 0.02, (0.02, 1.03)  # maximum error of an accepted ratio, and the possible range of ratios


@dataclass(frozen=True)
class Synchronisation:
    """Alignment of a log with a clip, and how well the clip follows the log.

    Attributes:
        adjusted: the alignment with its errors.
        follows: correlation of the turns of frames with the log's; of the turns or of their changes, whichever is less.
        turns_px: size of the turns between frames in the log, without the constant part [px of ROWS rows].
        ratio_known: whether the readout ratio was known beforehand.
    """

    adjusted: Adjusted
    follows: float
    turns_px: float
    ratio_known: bool

    @property
    def alignment(self) -> Alignment:
        """The adjusted alignment, without its errors."""
        return self.adjusted.alignment

    @property
    def reason(self) -> Reason | None:
        """The reason why the log must not be used; None if the clip follows it."""
        if self.turns_px < _LEAST_PX:
            return Reason(Code.GYRO_TOO_CALM)
        if self.follows < _FOLLOWS:
            return Reason.of(Code.GYRO_DISAGREES, correlation=max(self.follows, 0.0))
        return None

    @property
    def shows_ratio(self) -> bool:
        """Whether the clip and its log determine the readout ratio."""
        shortest, longest = _RATIOS
        possible = shortest < self.alignment.ratio < longest
        return not self.ratio_known and self.reason is None and possible and self.adjusted.ratio_error < _SURE_RATIO


def synchronised(
    log: GyroLog,
    pairs: Sequence[Pair],
    interval_s: float,
    offsets_s: tuple[float, float],
    ratio: float | None = None,
    focal_px: float | None = None,
) -> Synchronisation:
    """Aligns a log with a clip.

    Args:
        log: the log.
        pairs: tracks between frames of the clip, all of one size, some of them not empty.
        interval_s: usual time from one frame to the next [s].
        offsets_s: minimum and maximum possible offset of the log's clock [s].
        ratio: readout time in frame intervals, if it is known.
        focal_px: focal length [px of ROWS rows], if it is known.
    """
    tracks = pairs[0].tracks
    usual = focal_px or _USUAL * (tracks.width + tracks.height) * ROWS / tracks.height
    span = offsets_s[1] - offsets_s[0]
    lag = _LAG_S if span < _LAG_S * _MANY_LAGS else _LONG_LAG_S
    at = float(np.mean([pair.begin_s for pair in pairs]))
    begun = _GUESSED_RATIO if ratio is None else ratio
    starts = [
        Alignment(axes, offset_s, 0.0, at, np.zeros(3), focal_px or coarse_px, begun, interval_s)
        for axes, offset_s, coarse_px in _coarse(log, pairs, np.arange(offsets_s[0], offsets_s[1] + lag, lag), usual)
    ]
    adjustment = Adjustment(log, pairs, usual, focal_px is not None, ratio is not None)
    adjusted, *rivals = (adjustment.solve(start) for start in starts)
    for rival in rivals:
        adjusted = rival if rival.noise_px < _BETTER * adjusted.noise_px else adjusted
    follows, turns_px = _agreement(log, pairs, adjusted.alignment)
    return Synchronisation(adjusted, follows, turns_px, ratio is not None)


def _agreement(log: GyroLog, pairs: Sequence[Pair], alignment: Alignment) -> tuple[float, float]:
    """Correlates frames' turns with the log's (see :class:`Synchronisation`); also returns the size of the latter.

    The turns are those shown by the tracks, and those that the tracks would show according to the log: if every row
    of a frame turned differently, they are only a mean. The correlation between two halves of the tracks shows how much
    of the picture's turns is not noise.
    """
    scale = np.array([1, 1, _HALF / alignment.focal_px])
    gyro = GyroTurns(log, alignment)
    halves, logged = [], []
    for pair in pairs:
        tracks = pair.tracks
        still = gyro.without(tracks, pair.begin_s, pair.end_s)
        predicted = replace(tracks, end=tracks.start + tracks.end - still.end)
        odd = np.arange(len(tracks)) % 2 > 0
        parts = (tracks.only(odd), tracks.only(~odd), predicted)
        one, other, by_log = (turns(replace(pair, tracks=part), alignment.focal_px)[:3] * scale for part in parts)
        halves.append((one, other))
        logged.append(by_log)
    seen, turned = np.array(halves), np.array(logged)
    seen, turned = seen - seen.mean(axis=0), turned - turned.mean(axis=0)
    size = float(np.sqrt((turned**2).sum(axis=1).mean()))
    changes = np.diff(seen, axis=0), np.diff(turned, axis=0)
    return min(_correlation(seen, turned), _correlation(*changes)), size


def _correlation(seen: np.ndarray, turned: np.ndarray) -> float:
    """Correlates both halves [n, 2, 3] of the seen turns with the logged turns [n, 3]; 1 if there is only noise."""
    signal, logged = (seen[:, 0] * seen[:, 1]).sum(), (turned**2).sum()
    if logged < len(turned) * _LEAST_PX**2:
        return 1.0
    together = (seen.mean(axis=1) * turned).sum()
    return float(min(together / np.sqrt(max(signal, _NO_SIGNAL * logged) * logged), 1.0))


# ---- search over offsets and orientations of the axes -----------------------------------------------------------


def _ways() -> np.ndarray:
    """Returns all rotations that map axes to axes [24, 3, 3]."""
    ways = []
    for order in permutations(range(3)):
        for signs in np.ndindex(2, 2, 2):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = 1 - 2 * np.array(signs)
            if np.linalg.det(matrix) > 0:
                ways.append(matrix)
    return np.array(ways)


def turns(pair: Pair, focal_px: float) -> Float64[np.ndarray, "4"]:
    """Fits turns about three axes and growth to a pair of frames [px of ROWS rows: angle times focal length]."""
    unit = ROWS / pair.tracks.height
    start, end = (pair.tracks.start + 0.5) * unit, (pair.tracks.end + 0.5) * unit
    jacobian = turn_jacobian((start + end) / 2, pair.tracks.width * unit, focal_px).reshape(-1, 4)
    moved = (end - start).ravel()
    weights = np.ones(len(moved))
    answer = np.zeros(4)
    for _ in range(4):
        answer = np.linalg.lstsq(jacobian * weights[:, None], moved * weights, rcond=None)[0]
        off = np.abs(moved - jacobian @ answer)
        weights = 1 / np.sqrt(1 + (off / (2 * np.median(off) + 1e-3)) ** 2)
    return answer


def _coarse(
    log: GyroLog, pairs: Sequence[Pair], lags: np.ndarray, focal_px: float
) -> list[tuple[np.ndarray, float, float]]:
    """Finds axes, offset [s] and focal length [px of ROWS rows] at which frames and log agree best, and rivals.

    Args:
        log: the log.
        pairs: tracks between frames.
        lags: offsets to try [s].
        focal_px: expected focal length [px of ROWS rows].
    """
    seen = np.array([turns(pair, focal_px)[:3] for pair in pairs]) * [1, 1, _HALF / focal_px]
    seen -= seen.mean(axis=0)
    begin, end = (np.array([getattr(pair, name) for pair in pairs]) for name in ("begin_s", "end_s"))
    cross, energy = np.zeros((len(lags), 3, 3)), np.zeros((len(lags), 3))
    for k in range(0, len(lags), _LAGS_AT_ONCE):
        part = slice(k, k + _LAGS_AT_ONCE)
        turned = log.angles(end + lags[part, None]) - log.angles(begin + lags[part, None])  # [lags, pairs, 3]
        turned -= turned.mean(axis=1, keepdims=True)
        cross[part] = -np.einsum("ki,lkj->lij", seen, turned)
        energy[part] = (turned**2).sum(axis=1)
    ways = _ways()
    along, power = np.einsum("lij,wij->lwi", cross, ways), np.einsum("lj,wij->lwi", energy, np.abs(ways))
    sideways, width = along[..., 0] + along[..., 1], power[..., 0] + power[..., 1]
    focal = np.clip(sideways / (width + 1e-12), _FOCALS[0] * focal_px, _FOCALS[1] * focal_px)
    cost = (seen**2).sum() + focal**2 * width - 2 * focal * sideways
    cost += _HALF**2 * power[..., 2] - 2 * _HALF * along[..., 2]
    best, found = cost.min(), []
    while len(found) < _CANDIDATES and cost.min() <= _RIVAL * best:
        lag, way = np.unravel_index(cost.argmin(), cost.shape)
        found.append((ways[way], float(lags[lag]), float(focal[lag, way])))
        cost[np.abs(lags - lags[lag]) < _CLOSE * float(np.median(end - begin))] = np.inf
    return found
