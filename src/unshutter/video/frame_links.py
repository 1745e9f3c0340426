"""The dense model for clips, in which near and far move differently: the flow between each frame and its neighbours.

The flow is found on small grey copies (frames/neighbours.py). It says where each pixel of a rectified frame looks, and
the planes are warped by it as they are by the camera's motion (frame_map.py). Frames are not averaged, as photos are:
grain would come and go from row to row.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.neighbours import Link, copy_side, link, motion_field
from unshutter.frames.timing import Timing
from unshutter.geometry.readout import Readout
from unshutter.video.clip import Clip, SidePacket
from unshutter.video.frame_map import FrameMap
from unshutter.video.moving_frames import MovingFrame
from unshutter.video.options import ClipUndo

if TYPE_CHECKING:
    from unshutter.geometry.shapes import UInt, UInt8


_ALMOST_ALL = 0.8  # of the picture is found in both frames
_MOST_ROWS = 400  # short side [px] of the small copies of clips; of such large ones, the flow is found in half the size


@dataclass(frozen=True)
class Lender:
    """A frame from which another one may borrow what it did not see.

    Attributes:
        planes: its pixels as they are stored.
        where: where each pixel of the rectified frame looks in it.
    """

    planes: list[UInt[np.ndarray, "rows columns *bands"]]
    where: FrameMap


@dataclass(frozen=True)
class LinkedFrame:
    """A frame and the flow between it and its neighbours.

    Attributes:
        moving: the frame, and the camera's motion where that is known.
        links: -1 and 1 -> the flow to the frame before and after, of those that show the same scene.
        planes: -1 and 1 -> pixels of these frames, where they are to be borrowed from.
        timing: the clock of the clip.
        readout: direction in which its stored pixels were read.
    """

    moving: MovingFrame
    links: dict[int, Link]
    planes: dict[int, list[UInt[np.ndarray, "rows columns *bands"]]]
    timing: Timing
    readout: Readout

    def maps(self, undo: ClipUndo) -> tuple[FrameMap | None, list[Lender]]:
        """Where each pixel of the rectified frame looks, in the frame itself and in those that may lend to it.

        None where the neighbours do not show enough.
        """
        if not self.links or not undo.strength:
            return None, []
        motion = motion_field(self.links, self.timing, self.timing.moment(undo.reference))
        if motion.reason:
            return None, []
        own = motion.field.shift(0)
        remainder = (1 - undo.strength) * own  # of the distortion
        lenders = [
            Lender(planes, self._map(motion.field.shift(side * self.links[side].apart) - remainder))
            for side, planes in self.planes.items()
        ]
        return self._map(own - remainder), lenders

    def _map(self, shift: np.ndarray) -> FrameMap:
        """A shift of every pixel of the small copy as the map of a whole frame."""
        frame = self.moving.frame
        return FrameMap.along(shift, self.readout, frame.height, frame.width, self.moving.view)


def linked(
    clip: Clip, items: Iterable[MovingFrame | SidePacket], ratio: float, readout: Readout, borrow: bool
) -> Iterator[LinkedFrame | SidePacket]:
    """The items of a clip, its frames linked with their neighbours; three frames are held at a time.

    Args:
        clip: the clip.
        items: frames with their motion, and packets.
        ratio: readout time in frame intervals.
        readout: direction in which stored pixels were read.
        borrow: whether frames keep the pixels of their neighbours.
    """
    timing = Timing(ratio, readout.frame_size(clip.height, clip.width)[0])
    before: _Copied | None = None
    current: _Copied | None = None
    packets: list[SidePacket] = []  # that came after the current frame
    for item in items:
        if isinstance(item, SidePacket):
            packets.append(item)
            continue
        following = _Copied.at(clip, item, readout, borrow)
        if current is not None:
            current.to_next = _connection(clip, current, following, ratio)
            yield current.with_neighbours(before, following, timing, readout)
        yield from packets
        packets.clear()
        before, current = current, following
    if current is not None:
        yield current.with_neighbours(before, None, timing, readout)
    yield from packets


@dataclass
class _Copied:
    """A frame and its small copy, in which flow is looked for."""

    moving: MovingFrame
    copy: UInt8[np.ndarray, "rows columns"]  # small and grey, in the readout frame
    planes: list[np.ndarray]  # empty where nothing is borrowed
    to_next: Link | None = None

    @classmethod
    def at(cls, clip: Clip, moving: MovingFrame, readout: Readout, borrow: bool) -> _Copied:
        side = min(copy_side(clip.height, clip.width), _MOST_ROWS)
        copy = np.ascontiguousarray(readout.turn(clip.pixels.grey(moving.frame, side)))
        # The frame itself may be written to before its neighbours are warped.
        planes = [plane.copy() for plane in clip.pixels.arrays(moving.frame)] if borrow else []
        return cls(moving, copy, planes)

    def with_neighbours(
        self, before: _Copied | None, after: _Copied | None, timing: Timing, readout: Readout
    ) -> LinkedFrame:
        links: dict[int, Link] = {}
        planes: dict[int, list[np.ndarray]] = {}
        for side, neighbour, connection in ((-1, before, before and before.to_next), (1, after, self.to_next)):
            if neighbour is not None and connection is not None:
                links[side] = connection
                if neighbour.planes:
                    planes[side] = neighbour.planes
        return LinkedFrame(self.moving, links, planes, timing, readout)


def _connection(clip: Clip, current: _Copied, following: _Copied, ratio: float) -> Link | None:
    """The flow between two frames; None where frames are missing between them, or they show different scenes."""
    apart = clip.since(current.moving.frame, following.moving.frame)
    if apart is None or apart < ratio:
        return None
    try:
        halvings = int(min(current.copy.shape) >= _MOST_ROWS)
        flow_to_next = link(current.copy, following.copy, apart, halvings)
    except UnshutterError:
        return None
    # Corners that went apart may mean a cut, or near and far that move very differently: then nearly all must be there.
    too_little = following.moving.cut and flow_to_next.flow.consistent < _ALMOST_ALL
    return None if too_little else flow_to_next
