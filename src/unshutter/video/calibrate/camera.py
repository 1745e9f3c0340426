"""What is known of a clip's camera: readout time and direction, lens, and gyro log.

The readout time comes from the user, the clip's file, its gyro log, the table of cameras or the clip's frames. Where
these show that rows were read one after another, but not how fast, a usual value is taken, which comes with a range. If
the frames cannot show a difference for any time in that range, or do not show a rolling shutter, nothing is changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.frames.frame_motion import AT_REST
from unshutter.motion.lens import Lens
from unshutter.options import check_focal
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutRatio, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate import cameras, clip_gyro, gain, lenses
from unshutter.video.calibrate import readout_time as readout
from unshutter.video.calibrate.clip_gyro import ClipGyro, gyro_in_survey
from unshutter.video.calibrate.lenses import lens_of_clip
from unshutter.video.calibrate.readout_regression import Regression
from unshutter.video.calibrate.readout_time import regression_in_survey, time_in_survey
from unshutter.video.calibrate.sampled_frames import SampledFrames, sample_frames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.work import Stage, Steps
from unshutter.video.gyro.gyro_log import GyroLog

_LONGEST = 1.05  # ratio: no readout takes longer than a frame, but regression is some per cent too high
_UNLIKE, _FAR = 0.15, 3.0  # share, and standard errors, by which two readout times differ
_SKIPPED, _AT_FIRST = 3, 4  # every third part of a clip is surveyed first, if these are as many as four
_ALL_ASKED = 0.25  # how likely all frames of a clip are asked: enough for the time that is left to be right either way

_Parts = Sequence[tuple[float | None, float | None]]


@dataclass(frozen=True, eq=False)
class ClipCamera:
    """What is known of a clip's camera."""

    readout_time: ReadoutTime
    lens: Lens | None = None  # its lens, if it bends straight lines
    gyro: ClipGyro | None = None  # the clip's gyro log, and what it tells; None if there is none
    direction: ScanDirection | None = None  # of the stored pixels, if the frames show another than usual

    def complete(self, request: ClipRequest) -> ClipRequest:
        """Returns the request of a clip of this camera: with its lens, and the direction in which it reads."""
        return replace(request, lens=self.lens, scan_direction=self.direction or request.scan_direction)


def find_camera(request: ClipRequest) -> tuple[ClipCamera, SampledFrames]:
    """Returns what the user, a clip's file and its frames tell of its camera, and the frames that were tracked for it.

    Of the options, only the shutter's and the selected part count, whether the horizon is kept level, and whether what
    undoing the motion gains is tested.
    """
    check_focal(request.options.shutter.focal_px, request.frame_size[0])
    log = clip_gyro.log_of_clip(request)
    if request.options.steadiness.level:
        clip_gyro.check_level(log)
    parts_s, what = parts_to_survey(request, log)
    if what == LENS:
        evidence = sample_frames(request, _spread(request, [lenses.PART + 1])[:1])
        evidence = sample_frames(request, parts_s) if lenses.may_bend_lines(evidence) else evidence
    else:
        frames = _frames_in(request, parts_s)
        searched = frames if what == SEARCH else 0  # unless the regression is sure
        asked = _ALL_ASKED * request.frames
        judging = gain.expected(request, frames, asked)
        is_whole = list(parts_s) == [(request.options.start, request.options.end)]
        again = 0 if is_whole or not judging[Stage.JUDGE] else round(asked)
        surveys = {Stage.SURVEY: frames, Stage.SEARCH: readout.SOLVED * searched, Stage.SURVEY_ALL: again}
        request.work.expect(surveys | judging)
        steps = Steps(request.work, what, frames)
        evidence = (_survey_until_sure if what == SEARCH else sample_frames)(request, parts_s, steps)
    direction = _other_direction(request, evidence)
    if direction is not None:
        shutter = replace(request.options.shutter, readout=direction)
        request = replace(request, options=replace(request.options, shutter=shutter), scan_direction=direction)
        camera, evidence = find_camera(request)
        return replace(camera, direction=direction), evidence
    camera = camera_from(request, evidence, log)
    request.work.expect({Stage.SEARCH: 0})
    return camera, evidence.through(camera.lens)


