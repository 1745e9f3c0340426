"""The gyro log of a clip: found in its file or next to it, compared with the picture, and used if they agree."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from unshutter.frames.camera import ROWS
from unshutter.frames.self_calibration import ReadoutRatio
from unshutter.frames.sequence import CameraMotion
from unshutter.frames.tracks import TRACKED_SIDE, background, follow
from unshutter.geometry.readout import Readout
from unshutter.gyro.alignment import Pair
from unshutter.gyro.log import GyroLog
from unshutter.gyro.reading import log_by_parser, log_of_file
from unshutter.gyro.rows import GyroTurns
from unshutter.gyro.synchronisation import Synchronisation, synchronised
from unshutter.progress import Steps, Watch
from unshutter.reasons import Code, Reason
from unshutter.video.clip import Clip
from unshutter.video.moving_frames import look
from unshutter.video.options import GYRO_OFF, Shutter
from unshutter.video.pipeline import ahead
from unshutter.video.readout_tags import readout_tag

_PARTS, _PART = 14, 31  # number of parts of a clip that are compared with the log, and frames in each
_FEWEST = 15  # pairs of frames with usable tracks
_LEAST_TRACKS = 12  # of a pair
_MISSING_S = 0.25  # at either end of a clip that a log may omit
_SAME_CLOCK_S = 0.6  # largest offset between the clocks of a log and a clip in one file
_INSTA360 = b"8db42d694ccc418790edff439fe026bf"  # last bytes of Insta360's files, which have their log at the end


@dataclass(frozen=True)
class ClipGyro:
    """A clip's gyro log and the result of comparing it with the clip.

    Attributes:
        origin: where the log comes from.
        synchronisation: how the log is aligned with the clip; None if they could not be compared.
        turns: the camera's rotation; None if the log is not used.
        reason: why the log is not used; None if it is.
        stated_ratio: readout time stated in the log [frame intervals]; None if it states none.
    """

    origin: str
    synchronisation: Synchronisation | None
    turns: GyroTurns | None
    reason: Reason | None
    stated_ratio: float | None = None

    @property
    def ratio(self) -> ReadoutRatio | None:
        """The readout ratio revealed by the clip and its log; None if they do not reveal it."""
        if self.synchronisation is None or self.reason is not None:
            return None
        if self.stated_ratio is not None:
            return ReadoutRatio(self.stated_ratio, 0.0, "gyro log", self.origin)
        if not self.synchronisation.shows_ratio:
            return None
        alignment, error = self.synchronisation.alignment, self.synchronisation.adjusted.ratio_error
        return ReadoutRatio(float(np.clip(alignment.ratio, 0, 1)), error, "gyro")

    def with_ratio(self, ratio: float) -> ClipGyro:
        """Returns the log with a readout ratio from another source; the time of the middle row does not change."""
        if self.turns is None:
            return self
        return replace(self, turns=replace(self.turns, alignment=replace(self.turns.alignment, ratio=ratio)))

    def as_json(self) -> dict[str, Any]:
        """Returns the record for a log of runs."""
        record: dict[str, Any] = {"origin": self.origin, "used": self.reason is None}
        if self.reason is not None:
            record["declined"] = self.reason.as_json()
        if self.synchronisation is not None:
            alignment = self.synchronisation.alignment
            record |= {
                "offset_s": alignment.offset_s,
                "drift": alignment.drift,
                "focal_heights": alignment.focal_px / ROWS,
                "correlation": self.synchronisation.follows,
            }
        return record


def gyro_of_clip(
    clip: Clip,
    readout: Readout,
    shutter: Shutter,
    span: tuple[float, float],
    ratio: float | None = None,
    watch: Watch | None = None,
) -> ClipGyro | None:
    """Returns the gyro log of a clip, synchronised with it, or None if it has none.

    Args:
        clip: the clip.
        readout: direction in which the stored pixels were read.
        shutter: what the user states about the camera, and the log's file.
        span: the selected part of the clip [s].
        ratio: readout time in frame intervals, if known.
        watch: called for every part of the clip that is examined.

    Raises:
        UnshutterError: the clip, or the log that the user names, cannot be read.
    """
    log = _log(clip, shutter.gyro)
    if log is None:
        return None
    span = span[0], min(span[1], clip.duration_s) if clip.duration_s else span[1]
    offsets = _offsets(log, span)
    if offsets is None:
        return ClipGyro(log.origin, None, None, Reason(Code.GYRO_TOO_SHORT))
    stated = None
    if ratio is None:
        tag = None if clip.of_pictures else readout_tag(clip.path)
        stated_ms = log.readout_ms if tag is None else tag.ms
        ratio = None if stated_ms is None else min(stated_ms / 1000 / clip.interval_s, 1.0)
        stated = ratio if tag is None else None
    pairs = list(_pairs(clip, readout, _parts(clip, log, span), watch))
    if len(pairs) < _FEWEST:
        return ClipGyro(log.origin, None, None, Reason(Code.TOO_LITTLE_TO_FOLLOW))
    height = readout.frame_size(clip.height, clip.width)[0]
    focal_px = None if shutter.focal_px is None else shutter.focal_px * ROWS / height
    synchronisation = synchronised(log, pairs, clip.interval_s, offsets, ratio, focal_px)
    reason = synchronisation.reason
    if reason is None and not _covers(log, synchronisation, span):
        reason = Reason(Code.GYRO_TOO_SHORT)
    turns = GyroTurns(log, synchronisation.alignment) if reason is None else None
    return ClipGyro(log.origin, synchronisation, turns, reason, stated)


def _log(clip: Clip, choice: str | None) -> GyroLog | None:
    """Returns the log that the user names, or otherwise the one in the clip's file."""
    if choice == GYRO_OFF:
        return None
    if choice is not None:
        return log_of_file(choice)
    return log_by_parser(clip.path) if not clip.of_pictures and _may_have_log(clip) else None


