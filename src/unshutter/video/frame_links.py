"""The dense model for clips, in which depths move differently: optical flow between each frame and its neighbours.

The flow is computed on small grey copies (frames/neighbours.py). It determines where each pixel of a rectified frame is
sampled, and the planes are warped by it as they are by the camera's motion (frame_map.py). Unlike photos, frames are
not averaged: grain would vary from row to row.
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


_ALMOST_ALL = 0.8  # share of the picture found in both frames
_MOST_ROWS = 400  # short side [px] of clips' small copies; for copies this large, the flow is computed at half the size


@dataclass(frozen=True)
class Lender:
    """A frame from which another one may borrow areas that it does not show.

    Attributes:
        planes: its pixels as stored.
        where: where each pixel of the rectified frame is sampled in it.
    """

    planes: list[UInt[np.ndarray, "rows columns *bands"]]
    where: FrameMap


@dataclass(frozen=True)
class LinkedFrame:
    """A frame and the flow between it and its neighbours.

    Attributes:
        moving: the frame, with the camera's motion if known.
        links: -1 and 1 -> the flow to the previous and next frames, if they show the same scene.
        planes: -1 and 1 -> pixels of these frames, if they may be borrowed.
        timing: the clock of the clip.
        readout: direction in which its stored pixels were read.
    """

    moving: MovingFrame
    links: dict[int, Link]
    planes: dict[int, list[UInt[np.ndarray, "rows columns *bands"]]]
    timing: Timing
    readout: Readout

    def maps(self, undo: ClipUndo) -> tuple[FrameMap | None, list[Lender]]:
        """Returns where each pixel of the rectified frame is sampled, in the frame itself and in possible lenders.

        The first is None if the neighbours are inconclusive.
        """
        if not self.links or not undo.strength:
            return None, []
        motion = motion_field(self.links, self.timing, self.timing.moment(undo.reference))
        if motion.reason:
            return None, []
        own = motion.field.shift(0)
        remainder = (1 - undo.strength) * own  # remaining distortion
        lenders = [
            Lender(planes, self._map(motion.field.shift(side * self.links[side].apart) - remainder))
            for side, planes in self.planes.items()
        ]
        return self._map(own - remainder), lenders

    def _map(self, shift: np.ndarray) -> FrameMap:
        """Converts the shift of every pixel of the small copy to the map of a whole frame."""
        frame = self.moving.frame
        return FrameMap.along(shift, self.readout, frame.height, frame.width, self.moving.view)


def linked(
    clip: Clip, items: Iterable[MovingFrame | SidePacket], ratio: float, readout: Readout, borrow: bool
) -> Iterator[LinkedFrame | SidePacket]:
    """Yields the items of a clip, with frames linked to their neighbours; three frames are held at a time.

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
    packets: list[SidePacket] = []  # that follow the current frame
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
    """A frame and the small copy in which flow is computed."""

    moving: MovingFrame
    copy: UInt8[np.ndarray, "rows columns"]  # small and grey, in the readout frame
    planes: list[np.ndarray]  # empty unless pixels are borrowed
    to_next: Link | None = None

    @classmethod
    def at(cls, clip: Clip, moving: MovingFrame, readout: Readout, borrow: bool) -> _Copied:
        side = min(copy_side(clip.height, clip.width), _MOST_ROWS)
        copy = np.ascontiguousarray(readout.turn(clip.pixels.grey(moving.frame, side)))
        # The frame itself may be overwritten before its neighbours are warped.
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
    """Returns the flow between two frames, or None if they are not neighbours or show different scenes."""
    apart = clip.since(current.moving.frame, following.moving.frame)
    if apart is None or apart < ratio:
        return None
    try:
        halvings = int(min(current.copy.shape) >= _MOST_ROWS)
        flow_to_next = link(current.copy, following.copy, apart, halvings)
    except UnshutterError:
        return None
    # No common motion means a cut, or very different depths: the latter keep nearly all of the picture in view.
    too_little = following.moving.cut and flow_to_next.flow.consistent < _ALMOST_ALL
    return None if too_little else flow_to_next
