"""What is known of a clip's camera: readout time and direction, lens, and gyro log.

The readout time comes from the user, the clip's file, its gyro log, the table of cameras or the clip's frames, or else
a usual value is taken. A clip is never rejected because its readout time is unknown: the usual value comes with a
range, and if the frames cannot show a difference for any time in that range, nothing is changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.motion.lens import Lens
from unshutter.options import check_focal
from unshutter.progress import Steps
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video import cameras, clip_gyro, gain, lenses, readout
from unshutter.video.clip import ClipRequest
from unshutter.video.clip_gyro import ClipGyro, gyro_in_survey
from unshutter.video.gyro_log import GyroLog
from unshutter.video.lenses import lens_of_clip
from unshutter.video.readout import time_in_survey
from unshutter.video.survey import Survey, survey

_Parts = Sequence[tuple[float | None, float | None]]


@dataclass(frozen=True, eq=False)
class ClipCamera:
    """What is known of a clip's camera."""

    readout: ReadoutTime
    lens: Lens | None = None  # its lens, if it bends straight lines
    gyro: ClipGyro | None = None  # the clip's gyro log, and what it tells; None if there is none

    def as_json(self) -> dict[str, Any]:
        """Returns the readout time and the lens, ready for JSON, as read by :meth:`from_json`."""
        return {"readout": self.readout.as_json(), "lens": self.lens and self.lens.as_json()}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ClipCamera:
        """Reads the data written by :meth:`as_json`."""
        return cls(ReadoutTime.from_json(data["readout"]), data["lens"] and Lens.of_json(data["lens"]))


def find_camera(request: ClipRequest, found: ClipCamera | None = None) -> tuple[ClipCamera, Survey]:
    """Returns what the user, a clip's file and its frames tell of its camera, and the frames that were tracked for it.

    Args:
        found: what was found earlier in the same clip, except for its gyro log.
    """
    check_focal(request.options.shutter.focal_px, request.frame_size[0])
    log = clip_gyro.log_of_clip(request)
    if request.options.steadiness.level:
        clip_gyro.check_level(log)
    parts_s, what = parts_to_survey(request, log, found)
    steps = None
    if what == LENS:
        evidence = survey(request, _spread(request, [lenses.PART + 1])[:1])
        evidence = survey(request, parts_s) if lenses.may_bend_lines(evidence) else evidence
    else:
        rounds = 2 if what == SEARCH else 1  # tracking takes half of the time of a search
        steps = Steps(what, rounds * _frames_in(request, parts_s), request.observer.note_progress)
        evidence = survey(request, parts_s, steps)
    camera = camera_from(request, evidence, log, found, steps)
    return camera, evidence.through(camera.lens)


def camera_from(
    request: ClipRequest,
    evidence: Survey,
    log: GyroLog | ClipGyro | None = None,
    found: ClipCamera | None = None,
    steps: Steps | None = None,
) -> ClipCamera:
    """Returns what the user, a clip's file and its tracked frames tell of its camera.

    Args:
        log: the clip's gyro log, or why it cannot be used; None if there is none.
        found: what was found earlier in the same clip.
        steps: counts the parts that are searched for the readout time.
    """
    interval_s, stated = request.clip.interval_s, request.options.shutter.readout_time(request.clip.interval_s)
    lens = lens_of_clip(request, evidence) if found is None else found.lens
    request, evidence = replace(request, lens=lens), evidence.through(lens)
    tag = request.clip.camera.readout if stated is None else None
    gyro = gyro_in_survey(request, evidence, log, stated or tag) if isinstance(log, GyroLog) else log
    time = stated or (found and found.readout) or (gyro and gyro.readout_time)
    if time is None:
        time = _time_of(request, evidence, gyro, steps)
    if gyro is not None and gyro.turns is not None:  # the time of the middle row does not change
        alignment = replace(gyro.turns.alignment, ratio=time.ratio(interval_s).value)
        gyro = replace(gyro, turns=replace(gyro.turns, alignment=alignment))
    return ClipCamera(time, lens, gyro)


