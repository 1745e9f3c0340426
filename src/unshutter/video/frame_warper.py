"""Renders the frame a global shutter would have taken, from a frame and its motion."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from unshutter.motion import Motion
from unshutter.video.clip import Clip, SidePacket
from unshutter.video.containers import av
from unshutter.video.frame_links import Lender, LinkedFrame
from unshutter.video.frame_map import FrameMap, Scratch, borrow_plane, on_plane, warp_plane
from unshutter.video.moving_frames import MovingFrame
from unshutter.video.options import ClipUndo
from unshutter.warp.edges import EdgePolicy, valid_window
from unshutter.warp.grid import Tile

if TYPE_CHECKING:
    from av import VideoFrame

    from unshutter.geometry.shapes import Bool

_SIDE_DATA = {"A53_CC", "S12M_TIMECODE", "GOP_TIMECODE", "SEI_UNREGISTERED", "DYNAMIC_HDR_PLUS"}
_COLOURS = ("color_range", "color_primaries", "color_trc", "colorspace")
_FULL_RANGE = 2  # FFmpeg's code
_COARSE = 8  # px between points checked for a crop; its multiples are whole chroma pixels


@dataclass(frozen=True)
class NewFrame:
    """A frame ready for encoding.

    Attributes:
        source: the original frame and its motion.
        picture: its pixels, time and colours; the original frame itself if nothing moved.
    """

    source: MovingFrame
    picture: VideoFrame


@dataclass(frozen=True)
class Warper:
    """Renders the rectified frames of a clip.

    Attributes:
        clip: the clip.
        undo: how motion is undone.
        window: the part of each frame to keep; None for all of it.
    """

    clip: Clip
    undo: ClipUndo
    window: Tile | None = None
    _scratches: tuple[Scratch, ...] = field(default_factory=lambda: (Scratch(), Scratch(), Scratch()))

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the output frames [px]."""
        w = self.window
        return (self.clip.height, self.clip.width) if w is None else (w.bottom - w.top, w.right - w.left)

    def motion(self, moving: MovingFrame) -> Motion:
        """Returns the part of a frame's motion that is undone, at the reference row."""
        return moving.motion.rereferenced(self.undo.reference).scaled(self.undo.strength)

    def __call__(self, item: MovingFrame | LinkedFrame | SidePacket) -> NewFrame | SidePacket:
        """Returns the frame to encode; passes packets on unchanged."""
        if isinstance(item, SidePacket):
            return item
        return self._by_flow(item) if isinstance(item, LinkedFrame) else self.rectified(item)

    def rectified(self, moving: MovingFrame) -> NewFrame:
        """Rectifies a frame by the camera's motion."""
        motion, frame, view = self.motion(moving), moving.frame, moving.view
        if motion.is_zero and view is None and self.window is None:
            return NewFrame(moving, frame)
        picture = av().VideoFrame(self.clip.width, self.clip.height, self.clip.pixels.name)
        if motion.is_zero and view is None:
            for before, after in zip(*map(self.clip.pixels.arrays, (frame, picture)), strict=True):
                np.copyto(after, before)
        else:
            self._warp(frame, picture, FrameMap.of(motion, frame.height, frame.width, view))
        return NewFrame(moving, self._dressed(picture, frame))

    def _by_flow(self, linked: LinkedFrame) -> NewFrame:
        """Rectifies a frame by the flow to its neighbours or, if they are inconclusive, by the camera's motion."""
        moving, frame = linked.moving, linked.moving.frame
        where, lenders = linked.maps(self.undo)
        if where is None:
            return self.rectified(moving)
        picture = av().VideoFrame(self.clip.width, self.clip.height, self.clip.pixels.name)
        self._warp(frame, picture, where)
        if lenders:
            self._borrow(lenders, picture, where)
        return NewFrame(replace(moving, dense=True), self._dressed(picture, frame))

    def _warp(self, frame: VideoFrame, picture: VideoFrame, frame_map: FrameMap) -> None:
        """Writes the rectified planes of a frame into those of another."""
        pixels, limit = self.clip.pixels, (1 << self.clip.pixels.depth) - 1
        full = frame.color_range == _FULL_RANGE or pixels.name.startswith("yuvj")
        planes = list(zip(pixels.planes, pixels.arrays(frame), pixels.arrays(picture), strict=True))
        for across, down in dict.fromkeys((plane.across, plane.down) for plane in pixels.planes):
            alike = [each for each in planes if (each[0].across, each[0].down) == (across, down)]
            for rows, positions in frame_map.positions(across, down, self._scratches[0]):
                for plane, before, after in alike:
                    black = (plane.black_full if full else plane.black) if self.undo.edges == "keep" else None
                    warp_plane(before, positions, after[rows], black, limit)

    def _borrow(self, lenders: list[Lender], picture: VideoFrame, own: FrameMap) -> None:
        """Fills areas that a frame does not show from its neighbours, in the planes of the rectified frame."""
        pixels, limit = self.clip.pixels, (1 << self.clip.pixels.depth) - 1
        for across, down in dict.fromkeys((plane.across, plane.down) for plane in pixels.planes):
            alike = [k for k, plane in enumerate(pixels.planes) if (plane.across, plane.down) == (across, down)]
            out = pixels.arrays(picture)
            size = out[alike[0]].shape[:2]
            bands = [
                each.positions(across, down, scratch)
                for each, scratch in zip((own, *(lender.where for lender in lenders)), self._scratches, strict=False)
            ]
            for (rows, positions), *theirs in zip(*bands, strict=True):
                missing = ~on_plane(positions, *size)
                for lender, (_, there) in zip(lenders, theirs, strict=True):
                    if not missing.any():
                        break
                    has = missing & on_plane(there, *size)
                    for k in alike:
                        borrow_plane(lender.planes[k], there, out[k][rows], has, limit)
                    missing &= ~has

    def _dressed(self, picture: VideoFrame, frame: VideoFrame) -> VideoFrame:
        """Returns the new pixels with the time, colours and side data of the original frame."""
        if self.window is None and _SIDE_DATA & self.clip.side_data.keys():
            frame.make_writable()
            for new, old in zip(self.clip.pixels.arrays(picture), self.clip.pixels.arrays(frame), strict=True):
                np.copyto(old, new)
            return frame
        if self.window is not None:
            picture = self._cut(picture)
        picture.pts, picture.time_base = frame.pts, frame.time_base
        for name in _COLOURS:
            setattr(picture, name, getattr(frame, name))
        return picture

    def _cut(self, frame: VideoFrame) -> VideoFrame:
        """Crops a frame to the window."""
        height, width = self.size
        picture = av().VideoFrame(width, height, self.clip.pixels.name)
        assert self.window is not None
        pixels = self.clip.pixels
        for plane, old, new in zip(pixels.planes, pixels.arrays(frame), pixels.arrays(picture), strict=True):
            top, left = self.window.top // plane.down, self.window.left // plane.across
            np.copyto(new, old[top : top + new.shape[0], left : left + new.shape[1]])
        return picture


