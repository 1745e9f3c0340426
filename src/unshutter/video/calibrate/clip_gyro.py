"""The gyro log of a clip: read from its file or from a named one, aligned with the picture, and used if they agree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from unshutter.errors import UsageError
from unshutter.frames.camera import ROWS
from unshutter.options.clip_options import GYRO_OFF
from unshutter.readout_time import ReadoutRatio, ReadoutSource, ReadoutTime
from unshutter.reasons import Code, JsonObject, Reason
from unshutter.video.calibrate.sampled_frames import SampledFrames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.gpmf import DamagedLogError
from unshutter.video.file.stages import Stage
from unshutter.video.gyro.alignment import PARAMS, Synchronisation, synchronised
from unshutter.video.gyro.gyro_log import GyroLog, Pair, can_parse, log_of_camera, log_of_file
from unshutter.video.gyro.synchronisation import GyroRotations, has_gravity

MOST_PARTS, PART = 14, 31  # number of parts of a clip that are compared with the log, and frames in each
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
        """The readout time that the clip and its log show; None if they do not."""
        if self.synchronisation is None or self.reason is not None:
            return None
        if self.stated is not None:
            return self.stated
        if not self.synchronisation.shows_ratio:
            return None
        alignment = self.synchronisation.alignment
        error = self.synchronisation.ratio_error
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
    """Reads the gyro log of a clip; returns a reason if it cannot be used, None if there is none."""
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


def gyro_in_frames(
    request: ClipRequest, sampled: SampledFrames, log: GyroLog, known: ReadoutTime | None = None
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
    ratio = known and known.ratio(clip.camera_interval_s).value
    pairs = list(_pairs(sampled))
    if len(pairs) < 15:
        return ClipGyro(log.origin, None, None, Reason(Code.TOO_LITTLE_TO_FOLLOW))
    focal_px = request.focal and request.focal * ROWS
    request.work.expect({Stage.SURVEY: 0, Stage.ALIGN: PARAMS.rounds * len(pairs)})
    count = request.work.counts(Stage.ALIGN)
    synchronisation = synchronised(log, pairs, clip.camera_interval_s, offsets, ratio, focal_px, count)
    request.work.expect({Stage.ALIGN: 0})
    reason = synchronisation.reason
    begin_s, end_s = map(float, synchronisation.alignment.log_time(np.array(span), np.array([0.0, 1.0])))
    if reason is None:
        first, last = max(begin_s, log.span_s[0]), min(end_s, log.span_s[1])
        if first - begin_s >= _MISSING_S or end_s - last >= _MISSING_S or not log.covers(first, last):
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
    """Returns begin and end of the selected part on the camera's clock [s]."""
    slowed = request.clip.clock.slowed
    return request.span[0] / slowed, min(request.span[1], request.clip.duration_s or np.inf) / slowed


def _offsets(log: GyroLog, span: tuple[float, float]) -> list[tuple[float, float]]:
    """Returns ranges of possible offsets of the log's clock; none if the log has no stretch as long as the clip."""
    if log.on_clip_clock:
        return [(-_SAME_CLOCK_S, _SAME_CLOCK_S)]
    ranges = [(begin - span[0] - _MISSING_S, end - span[1] + _MISSING_S) for begin, end in log.stretches if begin < end]
    return [(least, greatest) for least, greatest in ranges if least < greatest]


# ---- parts to compare ------------------------------------------------------------------------------------------


def lively_parts(request: ClipRequest, log: GyroLog) -> list[float] | None:
    """Returns the start times [s] of the parts of a clip that are compared with its log; None for the whole clip.

    They are spread over the clip, each where the camera turned most in its neighbourhood, if that is known.
    """
    span = _span(request)
    slowed = request.clip.clock.slowed
    length = PART * request.clip.camera_step_s / slowed
    if span[1] - span[0] <= MOST_PARTS * length:
        return None
    parts = []
    for first in np.linspace(span[0], span[1] - length, MOST_PARTS + 1)[:-1]:
        room = (span[1] - span[0] - length) / MOST_PARTS - length
        starts = first + np.arange(0, max(room, 0) + 1e-9, length / 2)
        busy = [_liveliness(log, start, length) for start in starts] if log.on_clip_clock else [0.0]
        parts.append(float(starts[int(np.argmax(busy))]) * slowed)
    return parts


def _liveliness(log: GyroLog, begin_s: float, length_s: float) -> float:
    """Returns how much the angular velocity varies on time scales of a frame and longer [rad/s]."""
    angles = log.angles(np.linspace(begin_s, begin_s + length_s, PART))
    return float(np.diff(angles, axis=0).std(axis=0).sum() * PART / length_s)


def _pairs(sampled: SampledFrames) -> Iterator[Pair]:
    """Yields the tracks between consecutive frames, of so many at most."""
    few = sum(map(len, sampled.parts)) <= MOST_PARTS * PART
    for run in sampled.parts if few else sampled.runs(MOST_PARTS, PART):
        for before, frame in pairwise(run):
            plane = frame.background
            if plane is not None and frame.since is not None and plane.joined and len(plane.tracks) >= 12:
                yield Pair(plane.tracks, before.time_s, frame.time_s)
