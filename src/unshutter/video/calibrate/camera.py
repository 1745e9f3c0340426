"""What is known of a clip's camera: readout time and direction, lens, and gyro log.

The readout time comes from the user, the clip's file, its gyro log, the table of cameras or the clip's frames. Where
these show that rows were read one after another, but not how fast, a usual value is taken, which comes with a range. If
the frames cannot show a difference for any time in that range, or do not show a rolling shutter, nothing is changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.motion.lens import Lens
from unshutter.options import check_focal
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutRatio, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate import clip_gyro
from unshutter.video.calibrate.clip_gyro import ClipGyro, gyro_in_frames
from unshutter.video.calibrate.first_look import is_invisible, is_quiet
from unshutter.video.calibrate.lenses import lens_of_clip
from unshutter.video.calibrate.questions import FIRST_LOOK, Log, ask, first_look, open_question
from unshutter.video.calibrate.readout_regression import Regression
from unshutter.video.calibrate.readout_time import (
    focal_in_frames,
    listed_time,
    readout_time_in_frames,
    usual_time,
)
from unshutter.video.calibrate.repeated_frames import clock_in_frames
from unshutter.video.calibrate.sampled_frames import SampledFrames, sample_frames
from unshutter.video.file.camera_clock import CameraClock
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.stages import Stage
from unshutter.video.gyro.gyro_log import GyroLog

_LEAST = 0.7  # share of a ratio that a focal length leaves of it, at least
_UNLIKE, _FAR = 0.15, 3.0  # share, and standard errors, by which two readout times differ


@dataclass(frozen=True, eq=False)
class ClipCamera:
    """What is known of a clip's camera."""

    readout_time: ReadoutTime
    lens: Lens | None = None  # its lens, if it bends straight lines
    gyro: ClipGyro | None = None  # the clip's gyro log, and what it tells; None if there is none
    scan_direction: ScanDirection | None = None  # of the stored pixels, if the frames show another than usual
    shown: Regression | None = None  # what the regression of its frames shows; None if there are too few
    stabilised: Reason | None = None  # why its rows must have moved after they were read out; None if nothing says so
    frames: int = 0  # number of frames that were tracked
    clock: CameraClock | None = None  # its clock, if the frames show another than the file states

    def complete(self, request: ClipRequest) -> ClipRequest:
        """Returns the request of a clip of this camera: with its lens, its clock, and its readout direction."""
        clip = request.clip if self.clock is None else replace(request.clip, clock=self.clock)
        return replace(request, clip=clip, lens=self.lens, scan_direction=self.scan_direction or request.scan_direction)


def find_camera(request: ClipRequest) -> tuple[ClipCamera, SampledFrames]:
    """Returns what the user, a clip's file and its frames tell of its camera, and the frames that were tracked for it.

    Of the options, only the shutter's and the selected part count, whether the horizon is kept level, and whether what
    undoing the motion gains is tested.
    """
    check_focal(request.options.shutter.focal_px, request.frame_size[0])
    log = clip_gyro.log_of_clip(request)
    if request.options.steadiness.level:
        clip_gyro.check_level(log)
    question, parts_s = open_question(request, log)
    sampled = ask(request, question, parts_s)
    is_enough = any(len(part) >= FIRST_LOOK - 2 for part in sampled.parts)
    seen = sampled if is_enough or sampled.is_whole else sample_frames(request, first_look(request), is_followed=False)
    clock = clock_in_frames(request.clip, seen)
    if clock is not None and seen is not sampled:  # how the picture moves tells whether repeated frames fill gaps
        clock = clock_in_frames(request.clip, sample_frames(request, first_look(request)))
    if clock is not None:
        request = replace(request, clip=replace(request.clip, clock=clock))
        question, parts_s = open_question(request, log)
        sampled = ask(request, question, parts_s)
    direction = _other_direction(request, sampled)
    if direction is not None:
        request = replace(request, scan_direction=direction)
        check_focal(request.options.shutter.focal_px, request.frame_size[0])
        sampled = ask(request, question, parts_s)
    camera = replace(_camera_from(request, sampled, log), scan_direction=direction, clock=clock)
    request.work.expect({Stage.SEARCH: 0})
    return camera, sampled.through(camera.lens)


def _other_direction(request: ClipRequest, sampled: SampledFrames) -> ScanDirection | None:
    """Returns the direction in which a clip's frames were read, if they show another than usual for certain."""
    if request.options.shutter.readout != "auto":
        return None
    shown = sampled.regression
    if shown is None:
        return None
    if shown.is_turned:
        return ScanDirection.LEFT_TO_RIGHT if shown.columns.ratio > 0 else ScanDirection.RIGHT_TO_LEFT
    return ScanDirection.BOTTOM_TO_TOP if shown.is_sure and shown.rows.ratio < 0 else None


