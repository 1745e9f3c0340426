"""Estimates the motion of each frame of a clip from its neighbours while the clip is being decoded."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from unshutter.frames.frame_motion import FrameMotion, Step
from unshutter.frames.sequence import CameraMotion
from unshutter.frames.shots import GreyFrame
from unshutter.motion import Motion
from unshutter.video.clip import Clip, SidePacket, frame_bytes
from unshutter.video.steady_view import SteadyView

if TYPE_CHECKING:
    from av import VideoFrame

ROWS = 65  # of the small pictures to which the motions of clips refer
GYRO_ROWS = 257  # if a gyro recorded the camera's vibration
COPY_SIDE = 270  # px, short side of the copies in which corners are tracked
FEWEST = 8  # frames of a shot: shorter ones are usually errors, not cuts
_MARGIN = 4  # extra frames on both sides of a window, for stability
_CORE = (4, 24)  # fewest and most frames of a window
_IN_MEMORY = 60_000_000  # bytes of frames awaiting their motion


@dataclass(frozen=True)
class MovingFrame:
    """A frame of a clip and its motion.

    Attributes:
        frame: the decoded frame.
        motion: motion of a small picture of the same shape, first row as the reference; zero, with a reason, if none
            was found.
        cut: whether it shows another scene than the previous frame.
        dense: whether it was rectified by the flow to its neighbours instead of this motion.
        step: the camera's rotation since the previous frame; None if unknown.
        view: the stabilised view; None if the camera's path is not smoothed.
    """

    frame: VideoFrame
    motion: Motion
    cut: bool = False
    dense: bool = False
    step: Step | None = None
    view: SteadyView | None = None


def window(clip: Clip) -> tuple[int, int]:
    """Returns the window and margin [frames] for estimating motion, see :func:`window_for`."""
    return window_for(frame_bytes(clip))


def window_for(size: float) -> tuple[int, int]:
    """Returns the window and margin [frames] for estimating motion that memory allows for a frame size [bytes]."""
    return int(min(max(_IN_MEMORY / size, _CORE[0]), _CORE[1])), _MARGIN


def look(clip: Clip, frame: VideoFrame, camera: CameraMotion, since: float, side: int = COPY_SIDE) -> GreyFrame:
    """Returns the grey copy of a frame from which its motion is estimated.

    Args:
        clip: the clip.
        frame: the decoded frame.
        camera: provides the readout direction.
        since: time since the previous frame [usual frame intervals].
        side: short side of the copy [px].
    """
    readout = camera.readout
    grey = np.ascontiguousarray(readout.turn(clip.pixels.grey(frame, side)))
    size = readout.frame_size(frame.height, frame.width)
    return GreyFrame(*size, grey, after=since, time_s=frame.time or 0.0)


def with_motion(
    clip: Clip, items: Iterable[VideoFrame | SidePacket], camera: CameraMotion
) -> Iterator[MovingFrame | SidePacket]:
    """Yields the items of a clip, its frames with their motion; they are delayed by some frames.

    Args:
        clip: the clip.
        items: frames and packets (:meth:`Clip.items`).
        camera: estimates the motion; its ratio must be known.
    """
    waiting: deque[VideoFrame | SidePacket] = deque()

    def small_copies() -> Iterator[GreyFrame | None]:
        before = None
        for item in items:
            waiting.append(item)
            if not isinstance(item, SidePacket):
                since = clip.since(before, item)
                if since is None:
                    yield None
                yield look(clip, item, camera, 1.0 if since is None else since)
                before = item

    last = None
    for motion in camera.motions(small_copies()):
        while isinstance(item := waiting.popleft(), SidePacket):
            yield item
        small = small_motion(motion)
        step = motion.step_from(last)
        yield MovingFrame(item, small, cut=last is not None and motion.scene != last.scene, step=step)
        last = motion
    for item in waiting:
        assert isinstance(item, SidePacket)  # all frames have their motion by now
        yield item


def small_motion(motion: FrameMotion) -> Motion:
    """Returns the motion for a picture of ``ROWS`` rows, or ``GYRO_ROWS`` with a gyro."""
    rows = ROWS if motion.turns is None else GYRO_ROWS
    width = max(1, round(motion.width * rows / motion.height))
    return replace(motion, height=rows, width=width).motion()
