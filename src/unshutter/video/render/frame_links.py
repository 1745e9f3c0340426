"""Links the frames of a clip to their neighbours by optical flow, since near and far objects move differently.

The flow is computed on small grey copies (frames/neighbours.py). It determines where each pixel of a rectified frame is
sampled, in the frame itself and, for areas that it does not show, in its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.frame_motion import Timing
from unshutter.frames.neighbours import Link, copy_side, link, motion_field
from unshutter.motion.edges import EdgePolicy
from unshutter.motion.grid import SamplingGrid
from unshutter.options.clip_options import ClipUndo
from unshutter.orientation import ScanDirection
from unshutter.video.file.camera_clock import Changes
from unshutter.video.file.clip import Clip, ClipRequest
from unshutter.video.file.stages import Stage
from unshutter.video.render.clip_motion import MovingFrame
from unshutter.video.render.views import grid_of_flow

if TYPE_CHECKING:
    from unshutter.motion.shapes import UInt, UInt8


_ALMOST_ALL = 0.8  # share of the picture found in both frames
_MOST_ROWS = 400  # short side [px] of clips' small copies; for copies this large, the flow is computed at half the size


# the stored pixels of a frame from which another one may borrow, and where each pixel of that is sampled in it
Lender: TypeAlias = "tuple[list[UInt[np.ndarray, 'rows columns *bands']], SamplingGrid]"


@dataclass(frozen=True)
class LinkedFrame:
    """A frame and the flow between it and its neighbours."""

    moving: MovingFrame  # the frame, with the camera's motion if known
    links: dict[int, Link]  # -1 and 1 -> the flow to the previous and next frames, if they show the same scene
    # -1 and 1 -> pixels of these frames, if they may be borrowed
    planes: dict[int, list[UInt[np.ndarray, "rows columns *bands"]]]
    timing: Timing  # the clock of the clip
    scan_direction: ScanDirection  # direction in which its stored pixels were read
    picture_size: tuple[int, int]  # height and width of what the camera saw of it [px]

    def grids(self, undo: ClipUndo) -> tuple[SamplingGrid | None, list[Lender]]:
        """Returns where each pixel of the rectified frame is sampled, in the frame itself and in possible lenders.

        The first is None if the neighbours are inconclusive.
        """
        if not self.links or not undo.strength:
            return None, []
        field, _, reason = motion_field(self.links, self.timing, self.timing.moment(undo.reference))
        if reason:
            return None, []
        own = field.shift(0)
        remainder = (1 - undo.strength) * own  # remaining distortion
        lenders: list[Lender] = [
            (planes, self._grid(field.shift(side * self.links[side].apart) - remainder))
            for side, planes in self.planes.items()
        ]
        return self._grid(own - remainder), lenders

    def _grid(self, shift: np.ndarray) -> SamplingGrid:
        """Converts the shift of every pixel of the small copy to the grid of a whole frame."""
        return grid_of_flow(shift, self.scan_direction, *self.picture_size, self.moving.view)


def linked(request: ClipRequest, frames: Iterable[MovingFrame], ratio: float) -> Iterator[LinkedFrame]:
    """Yields the frames of a clip linked to their neighbours; three are held at a time."""
    timing = Timing(ratio, request.frame_size[0])
    before: _Copied | None = None
    current: _Copied | None = None
    changes = Changes(request.clip.clock)
    for moving in frames:
        following = _Copied.of(request, moving)
        request.work.advance(Stage.LINK)
        if request.clip.clock.repeats and changes.is_repeated(following.copy) and current is not None:
            current.repeats.append(moving)
            continue
        if current is not None:
            current.connect(request.clip, following, ratio)
            yield from current.with_neighbours(before, following, timing, request)
        before, current = current, following
    if current is not None:
        yield from current.with_neighbours(before, None, timing, request)


@dataclass
class _Copied:
    """A frame and the small copy in which flow is computed."""

    moving: MovingFrame
    copy: UInt8[np.ndarray, "rows columns"]  # small and grey, in the readout frame
    planes: list[np.ndarray]  # empty unless pixels are borrowed
    to_next: Link | None = None  # flow to the next frame
    repeats: list[MovingFrame] = field(default_factory=list)  # frames that repeat it

    @classmethod
    def of(cls, request: ClipRequest, moving: MovingFrame) -> _Copied:
        clip, borrow = request.clip, EdgePolicy(request.options.undo.edges).borrows
        side = min(copy_side(*clip.picture_size), _MOST_ROWS)
        # The frame itself may be overwritten before its neighbours are warped.
        planes = [plane.copy() for plane in clip.planes(moving.frame)] if borrow else []
        return cls(moving, request.grey(moving.frame, side), planes)

    def connect(self, clip: Clip, following: _Copied, ratio: float) -> None:
        """Computes the flow to the next frame, unless they are not neighbours or show different scenes."""
        apart = clip.since(self.moving.frame, following.moving.frame)
        if apart is None or apart < ratio:
            return
        with suppress(UnshutterError):
            flow_to_next = link(self.copy, following.copy, apart, int(min(self.copy.shape) >= _MOST_ROWS))
            # No common motion means a cut, or very different depths: the latter keep nearly all of the picture in view.
            if not following.moving.cut or flow_to_next.flow.consistent >= _ALMOST_ALL:
                self.to_next = flow_to_next

    def with_neighbours(
        self, before: _Copied | None, after: _Copied | None, timing: Timing, request: ClipRequest
    ) -> Iterator[LinkedFrame]:
        """Yields it with its neighbours, and the frames that repeat it with the same."""
        beside = {-1: (before, before and before.to_next), 1: (after, self.to_next)}
        links = {side: to for side, (frame, to) in beside.items() if frame is not None and to is not None}
        planes = {side: frame.planes for side, (frame, _) in beside.items() if side in links and frame and frame.planes}
        for moving in (self.moving, *self.repeats):
            yield LinkedFrame(moving, links, planes, timing, request.scan_direction, request.clip.picture_size)
