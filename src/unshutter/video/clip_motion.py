"""Finds the motion of a clip's frames from their neighbours, and fills in what single frames do not show."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

from unshutter.frames.frame_motion import AT_REST, FrameMotion, Step
from unshutter.frames.self_calibration import GreyFrame
from unshutter.frames.sequence import CameraMotion, Window
from unshutter.motion import Motion, RotationMotion
from unshutter.motion.finding import Finding
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import Code
from unshutter.video.clip import ClipRequest
from unshutter.video.frame_map import View
from unshutter.video.gyro_fit import GyroRotations
from unshutter.video.pixels import Frame
from unshutter.video.row_samples import as_kept, step_as_kept
from unshutter.video.scene_check import SceneCheck
from unshutter.video.work import Stage

ROWS = 65  # of the small pictures to which the motions of clips refer
GYRO_ROWS = 257  # if a gyro recorded the camera's vibration
COPY_SIDE = 270  # px, short side of the copies in which corners are tracked
FEWEST = 8  # frames of a shot: shorter ones are usually errors, not cuts
_FADED = 5  # frames, over which the correction of a clip fades where no motion is found
_WAITING = (8, 40)  # fewest and most frames awaiting their motion: those of a window, and of its margin ahead
_AHEAD = 4  # fewest frames of a margin
_IN_MEMORY = 72_000_000  # bytes of frames awaiting their motion


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


def window_for(size: float) -> Window:
    """Returns the window for estimating motion that memory allows for a frame size [bytes]."""
    waiting = int(min(max(_IN_MEMORY / size, _WAITING[0]), _WAITING[1]))
    ahead = min(Window.ahead, max(2 * waiting // 5, _AHEAD))
    return Window(core=waiting - ahead, ahead=ahead)


def camera_motion(
    request: ClipRequest,
    time: ReadoutTime,
    gyro_rotations: GyroRotations | None = None,
    keep_out: int | None = None,
    focal_px: float | None = None,
    stage: Stage = Stage.FIT,
) -> CameraMotion:
    """Returns what estimates the motion of a clip's frames; see :func:`with_motion` and :class:`CameraMotion`.

    Args:
        stage: as what its fits are counted.
    """
    focal_px = focal_px or (request.focal and request.focal * request.frame_size[0])
    if focal_px is None and gyro_rotations is not None:
        focal_px = gyro_rotations.focal_px(request.frame_size[0])
    return CameraMotion(
        ratio=time.ratio(request.clip.interval_s),
        focal_px=focal_px,
        scan_direction=request.scan_direction,
        window=window_for(request.clip.frame_bytes),
        fewest=FEWEST,
        known_rotations=gyro_rotations,
        whole_path=True,
        keep_out=keep_out,
        lens=request.lens,
        check=SceneCheck.of(time, request.clip.interval_s),
        count=request.work.counts(stage),
    )


def grey_copies(request: ClipRequest, frames: Iterable[Frame]) -> Iterator[GreyFrame | None]:
    """Yields the small copies of frames in which corners are tracked, and None where frames are missing."""
    before = None
    for frame in frames:
        since = request.clip.since(before, frame)
        if since is None:
            yield None
        grey, size = request.grey(frame, COPY_SIDE), request.scan_direction.frame_size(frame.height, frame.width)
        yield GreyFrame(*size, grey, after=1.0 if since is None else since, time_s=frame.time or 0.0)
        before = frame


def with_motion(
    request: ClipRequest,
    frames: Iterable[Frame],
    time: ReadoutTime,
    gyro_rotations: GyroRotations | None = None,
    with_steps: bool = False,
) -> Iterator[MovingFrame]:
    """Yields the frames of a clip with their motion; they are delayed by some frames.

    Args:
        gyro_rotations: the camera's rotation from a gyro; None to use only the frames.
        with_steps: whether the camera's rotation since the previous frame is needed.
    """
    camera = camera_motion(request, time, gyro_rotations)
    waiting: deque[Frame] = deque()

    def read() -> Iterator[Frame]:
        for frame in frames:
            waiting.append(frame)
            request.work.advance(Stage.FOLLOW)
            yield frame

    last = None
    for motion, small in _bridged(camera.motions(grey_copies(request, read()))):
        cut = last is not None and motion.scene != last.scene
        step = step_as_kept(motion.step_from(last)) if with_steps else None
        yield MovingFrame(waiting.popleft(), as_kept(small, request.lens), cut=cut, step=step)
        last = motion


def small_finding(motion: FrameMotion) -> Finding:
    """Returns the motion for a picture of ``ROWS`` rows, or ``GYRO_ROWS`` with a gyro."""
    rows = ROWS if motion.rotations is None else GYRO_ROWS
    width = max(1, round(motion.width * rows / motion.height))
    return replace(motion, height=rows, width=width).finding()


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
    return Finding(replace(nearby[0][0], rotations=sum(share * motion.rotations for motion, share in nearby)))