def common_window(warper: Warper, frames: Iterable[MovingFrame]) -> Tile | None:
    """Returns the largest rectangle of the clip's shape that all rectified frames cover; None for all of it.

    Raises:
        CropTooSmallError: almost nothing would be left.
    """
    clip = warper.clip
    mask = np.ones((clip.height // _COARSE, clip.width // _COARSE), bool)
    for moving in frames:
        motion = warper.motion(moving)
        if not motion.is_zero or moving.view is not None:
            _clear_invisible(mask, FrameMap.of(motion, clip.height, clip.width, moving.view))
    if mask.all():
        return None
    window = EdgePolicy("crop").decide(mask.shape, lambda: valid_window(mask), "frame").window
    return Tile(*(_COARSE * side for side in window))


def _clear_invisible(mask: Bool[np.ndarray, "rows cols"], frame_map: FrameMap) -> None:
    """Clears the points of a coarse mask that a frame does not show."""
    margin = 1.0  # one spacing between checked points
    for rows, (col, row) in frame_map.positions(_COARSE, _COARSE):
        inside = (col >= margin) & (col <= frame_map.width / _COARSE - 1 - margin)
        inside &= (row >= margin) & (row <= frame_map.height / _COARSE - 1 - margin)
        part = mask[rows]
        part &= inside[: part.shape[0], : part.shape[1]]
