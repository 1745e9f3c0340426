"""The decision on a clip, from what was measured of it: its frames are rectified, or it is left for a reason.

All thresholds of this decision stand here, but for what can be seen (gain.py). Where measurements of some frames speak
against rectifying a clip, more are measured before it is left: all of a clip of some 700 frames, and of a longer one a
dozen parts, the liveliest among them. Only scenes of one clip that contradict it are found later, as frames are
rendered (calibrate/scene_check.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.frame_motion import AT_REST, FrameMotion
from unshutter.motion.verdict import LEAST_PX
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate import gain
from unshutter.video.calibrate.camera import ClipCamera, find_camera
from unshutter.video.calibrate.gain import TALL, Gain, StepSizes
from unshutter.video.calibrate.questions import READOUT_TIME, most_parts
from unshutter.video.calibrate.readout_time import largest_displacement_px
from unshutter.video.calibrate.sampled_frames import SampledFrames, sample_frames
from unshutter.video.file.clip import Clip, ClipRequest
from unshutter.video.file.motion_file import ClipMotion, load_clip_motion
from unshutter.video.file.stages import Stage, Steps

NO_FRAMES = "{clip} has no frames in this part"


@dataclass(frozen=True)
class DecisionParams:
    """Thresholds of the decision (docs/research/clips.md; lab/benchmarks/real_clips.py)."""

    rounding_px: float = 0.05  # by which a displacement must be less than half a pixel to be rounded to less
    follows: float = 0.5  # least correlation of the lean with the speed
    slack_px: float = 0.1  # px of 1080 rows, by which steps may grow besides
    may_grow: float = 1.1  # times: by which large steps may grow
    may_grow_once: float = 1.5  # and one, where all others get much smaller
    min_pairs: int = 6  # below which tracks cannot tell the gain
    sure: float = 2.0  # standard deviations by which the gain exceeds 0
    sure_of_few: float = 4.0  # in a few short parts, where what moves by itself may seem to fit
    # change of a displacement from frame to frame, as a share of it: below that, the camera moved evenly
    even: float = 0.125
    # wobble that is left, as a share: a smaller gain is not worth the sharpness that resampling costs
    pays: float = 0.93


_PARAMS = DecisionParams()


@dataclass(frozen=True, eq=False)
class RectifyFrames:
    """The motion of the frames is undone."""

    motion: ClipMotion | None = None  # from a file; None: it is found in the frames
    sampled: SampledFrames | None = None  # frames whose corners were tracked for the decision
    focal_px: float | None = None  # focal length that was found for it [px of the frames]
    motions: Mapping[float, FrameMotion] | None = None  # of all frames, by time [s], if that of all was found for it


@dataclass(frozen=True)
class Leave:
    """No frame is straightened."""

    reason: Reason
    frames: int | None = None  # number of frames, if all were examined


Decision: TypeAlias = RectifyFrames | Leave


def calibrate_and_decide(request: ClipRequest) -> tuple[ClipRequest, ClipCamera, Decision]:
    """Returns the request of a clip whose camera is known, the camera, and what is done with the clip."""
    if request.options.motion is not None:
        return _by_file(request)
    camera, sampled = find_camera(request)
    request = camera.complete(request)
    decision = decide(request, camera, sampled)
    is_used = isinstance(decision, RectifyFrames) or decision.reason.code is not Code.NOTHING_TO_SEE
    if camera.readout_time.source is not ReadoutSource.GIVEN and is_used and why_unfit(camera) is None:
        request.work.observer.note_readout(camera.readout_time, request.clip.camera_interval_s)
    return request, camera, decision


def decide(request: ClipRequest, camera: ClipCamera, sampled: SampledFrames) -> Decision:
    """Decides on a clip from some of its frames; more of them are examined before it is left.

    Raises:
        UnshutterError: the part that the user selected has no frames.
    """
    decision = _by_frames(request, camera, sampled)
    if isinstance(decision, RectifyFrames) or why_unfit(camera) is not None or sampled.is_whole:
        return decision
    if decision.reason.code is Code.NOTHING_TO_SEE and sampled.has_liveliest:
        return decision
    parts_s, has_liveliest = most_parts(request)
    frames = min(request.frames, sum(READOUT_TIME.frames))
    request.work.expect({Stage.SURVEY_ALL: frames} | gain.expected(request, frames, frames))
    steps = Steps(request.work, "looking", frames)
    every = sample_frames(request, parts_s, steps, Stage.SURVEY_ALL, known=sampled.by_time)
    request.work.expect({Stage.SURVEY_ALL: 0})
    every = replace(every, has_liveliest=has_liveliest).through(camera.lens)
    return _by_frames(request, camera, every, len(every.parts))


def _by_frames(
    request: ClipRequest, camera: ClipCamera, sampled: SampledFrames, most_runs: int = gain.RUNS
) -> Decision:
    """Decides by what tracked frames show.

    Args:
        most_runs: series of frames whose motion is found, unless all are sampled.
    """
    if sampled.is_whole and not sampled.parts:
        raise UnshutterError(NO_FRAMES, clip=request.clip.path)
    time = camera.readout_time
    frames = len(sampled.parts[0]) if sampled.is_whole else None
    if time.plausible_s is not None and request.options.steadiness.stabilize is None:
        least_px = LEAST_PX - _PARAMS.rounding_px
        largest_px = largest_displacement_px(request, sampled, time.longest_s, least_px)
        if largest_px < least_px:
            return Leave(Reason.of(Code.NOTHING_TO_SEE, px=max(round(largest_px, 1), 0.1)), frames)
    reason = why_unfit(camera)
    if reason is None and time.source is not ReadoutSource.GIVEN and gain.is_tested(request.options):
        measured, motions = _measured(request, camera, sampled, most_runs)
        reason = why_no_gain(measured)
        if reason is None:
            times_s = [frame.time_s for frame in sampled.frames]
            by_time = None if motions is None else dict(zip(times_s, motions, strict=True))
            return RectifyFrames(sampled=sampled, focal_px=measured.focal_px, motions=by_time)
    return RectifyFrames(sampled=sampled) if reason is None else Leave(reason, frames)


def _by_file(request: ClipRequest) -> tuple[ClipRequest, ClipCamera, Decision]:
    """Decides by a motion file, which states readout time and direction, and the lens."""
    clip = request.clip
    assert request.options.motion is not None
    motion = load_clip_motion(request.options.motion)
    if (motion.height, motion.width, motion.picture) != (clip.height, clip.width, clip.picture):
        raise UnshutterError(
            f"the motion file is for {_frames(motion)}, the clip has {_frames(clip)}: it belongs to another clip"
        )
    time = ReadoutTime(motion.ratio * (motion.interval_s or clip.interval_s), source=ReadoutSource.MOTION_FILE)
    request = replace(request, scan_direction=motion.scan_direction, lens=motion.lens)
    return request, ClipCamera(time, motion.lens), RectifyFrames(motion)


def _frames(of: ClipMotion | Clip) -> str:
    bars = "" if of.picture is None else " with bars"
    return f"frames of {of.width}x{of.height} px{bars}"


def why_unfit(camera: ClipCamera) -> Reason | None:
    """Returns why frames must not be straightened with the readout time of their camera; None if they may be.

    A usual time stands in for one that the frames do not reveal only where they wobble, and where their camera did not
    move or there is no second frame: these have no motion to undo. The times of rows that a camera moved as it
    stabilised its clip are unknown.
    """
    time = camera.readout_time
    unrevealed = time.instead_of
    if unrevealed is None or camera.stabilised is not None:
        return unrevealed and camera.stabilised
    if unrevealed.code in (Code.READ_AT_ONCE, Code.NO_WOBBLE, Code.NO_VISIBLE_DISTORTION):
        return unrevealed
    shown = camera.shown
    at_rest = dict(unrevealed.figures).get("because") in AT_REST
    if time.source is not ReadoutSource.USUAL or at_rest or camera.frames < 2 or (shown is not None and shown.wobbles):
        return None
    return Reason(Code.NO_WOBBLE) if shown is not None and shown.would_show else unrevealed


# ---- by what straightening gains -------------------------------------------------------------------------------


def _measured(
    request: ClipRequest, camera: ClipCamera, sampled: SampledFrames, most_runs: int
) -> tuple[Gain, Sequence[FrameMotion] | None]:
    """Returns what a clip gains by some of its frames or, before it is left, by all; and the motion of all or None."""
    known = camera.readout_time, camera.gyro and camera.gyro.rotations
    undo = request.options.undo
    if not sampled.is_whole:
        runs = sampled.runs(most_runs, gain.RUN)
        return Gain.of(gain.motions_of_parts(request, *known, runs), undo), None
    is_long = len(sampled.parts[0]) > gain.ALL
    stage = Stage.JUDGE_ALL if is_long else Stage.JUDGE
    (motions,) = gain.motions_of_parts(request, *known, sampled.parts, stage)
    every = None if request.clip.clock.repeats else motions  # repeated frames are not sampled
    if is_long:
        starts = np.linspace(0, len(motions) - gain.RUN, gain.RUNS).astype(int)
        few = Gain.of([motions[k : k + gain.RUN] for k in starts], undo)
        if why_no_gain(few, _PARAMS.sure_of_few) is None:
            return few, every
    return Gain.of([motions], undo), every


def why_no_gain(measured: Gain, sure: float = _PARAMS.sure) -> Reason | None:
    """Returns why a clip would be no better afterwards; None if it would, or if no frames can show it.

    Args:
        sure: standard deviations by which the gain must exceed 0.
    """
    if measured.frames == measured.reasons.total():
        return measured.reasons.most_common(1)[0][0] if measured.reasons else None
    if 2 * len(measured.displaced_px) >= measured.frames and not gain.is_visible(measured.displaced_px):
        return Reason(Code.NO_VISIBLE_DISTORTION)
    if measured.steps.follow < _PARAMS.follows:
        return Reason.of(Code.LEANS_OTHERWISE, correlation=round(measured.steps.follow, 2))
    sizes = measured.steps.sizes
    if sizes is not None and _are_worse(sizes[1], sizes[0], _PARAMS.slack_px * measured.steps.rows / TALL):
        figures = zip(sizes[0].figures, sizes[1].figures, strict=True)
        before, after = next((was, now) for was, now in figures if now > was)
        return _no_gain(before, after, measured.short_side / measured.steps.rows)
    if len(measured.gains) < _PARAMS.min_pairs:
        return None
    change, displaced = np.median(measured.changes_px, axis=0)
    before, after = map(float, np.median(measured.wobble_px, axis=0))
    usual, error = measured.gain
    if change < _PARAMS.even * displaced or (usual > sure * error and after < _PARAMS.pays * before):
        return None
    return _no_gain(before, after, measured.short_side / TALL)


def _no_gain(before: float, after: float, own_px: float) -> Reason:
    """Returns that a wobble hardly falls; ``own_px``: px of the clip for each px of what it was measured in."""
    return Reason.of(Code.NO_GAIN, before=round(own_px * before, 3), after=round(own_px * after, 3))


def _are_worse(after: StepSizes, before: StepSizes, slack: float) -> bool:
    """Whether large steps are larger than before, by more than a tenth and some slack [px].

    Where those before are twice as large in general, a single step may be somewhat larger.
    """
    once = _PARAMS.may_grow_once if after.usual < before.usual / 2 else _PARAMS.may_grow
    grows = after.usual > _PARAMS.may_grow * before.usual + slack or after.largest > once * before.largest + slack
    return grows or after.rms > max(before.rms, slack)
