"""The gyro log of a clip: found in its file or next to it, aligned with the picture, and used if they agree.

To align them, the rotation of every pair of frames is compared with the log at each offset and in each of the 24
possible orientations of the axes; then all unknowns are adjusted together (synchronisation.py). If the clip was
stabilised by the camera, or the log belongs to another clip, the rotations do not follow the log's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations

import numpy as np

from unshutter.errors import UsageError
from unshutter.frames.camera import ROWS, track_jacobian
from unshutter.frames.self_calibration import usual_focal
from unshutter.frames.tracks import GUESSED_RATIO
from unshutter.motion.robust import falling_weights
from unshutter.motion.shapes import Float64
from unshutter.options.clip_options import GYRO_OFF
from unshutter.progress import Count, uncounted
from unshutter.readout_time import ReadoutRatio, ReadoutSource, ReadoutTime
from unshutter.reasons import Code, JsonObject, Reason
from unshutter.video.calibrate.sampled_frames import SampledFrames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.gpmf import DamagedLogError
from unshutter.video.file.stages import Stage
from unshutter.video.gyro.gyro_log import Alignment, GyroLog, Pair, can_parse, log_of_camera, log_of_file
from unshutter.video.gyro.synchronisation import Adjusted, Adjustment, GyroRotations, has_gravity

MOST_PARTS, PART = 14, 31  # number of parts of a clip that are compared with the log, and frames in each
_MIN_PAIRS = 15  # pairs of frames with usable tracks
_LEAST_TRACKS = 12  # of a pair
_MISSING_S = 0.25  # at either end of a clip that a log may omit
_BEYOND_S = 10.0  # of a log kept at either end of a clip
_SAME_CLOCK_S = 0.6  # largest offset between the clocks of a log and a clip in one file
_LOG_TRACKS = ("Timed Metadata Media Handler", "DJI meta", "CAM meta", "CameraMetadataMotionHandler")


@dataclass(frozen=True)
class ClipGyro:
    """A clip's gyro log and the result of comparing it with the clip."""

    origin: str  # where the log comes from
    synchronisation: Synchronisation | None  # how the log is aligned with the clip; None if they could not be compared
    rotations: GyroRotations | None  # the camera's rotation; None if the log is not used
    reason: Reason | None  # why the log is not used; None if it is
    stated: ReadoutTime | None = None  # readout time stated in the log; None if it states none, or none is needed

    @property
    def stabilised(self) -> Reason | None:
        """The reason why the clip's rows must have been moved after they were read out; None if there is none."""
        return self.reason if self.reason is not None and self.reason.code is Code.GYRO_DISAGREES else None

    @property
    def readout_time(self) -> ReadoutTime | None:
        """The readout time revealed by the clip and its log; None if they do not reveal it."""
        if self.synchronisation is None or self.reason is not None:
            return None
        if self.stated is not None:
            return self.stated
        if not self.synchronisation.shows_ratio:
            return None
        alignment = self.synchronisation.alignment
        error = self.synchronisation.adjusted.ratio_error
        ratio = ReadoutRatio(float(np.clip(alignment.ratio, 0, 1)), error, ReadoutSource.GYRO)
        return ratio.seconds(alignment.interval_s)

    def as_json(self) -> JsonObject:
        """Returns the record for a log of runs."""
        record: JsonObject = {"origin": self.origin, "used": self.reason is None}
        if self.reason is not None:
            record["declined"] = self.reason.as_json()
        if self.synchronisation is not None:
            alignment = self.synchronisation.alignment
            follows = self.synchronisation.follows
            record |= {"offset_s": alignment.offset_s, "drift": alignment.drift}
            record |= {"focal_heights": alignment.focal_px / ROWS, "correlation": follows}
        return record


def log_of_clip(request: ClipRequest) -> GyroLog | ClipGyro | None:
    """Reads the gyro log of a clip; returns why it cannot be used if so, or None if there is none."""
    clip = request.clip
    choice = request.options.shutter.gyro
    if choice == GYRO_OFF:
        return None
    if choice is not None:
        return log_of_file(choice)
    try:
        log = log_of_camera(clip.path) if clip.may_have_log else None
    except DamagedLogError:
        return ClipGyro("GoPro", None, None, Reason(Code.GYRO_DAMAGED))
    if log is None and not can_parse():
        name = next((name for name in clip.data_tracks if name.startswith(_LOG_TRACKS)), None)
        return None if name is None else ClipGyro(name, None, None, Reason(Code.GYRO_UNREAD))
    return log