def _survey_until_sure(request: ClipRequest, parts_s: _Parts, steps: Steps) -> SampledFrames:
    """Returns the survey of every third part, where these tell the readout for certain, or else of all parts."""
    if len(parts_s) < _AT_FIRST * _SKIPPED:
        return sample_frames(request, parts_s, steps)
    first = sample_frames(request, parts_s[1::_SKIPPED], steps)
    shown = regression_in_survey(first)
    if shown is not None and (shown.is_none or shown.is_precise):
        request.work.expect({Stage.SURVEY: 0, Stage.SEARCH: 0})
        return first
    others = [part for k, part in enumerate(parts_s) if k % _SKIPPED != 1]
    return first.with_parts(sample_frames(request, others, steps))


def _other_direction(request: ClipRequest, evidence: SampledFrames) -> ScanDirection | None:
    """Returns the direction in which a clip's frames were read, if they show another than usual for certain."""
    if request.options.shutter.readout != "auto":
        return None
    shown = regression_in_survey(evidence)
    if shown is None:
        return None
    if shown.is_turned:
        return ScanDirection.LEFT_TO_RIGHT if shown.columns.ratio > 0 else ScanDirection.RIGHT_TO_LEFT
    return ScanDirection.BOTTOM_TO_TOP if shown.is_sure and shown.rows.ratio < 0 else None


def camera_from(
    request: ClipRequest,
    evidence: SampledFrames,
    log: GyroLog | ClipGyro | None = None,
) -> ClipCamera:
    """Returns what the user, a clip's file and its tracked frames tell of its camera.

    Args:
        log: the clip's gyro log, or why it cannot be used; None if there is none.
    """
    interval_s = request.clip.interval_s
    stated = request.options.shutter.readout_time(request.clip.interval_s)
    lens = lens_of_clip(request, evidence)
    request = replace(request, lens=lens)
    evidence = evidence.through(lens)
    tag = request.clip.camera.readout_time if stated is None else None
    gyro = gyro_in_survey(request, evidence, log, stated or tag) if isinstance(log, GyroLog) else log
    time = stated or (gyro and gyro.readout_time)
    if time is None:
        time = _time_of(request, evidence, gyro)
    if gyro is not None and gyro.rotations is not None:  # the time of the middle row does not change
        alignment = replace(gyro.rotations.alignment, ratio=time.ratio(interval_s).value)
        gyro = replace(gyro, rotations=replace(gyro.rotations, alignment=alignment))
    return ClipCamera(time, lens, gyro)


def _time_of(request: ClipRequest, evidence: SampledFrames, gyro: ClipGyro | None) -> ReadoutTime:
    """Returns the readout time that a clip's file, its frames or the table of cameras tell, or else the usual one.

    The rows of a clip that was stabilised in the camera have moved: only its frames can tell their times.
    """
    clip = request.clip
    stabilised = None if gyro is None else gyro.stabilised
    if stabilised is None and (gyro is None or gyro.rotations is None) and clip.camera.is_stabilised:
        stabilised = Reason(Code.STABILISED_IN_CAMERA)
    listed = _listed_time(request) if stabilised is None else None
    shown = regression_in_survey(evidence)
    if listed is not None and listed.plausible_s is None:
        return _compared(listed, shown, clip.interval_s)
    if shown is not None and (shown.is_sure or shown.is_likely) and 0 < shown.rows.ratio < _LONGEST:
        return shown.readout_ratio.seconds(clip.interval_s)
    if shown is not None and shown.is_none:
        reason = Reason(Code.READ_AT_ONCE)
        return replace(listed or usual_time(request), instead_of=reason, declined=stabilised or reason)
    if shown is not None and shown.is_likely and shown.rows.ratio < 0:  # the other way, but that is not certain
        reason = Reason(Code.NO_WOBBLE)
        return replace(listed or usual_time(request), instead_of=reason, declined=stabilised or reason)
    try:
        time = time_in_survey(request, evidence)
        _check_agreement(time.ratio(clip.interval_s), shown)
        return time
    except UnknownRatioError as error:
        untold = None if listed is not None else _why_left(evidence, shown, error.reason)
        return replace(listed or usual_time(request), instead_of=error.reason, declined=stabilised or untold)


