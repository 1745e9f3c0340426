"""The way of a clip's frames: decoded, given their motion, linked with their neighbours, warped.

Each step is a generator that a thread of its own works on ahead of the next. Packets of the clip's other streams pass
through all of them, between the frames where they lie in the file.

    VideoFrame -> MovingFrame -> (LinkedFrame ->) NewFrame
"""

from __future__ import annotations

from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from unshutter.frames.ratio import ReadoutRatio
from unshutter.frames.sequence import CameraMotion
from unshutter.geometry.readout import Readout
from unshutter.video.background import ahead, side_by_side
from unshutter.video.clip import Clip, SidePacket
from unshutter.video.dense import LinkedFrame, linked
from unshutter.video.frames_out import NewFrame, Warper
from unshutter.video.motion_file import ClipMotion
from unshutter.video.moving import FEWEST, MovingFrame, window, with_motion
from unshutter.video.options import RectifyClip
from unshutter.warp.pixels import thread_count

if TYPE_CHECKING:
    from av import VideoFrame

_DECODED_AHEAD = 2  # frames; each is in memory
_LINKED_AHEAD = 1  # frames; each is in memory


@dataclass(frozen=True)
class Pipeline:
    """The steps that a clip's frames go through.

    Attributes:
        clip: the clip.
        options: which part of it is kept, and how motion is undone.
        ratio: readout time in frame intervals.
        readout: direction in which stored pixels were read.
        file_motion: motion from a file; None: it is found from the frames.
    """

    clip: Clip
    options: RectifyClip
    ratio: ReadoutRatio
    readout: Readout
    file_motion: ClipMotion | None = None

    def moving(self, all_streams: bool = False) -> Generator[MovingFrame | SidePacket]:
        """The frames with their motion; with ``all_streams``, also the packets of the other streams."""
        items = ahead(self.clip.items(self.options.start, self.options.end, all_streams), _DECODED_AHEAD)
        if self.file_motion is not None:
            return _with_file_motion(self.file_motion, items)
        together = window(self.clip)
        focal_px = self.options.shutter.focal_px
        camera = CameraMotion(self.ratio, focal_px, self.readout, window=together, fewest=FEWEST)
        return ahead(with_motion(self.clip, items, camera), together[0])  # while the next are looked at

    def rectified(self, warper: Warper, all_streams: bool = False) -> Generator[NewFrame | SidePacket]:
        """The frames to encode; with ``all_streams``, also the packets of the other streams."""
        undo = self.options.undo
        items: Generator[MovingFrame | LinkedFrame | SidePacket] = self.moving(all_streams)
        if undo.model == "dense" and undo.strength:
            borrow = undo.edges == "borrow"
            items = ahead(linked(self.clip, items, self.ratio.value, self.readout, borrow), _LINKED_AHEAD)
        return side_by_side(warper, items, thread_count())


def _with_file_motion(
    motion: ClipMotion, items: Iterable[VideoFrame | SidePacket]
) -> Generator[MovingFrame | SidePacket]:
    for item in items:
        yield item if isinstance(item, SidePacket) else MovingFrame(item, *motion.at(item.time or 0.0))