def gyro_in_survey(
    request: ClipRequest, evidence: SampledFrames, log: GyroLog, known: ReadoutTime | None = None
) -> ClipGyro:
    """Returns the gyro log of a clip, synchronised with its tracked frames.

    Args:
        known: readout time of the camera, if it is known.
    """
    clip = request.clip
    span = _span(request)
    offsets = _offsets(log, span)
    if not offsets:
        return ClipGyro(log.origin, None, None, Reason(Code.GYRO_TOO_SHORT))
    stated = log.readout_time if known is None else None
    known = known or stated
    ratio = known and known.ratio(clip.interval_s).value
    pairs = list(_pairs(evidence))
    if len(pairs) < _MIN_PAIRS:
        return ClipGyro(log.origin, None, None, Reason(Code.TOO_LITTLE_TO_FOLLOW))
    focal_px = request.focal and request.focal * ROWS
    request.work.expect({Stage.SURVEY: 0, Stage.ALIGN: _PARAMS.rounds * len(pairs)})
    count = request.work.counts(Stage.ALIGN)
    synchronisation = synchronised(log, pairs, clip.interval_s, offsets, ratio, focal_px, count)
    request.work.expect({Stage.ALIGN: 0})
    reason = synchronisation.reason
    begin_s, end_s = map(float, synchronisation.alignment.log_time(np.array(span), np.array([0.0, 1.0])))
    if reason is None and not _covers(log, begin_s, end_s):
        reason = Reason(Code.GYRO_TOO_SHORT)
    part = log.between(begin_s - _BEYOND_S, end_s + _BEYOND_S)
    rotations = GyroRotations(part, synchronisation.alignment) if reason is None else None
    return ClipGyro(log.origin, synchronisation, rotations, reason, stated)


def check_level(log: GyroLog | ClipGyro | None) -> None:
    """Raises UsageError if a clip's gyro log, read by :func:`log_of_clip`, does not tell which way is up."""
    if isinstance(log, GyroLog):
        _check_gravity(log)
    else:
        level_rotations(log)


def _check_gravity(log: GyroLog) -> None:
    if not has_gravity(log):
        raise UsageError(
            f"{{--level}} needs acceleration, which the gyro log ({log.origin}) does not have: leave it out"
        )


def level_rotations(gyro: ClipGyro | None) -> GyroRotations:
    """Returns the rotations by a clip's gyro log, with which it is kept level; raises UsageError without any."""
    if gyro is None:
        raise UsageError(
            "{--level} needs a gyro log with acceleration, and the clip has no log: name one with {--gyro}"
        )
    if gyro.rotations is None:
        cause = f"which cannot be used: {gyro.reason}"
        raise UsageError(f"{{--level}} needs the clip's gyro log ({gyro.origin}), {cause}; leave out {{--level}}")
    _check_gravity(gyro.rotations.log)
    return gyro.rotations


def _span(request: ClipRequest) -> tuple[float, float]:
    return request.span[0], min(request.span[1], request.clip.duration_s or np.inf)


def _offsets(log: GyroLog, span: tuple[float, float]) -> list[tuple[float, float]]:
    """Returns ranges of possible offsets of the log's clock; none if the log has no stretch as long as the clip."""
    if log.on_clip_clock:
        return [(-_SAME_CLOCK_S, _SAME_CLOCK_S)]
    ranges = [(begin - span[0] - _MISSING_S, end - span[1] + _MISSING_S) for begin, end in log.stretches if begin < end]
    return [(least, greatest) for least, greatest in ranges if least < greatest]


def _covers(log: GyroLog, begin_s: float, end_s: float) -> bool:
    first = max(begin_s, log.span_s[0])
    last = min(end_s, log.span_s[1])
    return first - begin_s < _MISSING_S and end_s - last < _MISSING_S and log.covers(first, last)


# ---- parts to compare ------------------------------------------------------------------------------------------


def lively_parts(request: ClipRequest, log: GyroLog) -> list[float] | None:
    """Returns the start times of the parts of a clip to be compared with its log [s]; None: the whole clip.

    They are spread over the clip, each where the camera turned most in its neighbourhood, if that is known.
    """
    span = _span(request)
    length = PART * request.clip.interval_s
    if span[1] - span[0] <= MOST_PARTS * length:
        return None
    parts = []
    for first in np.linspace(span[0], span[1] - length, MOST_PARTS + 1)[:-1]:
        room = (span[1] - span[0] - length) / MOST_PARTS - length
        starts = first + np.arange(0, max(room, 0) + 1e-9, length / 2)
        busy = [_liveliness(log, start, length) for start in starts] if log.on_clip_clock else [0.0]
        parts.append(float(starts[int(np.argmax(busy))]))
    return parts


def _liveliness(log: GyroLog, begin_s: float, length_s: float) -> float:
    """Returns how much the angular velocity varies on time scales of a frame and longer [rad/s]."""
    angles = log.angles(np.linspace(begin_s, begin_s + length_s, PART))
    return float(np.diff(angles, axis=0).std(axis=0).sum() * PART / length_s)


def _pairs(evidence: SampledFrames) -> Iterator[Pair]:
    """Yields the tracks between consecutive frames, of so many at most."""
    few = sum(map(len, evidence.parts)) <= MOST_PARTS * PART
    for run in evidence.parts if few else evidence.runs(MOST_PARTS, PART):
        for before, frame in pairwise(run):
            plane = frame.background
            if plane is not None and frame.since is not None and plane.joined and len(plane.tracks) >= _LEAST_TRACKS:
                yield Pair(plane.tracks, before.time_s, frame.time_s)


# ---- the log's alignment with the clip -------------------------------------------------------------------------

_HALF = ROWS / 2  # px: a turn about the viewing axis moves the picture's edge by this times the angle


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