def _why_left(evidence: SampledFrames, shown: Regression | None, unknown: Reason) -> Reason | None:
    """Returns why a clip that does not tell its readout time is left unchanged; None if the usual time stands in.

    That is so where it wobbles; and where its camera did not move, or has no second frame, it has no motion to undo.
    """
    at_rest = dict(unknown.figures).get("because") in AT_REST
    if at_rest or len(list(islice(evidence.frames, 2))) < 2 or (shown is not None and shown.wobbles):
        return None
    return Reason(Code.NO_WOBBLE) if shown is not None and shown.would_show else unknown


def _check_agreement(found: ReadoutRatio, shown: Regression | None) -> None:
    """Raises UnknownRatioError if a regression that could show such a ratio shows another one."""
    if shown is None or not shown.would_show:
        return
    if abs(found.value - shown.rows.ratio) > _FAR * float(np.hypot(found.error, shown.error)):
        ratios = f"{found.value:.2f}, {shown.rows.ratio:.2f}"
        raise UnknownRatioError.because(Reason.of(Code.PARTS_DISAGREE, ratios=ratios)).of_clip()


def _compared(time: ReadoutTime, shown: Regression | None, interval_s: float) -> ReadoutTime:
    """Returns a time that a clip's file states or a table lists, with what its frames show if that differs."""
    if shown is None or not (shown.is_sure or shown.is_none):
        return time
    shown_s = shown.rows.ratio * interval_s
    unlike = abs(shown_s - time.seconds) > max(_UNLIKE * time.seconds, _FAR * shown.error * interval_s)
    return replace(time, shown_s=shown_s) if unlike else time


def _listed_time(request: ClipRequest) -> ReadoutTime | None:
    """Returns the readout time that the clip's file states, or that is listed for its camera."""
    clip = request.clip
    named = request.options.shutter.camera
    size = (clip.width, clip.height)
    return clip.camera.readout_time or cameras.listed_time(clip.tags, named, size, rate=1 / clip.interval_s)


def usual_time(request: ClipRequest) -> ReadoutTime:
    """Returns the readout time that is usual for cameras of the clip's kind, with its range."""
    return cameras.usual_time(request.clip.tags, request.clip.interval_s)


def time_without_search(request: ClipRequest) -> ReadoutTime:
    """Returns the readout time that the user states, or that is listed or usual for the camera."""
    interval_s = request.clip.interval_s
    return request.options.shutter.readout_time(interval_s) or _listed_time(request) or usual_time(request)


# ---- the parts of a clip that tell it ----------------------------------------------------------------------------

SEARCH, GYRO, GAIN, LENS = "readout time", "gyro", "looking", "lens"  # what parts are for


def parts_to_survey(request: ClipRequest, log: GyroLog | ClipGyro | None = None) -> tuple[_Parts, str]:
    """Returns begin and end of the parts of a clip that tell its camera and what undoing its motion gains [s]; and what
    they are for, at least: ``SEARCH``, ``GYRO``, ``GAIN`` or ``LENS``.
    """
    shutter = request.options.shutter
    interval_s = request.clip.interval_s
    stated = shutter.readout_time(interval_s)
    if stated is None:
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
        return _spread(request, [gain.RUN] * gain.RUNS), GAIN
    if shutter.lens is None and shutter.focal_px is None:
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
