"""Finds the motion of a clip's frames from their neighbours, and interpolates it where frames do not show it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from unshutter.frames.frame_motion import AT_REST, FrameMotion, Step
from unshutter.motion import Motion, RotationMotion, RowMotion
from unshutter.motion.finding import Finding
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate.motion_estimation import camera_motion, grey_copies, small_finding
from unshutter.video.calibrate.sampled_frames import SampledFrames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.pixels import Frame, is_damaged
from unshutter.video.file.row_samples import as_kept, step_as_kept
from unshutter.video.file.stages import Stage
from unshutter.video.gyro.synchronisation import GyroRotations
from unshutter.video.render.views import View

_FADED = 5  # frames, over which the correction of a clip fades where no motion is found


@dataclass(frozen=True)
class MovingFrame:
    """A frame of a clip and its motion."""

    frame: Frame  # the decoded frame
    # motion of a small picture of the same shape, first row as the reference; zero, with a reason, if none was found
    found: Finding
    cut: bool = False  # whether it shows another scene than the previous frame
    dense: bool = False  # whether it was rectified by the flow to its neighbours instead of this motion
    step: Step | None = None  # the camera's rotation since the previous frame; None if unknown
    view: View | None = None  # the stabilised or straightened view; None for the camera's own

    @property
    def motion(self) -> Motion:
        """The motion of the small picture."""
        return self.found.motion

    @property
    def record(self) -> tuple[float, Finding, bool, Step | None]:
        """What a motion file holds: presentation time [s], motion, whether the scene changes, and the camera's step."""
        return self.frame.time or 0.0, self.found, self.cut, self.step


def with_motion(
    request: ClipRequest,
    frames: Iterable[Frame],
    time: ReadoutTime,
    gyro_rotations: GyroRotations | None = None,
    with_steps: bool = False,
    sampled: SampledFrames | None = None,
    focal_px: float | None = None,
    motions: Mapping[float, FrameMotion] | None = None,
) -> Iterator[MovingFrame]:
    """Yields the frames of a clip with their motion; they are delayed by some frames.

    Args:
        gyro_rotations: the camera's rotation from a gyro; None to use only the frames.
        with_steps: whether the camera's rotation since the previous frame is needed.
        sampled: frames whose corners were tracked before.
        focal_px: focal length, if it was found before [px of the frames].
        motions: of all frames, by their time on the camera's clock [s], if they were found before.
    """
    camera = camera_motion(request, time, gyro_rotations, focal_px=focal_px)
    waiting: deque[Frame] = deque()

    def read() -> Iterator[Frame]:
        for frame in frames:
            waiting.append(frame)
            request.work.advance(Stage.FOLLOW)
            yield frame

    last = None
    if motions is None:
        found = camera.motions(grey_copies(request, read(), sampled))
    else:
        found = (motions[request.clip.camera_time(frame)] for frame in read())
    for motion, small in _bridged(found):
        cut = last is not None and motion.scene != last.scene
        step = step_as_kept(motion.step_from(last)) if with_steps else None
        frame = waiting.popleft()
        if is_damaged(frame):
            small = Finding(RowMotion.zero(small.motion.height, small.motion.width), reason=Reason(Code.DAMAGED))
        yield MovingFrame(frame, as_kept(small, request.lens), cut=cut, step=step)
        last = motion


_Known: TypeAlias = tuple[int, Finding, int]  # motion of another frame: scene, motion, and how many frames away it is


def _bridged(motions: Iterable[FrameMotion]) -> Iterator[tuple[FrameMotion, Finding]]:
    """Yields the motions, also for small pictures; those not found are filled in from the frames before and after.

    Otherwise, single frames would jump back to their distortion. In longer gaps, the correction fades out and in.
    """
    lost: deque[tuple[FrameMotion, Finding, list[_Known]]] = deque()
    before: list[_Known] = []

    def release(most: int, *after: tuple[int, Finding]) -> Iterator[tuple[FrameMotion, Finding]]:
        while len(lost) > most:
            motion, none, known = lost.popleft()
            yield motion, _mixed(motion.scene, none, known + [(*each, len(lost) + 1) for each in after])

    for motion in motions:
        small = small_finding(motion)
        before = [(scene, known, apart + 1) for scene, known, apart in before]
        if small.reason is None or small.reason.code in AT_REST:
            yield from release(0, (motion.scene, small))
            yield motion, small
            before = [(motion.scene, small, 0)]
        else:
            lost.append((motion, small, before))
            yield from release(_FADED - 1)
    yield from release(0)


def _mixed(scene: int, none: Finding, known: list[_Known]) -> Finding:
    """Returns a motion like those of frames nearby, the less so the further away; otherwise ``none``."""
    alike = [each for each in known if each[0] == scene]
    is_own = none.reason is not None and none.reason.code is Code.SCENE_CONTRADICTS  # a scene that is known as another
    if not alike and len(known) == 2 and not is_own:  # a scene of so few frames is an error
        alike = known
    shares = [(found.motion, max(0.0, 1 - apart / _FADED)) for _, found, apart in alike]
    total = max(1.0, sum(share for _, share in shares))
    nearby = [(motion, share / total) for motion, share in shares if isinstance(motion, RotationMotion) and share]
    if not nearby:
        return none
    mixed = replace(nearby[0][0], rotations=sum(share * motion.rotations for motion, share in nearby))
    moved = [share * motion.parallax for motion, share in nearby if motion.parallax is not None]
    return Finding(replace(mixed, parallax=sum(moved) if moved else None))