_PARAMS = AlignmentParams()


@dataclass(frozen=True)
class Synchronisation:
    """Alignment of a log with a clip, and how well the clip follows the log."""

    adjusted: Adjusted  # the alignment with its errors
    # correlation of the rotations of frames with the log's; of the rotations or of their changes, whichever is less
    follows: float
    rotations_px: float  # size of the rotations between frames in the log, without the constant part [px of ROWS rows]
    ratio_known: bool  # whether the readout ratio was known beforehand

    @property
    def alignment(self) -> Alignment:
        """The adjusted alignment, without its errors."""
        return self.adjusted.alignment

    @property
    def reason(self) -> Reason | None:
        """The reason why the log must not be used; None if the clip follows it."""
        if self.rotations_px < _PARAMS.least_px:
            return Reason(Code.GYRO_TOO_CALM)
        if self.follows < _PARAMS.follows:
            return Reason.of(Code.GYRO_DISAGREES, correlation=max(self.follows, 0.0))
        return None

    @property
    def shows_ratio(self) -> bool:
        """Whether the clip and its log determine the readout ratio."""
        shortest, longest = _PARAMS.ratios
        possible = shortest < self.alignment.ratio < longest
        return (
            not self.ratio_known and self.reason is None and possible and self.adjusted.ratio_error < _PARAMS.sure_ratio
        )


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
    lags = sum(last - first for first, last in offsets_s) / _PARAMS.lag_s
    lag_s = _PARAMS.lag_s if lags < _PARAMS.many_lags else _PARAMS.long_lag_s
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
    ends = min(pair.begin_s for pair in pairs) - _PARAMS.margin_s, max(pair.end_s for pair in pairs) + _PARAMS.margin_s
    solved = []
    for start in starts:
        part = log.between(start.offset_s + ends[0], start.offset_s + ends[1])
        adjustment = Adjustment(part, pairs, usual, focal_known=focal_px is not None, ratio_known=ratio is not None)
        solved.append((adjustment.solve(start, count), part))
    (adjusted, part), *rivals = solved
    for rival, beside in rivals:
        adjusted, part = (rival, beside) if rival.noise_px < _PARAMS.better * adjusted.noise_px else (adjusted, part)
    follows, rotations_px = _agreement(part, pairs, adjusted.alignment)
    return Synchronisation(adjusted, follows, rotations_px, ratio is not None)


def _agreement(log: GyroLog, pairs: Sequence[Pair], alignment: Alignment) -> tuple[float, float]:
    """Correlates frames' rotations with the log's (see :class:`Synchronisation`); also returns the size of the latter.

    The rotations are those shown by the tracks, and those that the tracks would show according to the log: if every row
    of a frame turned differently, they are only a mean. The correlation between two halves of the tracks shows how much
    of the picture's rotations is not noise.
    """
    scale = np.array([1, 1, _HALF / alignment.focal_px])
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
    if logged < len(rotated) * _PARAMS.least_px**2:
        return 1.0
    together = (seen.mean(axis=1) * rotated).sum()
    return float(min(together / np.sqrt(max(signal, _PARAMS.no_signal * logged) * logged), 1.0))


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
    seen = np.array([frame_rotations(pair, focal_px)[:3] for pair in pairs]) * [1, 1, _HALF / focal_px]
    seen -= seen.mean(axis=0)
    begin, end = (np.array([getattr(pair, name) for pair in pairs]) for name in ("begin_s", "end_s"))
    ways = _ways()
    tried = []
    for first, last in offsets_s:
        for start in np.arange(first, last + lag_s, _PARAMS.lags_at_once * lag_s):
            lags = np.arange(start, min(start + (_PARAMS.lags_at_once - 0.5) * lag_s, last + lag_s), lag_s)
            sums = _sums(log, seen, begin, end, lags[0], lag_s / _PARAMS.finer, len(lags) * _PARAMS.finer)
            cross, energy = (each[:: _PARAMS.finer] for each in sums)
            along = np.einsum("lij,wij->lwi", cross, ways)
            power = np.einsum("lj,wij->lwi", energy, np.abs(ways))
            sideways = along[..., 0] + along[..., 1]
            width = power[..., 0] + power[..., 1]
            focal = np.clip(sideways / (width + 1e-12), _PARAMS.focals[0] * focal_px, _PARAMS.focals[1] * focal_px)
            cost = (seen**2).sum() + focal**2 * width - 2 * focal * sideways
            cost += _HALF**2 * power[..., 2] - 2 * _HALF * along[..., 2]
            best = np.arange(len(lags)), cost.argmin(axis=1)
            tried.append((lags, cost[best], best[1], focal[best]))
    lags, cost, way, focal = (np.concatenate(each) for each in zip(*tried, strict=True))
    most = cost.min() + (_PARAMS.rival - 1) * abs(cost.min())
    found = []
    while len(found) < _PARAMS.candidates and cost.min() <= most:
        k = cost.argmin()
        found.append((ways[way[k]], float(lags[k]), float(focal[k])))
        cost[np.abs(lags - lags[k]) < _PARAMS.close * float(np.median(end - begin))] = np.inf
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
