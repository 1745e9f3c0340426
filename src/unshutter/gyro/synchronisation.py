"""From a gyro log and tracks of a clip to their alignment, and whether the picture follows the log at all.

First the turn of every pair of frames is compared with the log at each offset and in each of the 24 ways in which axes
can lie; then all unknowns are adjusted together (adjustment.py). A clip that its camera stabilised, or a log of another
clip, shows by turns that do not follow the log's.
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

_HALF = ROWS / 2  # px: a turn about the view's axis moves the picture's edge by so much times the angle
_USUAL = 0.85  # focal length to expect, of width + height
_FOCALS = (0.25, 6.0)  # of the usual one: shortest and longest
_GUESSED_RATIO = 0.5
_LAG_S, _LONG_LAG_S, _MANY_LAGS = 0.004, 0.008, 20_000  # between offsets that are tried; where they are more
_LAGS_AT_ONCE = 512
_FOLLOWS = 0.84  # least correlation. Measured: real clips 0.97 and more, stabilised ones up to 0.5 (0.83 where hardly)
_LEAST_PX = 0.1  # px of ROWS rows: frames that turn by less from one to the next do not tell a log's offset
_NO_SIGNAL = 0.01  # share of the log's turns: less is none
_CANDIDATES, _CLOSE, _RIVAL = 3, 0.3, 1.1  # offsets that are adjusted; how far apart, and by how much worse at first
_BETTER = 0.95  # of the first one's noise: what a rival must reach
_SURE_RATIO, _RATIOS = 0.02, (0.02, 1.03)  # error of a ratio that is believed, and what can be one


@dataclass(frozen=True)
class Synchronisation:
    """How a log belongs to a clip, and how well the clip follows it.

    Attributes:
        adjusted: the alignment with its errors.
        follows: correlation of the turns of frames with the log's; of the turns, or of their changes, if that is less.
        turns_px: by how much the log turns frames on, without what is constant [px of ROWS rows].
        ratio_known: whether the readout ratio was known before.
    """

    adjusted: Adjusted
    follows: float
    turns_px: float
    ratio_known: bool

    @property
    def alignment(self) -> Alignment:
        """The alignment."""
        return self.adjusted.alignment

    @property
    def reason(self) -> Reason | None:
        """Why the log must be left alone; None where the clip follows it."""
        if self.turns_px < _LEAST_PX:
            return Reason(Code.GYRO_TOO_CALM)
        if self.follows < _FOLLOWS:
            return Reason.of(Code.GYRO_DISAGREES, correlation=max(self.follows, 0.0))
        return None

    @property
    def shows_ratio(self) -> bool:
        """Whether the clip and its log tell the readout ratio."""
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
    """How a log belongs to a clip.

    Args:
        log: the log.
        pairs: tracks between frames of the clip, of one size, some of them not empty.
        interval_s: usual time from one frame to the next [s].
        offsets_s: least and greatest offset of the log's clock that may be [s].
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
    """Correlation of the turns of frames with the log's (see :class:`Synchronisation`), and how large these are.

    The turns are those that tracks show, and that they would show by the log: of frames of which every row has turned
    in its own way, they are only a mean. Two halves of the tracks show by what they have in common how much of the
    picture's turns is not noise.
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
    """Of what both halves [n, 2, 3] see with what turned [n, 3]; 1 where there is nothing but noise to see."""
    signal, logged = (seen[:, 0] * seen[:, 1]).sum(), (turned**2).sum()
    if logged < len(turned) * _LEAST_PX**2:
        return 1.0
    together = (seen.mean(axis=1) * turned).sum()
    return float(min(together / np.sqrt(max(signal, _NO_SIGNAL * logged) * logged), 1.0))


# ---- every offset, every way in which axes can lie -------------------------------------------------------------


def _ways() -> np.ndarray:
    """[24, 3, 3] all rotations that take axes to axes."""
    ways = []
    for order in permutations(range(3)):
        for signs in np.ndindex(2, 2, 2):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = 1 - 2 * np.array(signs)
            if np.linalg.det(matrix) > 0:
                ways.append(matrix)
    return np.array(ways)


def turns(pair: Pair, focal_px: float) -> Float64[np.ndarray, "4"]:
    """Turn about three axes and growth of a pair of frames [px of ROWS rows: angle times focal length]."""
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
    """Axes, offset [s] and focal length [px of ROWS rows] at which turns of frames and log agree best, and rivals.

    Args:
        log: the log.
        pairs: tracks between frames.
        lags: offsets to try [s].
        focal_px: focal length to expect [px of ROWS rows].
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
