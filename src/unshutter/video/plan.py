"""The plan for a clip: its motion is undone, or it is left unchanged for a reason."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

from unshutter.errors import UnshutterError
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate import gain
from unshutter.video.calibrate.camera import ClipCamera, find_camera
from unshutter.video.calibrate.readout_time import too_little_to_see
from unshutter.video.calibrate.sampled_frames import SampledFrames, sample_frames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.motion_file import ClipMotion, load_clip_motion
from unshutter.video.file.work import Stage

NO_FRAMES = "{clip} has no frames in this part"


@dataclass(frozen=True, eq=False)
class Undo:
    """The motion of the frames is undone."""

    motion: ClipMotion | None = None  # from a file; None: it is found in the frames


@dataclass(frozen=True)
class Leave:
    """No frame is straightened."""

    reason: Reason
    frames: int | None = None  # number of frames, if all were examined


Plan: TypeAlias = Undo | Leave


def make_plan(request: ClipRequest) -> tuple[ClipRequest, ClipCamera, Plan]:
    """Returns the plan for a clip with what is known of its camera, and the request of a clip of that camera."""
    if request.options.motion is not None:
        return _plan_of_file(request)
    camera, evidence = find_camera(request)
    request = camera.complete(request)
    plan = plan_by_all(request, camera, evidence)
    by_frames = camera.readout_time.declined is None
    is_used = by_frames and (isinstance(plan, Undo) or plan.reason.code is not Code.NOTHING_TO_SEE)
    if camera.readout_time.source is not ReadoutSource.GIVEN and is_used:
        request.work.observer.note_readout(camera.readout_time, request.clip.interval_s)
    return request, camera, plan


def plan_by_all(request: ClipRequest, camera: ClipCamera, evidence: SampledFrames) -> Plan:
    """Returns the plan for a clip of a camera by some of its frames; all are asked before it is left."""
    plan = plan_from(request, camera, evidence)
    if isinstance(plan, Undo) or camera.readout_time.declined is not None or evidence.is_whole:
        return plan
    span_s = request.options.start, request.options.end
    request.work.expect({Stage.SURVEY_ALL: request.frames} | gain.expected(request, request.frames, request.frames))
    every = sample_frames(request, [span_s], request.steps("looking"), Stage.SURVEY_ALL)
    request.work.expect({Stage.SURVEY_ALL: 0})
    return plan_from(request, camera, every.through(camera.lens))


def plan_from(request: ClipRequest, camera: ClipCamera, evidence: SampledFrames) -> Plan:
    """Returns the plan for a clip by what its tracked frames show.

    Raises:
        UnshutterError: the part that the user selected has no frames.
    """
    if evidence.is_whole and not evidence.parts:
        raise UnshutterError(NO_FRAMES, clip=request.clip.path)
    time = camera.readout_time
    options = request.options
    frames = len(evidence.parts[0]) if evidence.is_whole else None
    if time.plausible_s is not None and options.steadiness.stabilize is None:
        little_px = too_little_to_see(request, evidence, time.longest_s)
        if little_px is not None:
            return Leave(Reason.of(Code.NOTHING_TO_SEE, px=max(round(little_px, 1), 0.1)), frames)
    if time.declined is not None:
        return Leave(time.declined, frames)
    if time.source is ReadoutSource.GIVEN or not gain.is_tested(options):
        return Undo()
    reason = gain.gain_of_clip(request, time, camera.gyro and camera.gyro.rotations, evidence).declined()
    return Undo() if reason is None else Leave(reason, frames)


def _plan_of_file(request: ClipRequest) -> tuple[ClipRequest, ClipCamera, Plan]:
    """Returns the plan by a motion file, which tells readout time and direction, and the lens."""
    clip = request.clip
    assert request.options.motion is not None
    motion = load_clip_motion(request.options.motion)
    if (motion.height, motion.width) != (clip.height, clip.width):
        raise UnshutterError(
            f"the motion file is for frames of {motion.width}x{motion.height} px, the clip has "
            f"{clip.width}x{clip.height}: it belongs to another clip"
        )
    time = ReadoutTime(motion.ratio * clip.interval_s, source=ReadoutSource.MOTION_FILE)
    return (
        replace(request, scan_direction=motion.scan_direction, lens=motion.lens),
        ClipCamera(time, motion.lens),
        Undo(motion),
    )