def _time_of(request: ClipRequest, evidence: Survey, gyro: ClipGyro | None, steps: Steps | None) -> ReadoutTime:
    """Returns the readout time that a clip's file, its frames or the table of cameras tell, or else the usual one.

    The rows of a clip that was stabilised in the camera have moved: only its frames can tell their times.
    """
    clip = request.clip
    stabilised = None if gyro is None else gyro.stabilised
    if stabilised is None and (gyro is None or gyro.turns is None) and clip.camera.is_stabilised:
        stabilised = Reason(Code.STABILISED_IN_CAMERA)
    listed = _listed_time(request) if stabilised is None else None
    if listed is not None and listed.plausible_s is None:
        return listed
    try:
        return time_in_survey(request, evidence, steps)
    except UnknownRatioError as error:
        return replace(listed or usual_time(request), instead_of=error.reason, declined=stabilised)


def _listed_time(request: ClipRequest) -> ReadoutTime | None:
    """Returns the readout time that the clip's file states, or that is listed for its camera."""
    clip = request.clip
    mode = (clip.width, clip.height), 1 / clip.interval_s
    return clip.camera.readout or cameras.listed_time(clip.tags, request.options.shutter.camera, *mode)


def usual_time(request: ClipRequest) -> ReadoutTime:
    """Returns the readout time that is usual for cameras of the clip's kind, with its range."""
    return cameras.usual_time(request.clip.tags, request.clip.interval_s)


def time_without_search(request: ClipRequest) -> ReadoutTime:
    """Returns the readout time that the user states, or that is listed or usual for the camera."""
    interval_s = request.clip.interval_s
    return request.options.shutter.readout_time(interval_s) or _listed_time(request) or usual_time(request)


# ---- the parts of a clip that tell it ----------------------------------------------------------------------------

SEARCH, GYRO, GAIN, LENS = "readout time", "gyro", "looking", "lens"  # what parts are for


def parts_to_survey(
    request: ClipRequest, log: GyroLog | ClipGyro | None = None, found: ClipCamera | None = None
) -> tuple[_Parts, str]:
    """Returns begin and end of the parts of a clip that tell its camera and what undoing its motion gains [s]; and what
    they are for, at least: ``SEARCH``, ``GYRO``, ``GAIN`` or ``LENS``.
    """
    shutter, interval_s = request.options.shutter, request.clip.interval_s
    stated = shutter.readout_time(interval_s)
    if stated is None and found is None:
        listed = None if request.clip.camera.is_stabilised else _listed_time(request)
        if listed is None or listed.plausible_s is not None:
            return _spread(request, [readout.PART + 1] * readout.MOST_PARTS), SEARCH
    if isinstance(log, GyroLog):
        starts_s = clip_gyro.lively_parts(request, log)
        if starts_s is not None:
            return [(start, start + (clip_gyro.PART - 0.5) * interval_s) for start in starts_s], GYRO
        return [(request.options.start, request.options.end)], GYRO
    if stated is None and gain.is_tested(request.options):
        if _frames_in(request, [request.span]) <= gain.ALL:
            return [(request.options.start, request.options.end)], GAIN
        return _spread(request, [lenses.FIRST, *[gain.RUN] * (gain.RUNS - 1)]), GAIN
    if found is None and shutter.lens is None and shutter.focal_px is None:
        return _spread(request, [lenses.FIRST, *[lenses.PART] * lenses.FURTHER]), LENS
    return [], GAIN


def _spread(request: ClipRequest, frames: Sequence[int]) -> _Parts:
    """Returns parts of so many frames, spread evenly over what the user selected; all of it if that is hardly more."""
    (begin, end), interval_s = request.span, request.clip.interval_s
    if end - begin < 1.1 * sum(frames) * interval_s:
        return [(request.options.start, request.options.end)]
    starts = np.linspace(begin, end - 1.1 * frames[-1] * interval_s, len(frames)).tolist()
    return [(start, start + (many - 0.5) * interval_s) for start, many in zip(starts, frames, strict=True)]


def _frames_in(request: ClipRequest, parts_s: _Parts) -> int:
    """Returns about how many frames there are in some parts."""
    begin, last = request.span
    seconds = sum((end or last) - (start or begin) for start, end in parts_s)
    return max(round(seconds / request.clip.interval_s), 2)