def _camera_from(request: ClipRequest, sampled: SampledFrames, log: Log) -> ClipCamera:
    """Returns what the user, a clip's file and its tracked frames tell of its camera.

    Args:
        log: the clip's gyro log, or why it cannot be used; None if there is none.
    """
    interval_s = request.clip.camera_interval_s
    stated = request.options.shutter.readout_time(interval_s)
    lens = lens_of_clip(request, sampled)
    request = replace(request, lens=lens)
    sampled = sampled.through(lens)
    tag = request.clip.camera.readout_time if stated is None else None
    gyro = gyro_in_frames(request, sampled, log, stated or tag) if isinstance(log, GyroLog) else log
    time = stated or (gyro and gyro.readout_time)
    shown = None
    stabilised = None
    if time is None:
        stabilised = _stabilised(request, gyro)
        shown = sampled.regression
        time = _time_of(request, sampled, shown, listed_time(request) if stabilised is None else None)
    if gyro is not None and gyro.rotations is not None:  # the time of the middle row does not change
        alignment = replace(gyro.rotations.alignment, ratio=time.ratio(interval_s).value)
        gyro = replace(gyro, rotations=replace(gyro.rotations, alignment=alignment))
    return ClipCamera(time, lens, gyro, shown=shown, stabilised=stabilised, frames=sum(map(len, sampled.parts)))


def _stabilised(request: ClipRequest, gyro: ClipGyro | None) -> Reason | None:
    """Returns why the rows of a clip must have moved after they were read out; None without a sign of it."""
    stabilised = None if gyro is None else gyro.stabilised
    if stabilised is None and (gyro is None or gyro.rotations is None) and request.clip.camera.is_stabilised:
        return Reason(Code.STABILISED_IN_CAMERA)
    return stabilised


def _time_of(
    request: ClipRequest, sampled: SampledFrames, shown: Regression | None, listed: ReadoutTime | None
) -> ReadoutTime:
    """Returns the readout time that a clip's file, its frames or the table of cameras tell, or else the usual one.

    Args:
        shown: the ratio that the regression of the frames shows.
        listed: the time that the file states or the table lists. The rows of a clip that was stabilised in the camera
            have moved: only its frames can tell their times.
    """
    interval_s = request.clip.camera_interval_s
    if listed is not None and listed.plausible_s is None:
        return _compared(listed, shown, interval_s)
    usual = listed or usual_time(request)
    # no readout takes longer than a frame, but regression with a long focal length is some per cent too high
    if shown is not None and (shown.is_sure or shown.is_likely) and 0 < shown.rows.ratio < 1.05:
        return _with_focal(request, sampled, shown).readout_ratio.seconds(interval_s)
    if shown is not None and shown.is_none:
        return replace(usual, instead_of=Reason(Code.READ_AT_ONCE))
    if shown is not None and shown.is_likely and shown.rows.ratio < 0:  # the other way, but that is not certain
        return replace(usual, instead_of=Reason(Code.NO_WOBBLE))
    if shown is not None and is_quiet(sampled, shown):
        return replace(usual, instead_of=Reason(Code.NO_WOBBLE))
    if shown is not None and is_invisible(sampled, shown):
        return replace(usual, instead_of=Reason(Code.NO_VISIBLE_DISTORTION))
    try:
        time = readout_time_in_frames(request, sampled)
        _check_agreement(time.ratio(interval_s), shown)
        return time
    except UnknownRatioError as error:
        if shown is not None and shown.wobbles and shown.would_show and shown.rows.ratio < 1.05:
            # unsure, but less so than a usual time
            return _with_focal(request, sampled, shown).readout_ratio.seconds(interval_s)
        return replace(usual, instead_of=error.reason)


def _with_focal(request: ClipRequest, sampled: SampledFrames, shown: Regression) -> Regression:
    """Returns a regression of the same frames by the camera's focal length, as it is known or found in them.

    It is left unchanged if the lens bends lines: what is found of that is not exact enough in the corners.
    """
    if request.lens is not None:
        return shown
    focal = request.focal or focal_in_frames(sampled, min(max(shown.rows.ratio, 0.05), 1.0))
    known = None if focal is None else sampled.regression_with_focal(focal)
    is_alike = known is not None and _LEAST < known.rows.ratio / shown.rows.ratio < 1 + _UNLIKE
    return known if known is not None and is_alike else shown


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
