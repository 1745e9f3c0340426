"""Near and far may move differently: each frame of a clip by the flow between it and the frames beside it.

The flow is found on small grey copies (frames/neighbours.py). It says where each pixel of a rectified frame looks, and
the planes are warped by it as they are by the camera's motion (warping.py). Frames are not averaged, as photos are:
grain would come and go from row to row.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.neighbours import Link, copy_side, link, moving_about
from unshutter.frames.timing import Timing
from unshutter.geometry.readout import Readout
from unshutter.video.clip import Clip
from unshutter.video.moving import Moved
from unshutter.video.options import UndoFrames
from unshutter.video.warping import FrameMap

if TYPE_CHECKING:
    from unshutter.geometry.shapes import UInt, UInt8


_ALMOST_ALL = 0.8  # of the picture is found in both frames


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
class Beside:
    """A frame and what the frames beside it say of it.

    Attributes:
        moved: the frame, and the camera's motion where that is known.
        links: -1 and 1 -> what connects it with the frame before and after; those that show the same scene.
        planes: -1 and 1 -> pixels of these frames, where they are to be borrowed from.
        timing: the clock of the clip.
        readout: direction in which its stored pixels were read.
    """

    moved: Moved
    links: dict[int, Link]
    planes: dict[int, list[UInt[np.ndarray, "rows columns *bands"]]]
    timing: Timing
    readout: Readout

    def look(self, undo: UndoFrames) -> tuple[FrameMap | None, list[Lender]]:
        """Where each pixel of the rectified frame looks, in the frame itself and in those that may lend to it.

        None where the frames beside it do not say enough.
        """
        if not self.links or not undo.strength:
            return None, []
        moving = moving_about(self.links, self.timing, self.timing.moment(undo.reference))
        if moving.reason:
            return None, []
        own = moving.field.shift(0)
        left = (1 - undo.strength) * own  # of the distortion
        lenders = [
            Lender(planes, self._map(moving.field.shift(side * self.links[side].apart) - left))
            for side, planes in self.planes.items()
        ]
        return self._map(own - left), lenders

    def _map(self, shift: np.ndarray) -> FrameMap:
        """A shift of every pixel of the small copy as the map of a whole frame."""
        return FrameMap.along(shift, self.readout, self.moved.frame.height, self.moved.frame.width)


def beside_each_other(clip: Clip, items: Iterable[Any], ratio: float, readout: Readout, borrow: bool) -> Iterator[Any]:
    """The items of a clip, its frames with what the frames beside them say; three frames are held at a time.

    Args:
        clip: the clip.
        items: frames with their motion (:class:`Moved`), and packets.
        ratio: readout time in frame intervals.
        readout: direction in which stored pixels were read.
        borrow: whether frames keep the pixels of those beside them.
    """
    timing = Timing(ratio, readout.frame_size(clip.height, clip.width)[0])
    before: _Looked | None = None
    current: _Looked | None = None
    packets: list[Any] = []  # that came after the current frame
    for item in items:
        if not isinstance(item, Moved):
            packets.append(item)
            continue
        following = _Looked.at(clip, item, readout, borrow)
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
class _Looked:
    """A frame that was looked at."""

    moved: Moved
    copy: UInt8[np.ndarray, "rows columns"]  # small and grey, in the readout frame
    planes: list[np.ndarray]  # empty where nothing is borrowed
    to_next: Link | None = None

    @classmethod
    def at(cls, clip: Clip, moved: Moved, readout: Readout, borrow: bool) -> _Looked:
        side = copy_side(clip.height, clip.width)
        copy = np.ascontiguousarray(readout.turn(clip.pixels.grey(moved.frame, side)))
        # The frame itself may be written to before those beside it are made.
        planes = [plane.copy() for plane in clip.pixels.arrays(moved.frame)] if borrow else []
        return cls(moved, copy, planes)

    def with_neighbours(
        self, before: _Looked | None, after: _Looked | None, timing: Timing, readout: Readout
    ) -> Beside:
        links: dict[int, Link] = {}
        planes: dict[int, list[np.ndarray]] = {}
        for side, neighbour, connection in ((-1, before, before and before.to_next), (1, after, self.to_next)):
            if neighbour is not None and connection is not None:
                links[side] = connection
                if neighbour.planes:
                    planes[side] = neighbour.planes
        return Beside(self.moved, links, planes, timing, readout)


def _connection(clip: Clip, current: _Looked, following: _Looked, ratio: float) -> Link | None:
    """What connects two frames; None where frames are missing between them, or they show different scenes."""
    apart = clip.since(current.moved.frame, following.moved.frame)
    if apart is None or apart < ratio:
        return None
    try:
        found = link(current.copy, following.copy, apart)
    except UnshutterError:
        return None
    # Corners that went apart may mean a cut, or near and far that move very differently: then nearly all must be there.
    return None if following.moved.cut and found.flow.consistent < _ALMOST_ALL else found
