"""Each frame's motion while a clip goes by: found from its neighbours, or read from a file."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from unshutter.frames.sequence import CameraMotion, FrameMotion
from unshutter.frames.shots import Seen
from unshutter.motion import Motion
from unshutter.video.clip import Clip

if TYPE_CHECKING:
    from av import VideoFrame

ROWS = 65  # of the small pictures that motions of clips are of
_SIDE = 270  # px, short side of the copies in which corners are followed
FEWEST = 8  # frames of a shot: what is shorter is more often a mistake than a cut
_MARGIN = 4  # frames on both sides that only steady a window
_CORE = (6, 24)  # fewest and most frames of a window
_IN_MEMORY = 60_000_000  # bytes: frames that wait for their motion, and as many whose motion is known


@dataclass(frozen=True)
class Moved:
    """A frame and its motion.

    Attributes:
        frame: as decoded.
        motion: of a small picture of the same shape, first row as the reference; zero, with a reason, where none is.
        cut: whether it shows another scene than the frame before it.
        dense: whether what undoes it is not this motion, but the flow to the frames beside it.
    """

    frame: VideoFrame
    motion: Motion
    cut: bool = False
    dense: bool = False


def window(clip: Clip) -> tuple[int, int]:
    """How many frames' motion is found together, and how many more steady it: as memory allows."""
    size = sum(plane.bands / plane.across / plane.down for plane in clip.pixels.planes)
    size *= clip.height * clip.width * (1 if clip.pixels.depth == 8 else 2)
    return int(min(max(_IN_MEMORY / size, _CORE[0]), _CORE[1])), _MARGIN


def look(clip: Clip, frame: VideoFrame, camera: CameraMotion, since: float, side: int = _SIDE) -> Seen:
    """What is kept of a frame for finding its motion.

    Args:
        clip: the clip.
        frame: as decoded.
        camera: knows how it is read out.
        since: time since the frame before [usual frame intervals].
        side: short side of the copy [px].
    """
    import numpy as np

    readout = camera.readout
    grey = np.ascontiguousarray(readout.turn(clip.pixels.grey(frame, side)))
    return Seen(*readout.frame_size(frame.height, frame.width), grey, after=since)


def with_motion(clip: Clip, items: Iterable[Any], camera: CameraMotion) -> Iterator[Any]:
    """The items of a clip, its frames with their motion; they come some frames later than they are taken.

    Args:
        clip: the clip.
        items: frames and packets (:meth:`Clip.items`).
        camera: finds the motion; its ratio is known.
    """
    waiting: deque[Any] = deque()
    frame_type = _frame_type()

    def seen() -> Iterator[Seen | None]:
        before = None
        for item in items:
            waiting.append(item)
            if isinstance(item, frame_type):
                since = clip.since(before, item)
                if since is None:
                    yield None
                yield look(clip, item, camera, 1.0 if since is None else since)
                before = item

    last = None
    for found in camera.motions(seen()):
        while not isinstance(waiting[0], frame_type):
            yield waiting.popleft()
        yield Moved(waiting.popleft(), small_motion(found), last is not None and _parted(last, found))
        last = found
    yield from waiting


def small_motion(found: FrameMotion) -> Motion:
    """The motion for a picture of ``ROWS`` rows."""
    width = max(1, round(found.width * ROWS / found.height))
    return replace(found, height=ROWS, width=width).motion()


def _parted(before: FrameMotion, after: FrameMotion) -> bool:
    return after.shot != before.shot


def _frame_type() -> type:
    from unshutter.video.library import av

    return av().VideoFrame