def _may_have_log(clip: Clip) -> bool:
    """Whether a film's file has a data track, or a maker's data at its end; other files are not searched."""
    with suppress(OSError), open(clip.path, "rb") as stream:
        stream.seek(-len(_INSTA360), 2)
        if stream.read() == _INSTA360:
            return True
    with clip.opened() as container:
        return bool(container.streams.data)


def _offsets(log: GyroLog, span: tuple[float, float]) -> tuple[float, float] | None:
    """Returns the least and greatest offset of the log's clock, or None if the log is shorter than the clip."""
    if log.on_clip_clock:
        return -_SAME_CLOCK_S, _SAME_CLOCK_S
    least, greatest = log.span_s[0] - span[0] - _MISSING_S, log.span_s[1] - span[1] + _MISSING_S
    return (least, greatest) if least < greatest else None


def _covers(log: GyroLog, synchronisation: Synchronisation, span: tuple[float, float]) -> bool:
    ends = synchronisation.alignment.log_time(np.array(span), np.array([0.0, 1.0]))
    begin_s, end_s = log.span_s
    inside = max(float(ends[0]), begin_s), min(float(ends[1]), end_s)
    return inside[0] - ends[0] < _MISSING_S and ends[1] - inside[1] < _MISSING_S and log.covers(*inside)


# ---- parts to compare ------------------------------------------------------------------------------------------


def _parts(clip: Clip, log: GyroLog, span: tuple[float, float]) -> list[float]:
    """Returns the start times of the parts of the clip that are compared with the log [s].

    They are spread over the clip, each where the camera turned most in its neighbourhood, if that is known.
    """
    length = _PART * clip.interval_s
    if span[1] - span[0] <= _PARTS * length:
        return list(np.arange(span[0], max(span[1] - length / 2, span[0] + length / 2), length))
    parts = []
    for first in np.linspace(span[0], span[1] - length, _PARTS + 1)[:-1]:
        room = (span[1] - span[0] - length) / _PARTS - length
        starts = first + np.arange(0, max(room, 0) + 1e-9, length / 2)
        busy = [_liveliness(log, start, length) for start in starts] if log.on_clip_clock else [0.0]
        parts.append(float(starts[int(np.argmax(busy))]))
    return parts


def _liveliness(log: GyroLog, begin_s: float, length_s: float) -> float:
    """Returns how much the angular velocity varies on time scales of a frame and longer [rad/s]."""
    angles = log.angles(np.linspace(begin_s, begin_s + length_s, _PART))
    return float(np.diff(angles, axis=0).std(axis=0).sum() * _PART / length_s)


def _pairs(clip: Clip, readout: Readout, starts: list[float], watch: Watch | None) -> Iterator[Pair]:
    """Yields the tracks between consecutive frames in parts of the clip."""
    camera, steps = CameraMotion(readout=readout), Steps("gyro", len(starts), watch)
    for start in starts:
        before = grey_before = None
        for frame in ahead(clip.iter_frames(start, start + (_PART - 0.5) * clip.interval_s), 3):
            grey = look(clip, frame, camera, 1.0, TRACKED_SIDE).grey
            if before is not None and grey_before is not None and clip.since(before, frame) is not None:
                tracked = background(follow(grey_before, grey))
                if tracked.joined and len(tracked.tracks) >= _LEAST_TRACKS:
                    yield Pair(tracked.tracks, before.time or 0.0, frame.time or 0.0)
            before, grey_before = frame, grey
        steps.advance()
