"""Renders the frames that a global shutter would have taken: by the camera's motion or, for scenes in depth, by flow.

Planes are sampled as stored, all by one grid (views.py): nothing is converted to RGB, or changed where nothing moves.
Unlike photos, frames are not averaged: grain would vary from row to row.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from unshutter.motion import Motion
from unshutter.motion.edges import EdgePolicy, valid_window
from unshutter.motion.grid import Extent, SamplingGrid, Scratch, Tile
from unshutter.motion.shapes import Bool, Float32, UInt
from unshutter.motion.verdict import undone_part
from unshutter.motion.warp import sample_plane, warp_plane
from unshutter.options.clip_options import ClipUndo
from unshutter.video.file.clip import Clip
from unshutter.video.file.pixels import Frame, of_file
from unshutter.video.render.clip_motion import MovingFrame
from unshutter.video.render.frame_links import Lender, LinkedFrame
from unshutter.video.render.views import View, grid_of_motion

_SIDE_DATA = {"A53_CC", "S12M_TIMECODE", "GOP_TIMECODE", "SEI_UNREGISTERED", "DYNAMIC_HDR_PLUS"}
_COARSE = 8  # px between points checked for a crop; its multiples are whole chroma pixels


@dataclass(frozen=True)
class NewFrame:
    """A frame ready for encoding."""

    source: MovingFrame  # the original frame and its motion
    picture: Frame  # its pixels, time and colours; the original frame itself if nothing moved


@dataclass(frozen=True)
class Warper:
    """Renders the rectified frames of a clip."""

    clip: Clip
    undo: ClipUndo  # how motion is undone
    window: Tile | None = None  # the part to keep of what the camera saw; None for all of each frame
    _scratches: tuple[Scratch, ...] = field(default_factory=lambda: (Scratch(), Scratch(), Scratch()))

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the output frames [px]."""
        w = self.window
        return (self.clip.height, self.clip.width) if w is None else (w.bottom - w.top, w.right - w.left)

    def motion(self, moving: MovingFrame) -> Motion:
        """Returns the part of a frame's motion that is undone, at the reference row."""
        return undone_part(moving.motion, self.undo)

    def __call__(self, frame: MovingFrame | LinkedFrame) -> NewFrame:
        """Returns the frame to encode."""
        return self._by_flow(frame) if isinstance(frame, LinkedFrame) else self.rectified(frame)

    def rectified(self, moving: MovingFrame) -> NewFrame:
        """Rectifies a frame by the camera's motion."""
        motion, frame, view = self.motion(moving), moving.frame, moving.view
        if motion.is_zero and view is None:
            return NewFrame(moving, frame if self.window is None else self._dressed(frame, frame))
        picture = self._warped(frame, grid_of_motion(motion, *self.clip.picture_size, view))
        return NewFrame(moving, self._dressed(picture, frame))

    def _by_flow(self, linked: LinkedFrame) -> NewFrame:
        """Rectifies a frame by the flow to its neighbours or, if they are inconclusive, by the camera's motion."""
        moving, frame = linked.moving, linked.moving.frame
        grid, lenders = linked.grids(self.undo)
        if grid is None:
            return self.rectified(moving)
        picture = self._warped(frame, grid)
        if lenders:
            self._borrow(lenders, picture, grid)
        return NewFrame(replace(moving, dense=True), self._dressed(picture, frame))

    def _warped(self, frame: Frame, grid: SamplingGrid) -> Frame:
        """Returns the rectified pixels of a frame."""
        pixels, limit = self.clip.pixels, (1 << self.clip.pixels.depth) - 1
        picture = pixels.blank(frame, self.clip.height, self.clip.width)
        full = pixels.is_full_range(frame)
        black_beyond = EdgePolicy(self.undo.edges).black_beyond
        if self.clip.picture is not None:
            _copy_planes(pixels.arrays(frame), pixels.arrays(picture))  # with the bars
        planes = list(zip(pixels.planes, self.clip.planes(frame), self.clip.planes(picture), strict=True))
        for subsampling in dict.fromkeys((plane.across, plane.down) for plane in pixels.planes):
            alike = [each for each in planes if (each[0].across, each[0].down) == subsampling]
            black = [each.black_full if full else each.black for each, _, _ in alike for _ in range(each.bands)]
            before, after = alike[0][1:]
            if len(alike) > 1:  # one with several bands is warped faster than several planes
                before = cv2.merge([old for _, old, _ in alike])
                after = np.empty_like(before)
            warp_plane(before, grid, after, subsampling, black_beyond, black, limit, self._scratches[0])
            if len(alike) > 1:
                for k, (_, _, new) in enumerate(alike):
                    cv2.extractChannel(after, k, new)
        return picture

    def _borrow(self, lenders: list[Lender], picture: Frame, own: SamplingGrid) -> None:
        """Fills areas that a frame does not show from its neighbours, in the planes of the rectified frame."""
        pixels, limit = self.clip.pixels, (1 << self.clip.pixels.depth) - 1
        for across, down in dict.fromkeys((plane.across, plane.down) for plane in pixels.planes):
            alike = [k for k, plane in enumerate(pixels.planes) if (plane.across, plane.down) == (across, down)]
            out = self.clip.planes(picture)
            rows, columns = out[alike[0]].shape[:2]
            plane = Extent.of_picture(rows, columns, 0.5, 0.5)  # with the outer halves of its border pixels
            bands = [
                each.bands(across, down, scratch)
                for each, scratch in zip((own, *(grid for _, grid in lenders)), self._scratches, strict=False)
            ]
            for (band, positions), *theirs in zip(*bands, strict=True):
                missing = ~plane.holds(*positions)
                for (planes, _), (_, there) in zip(lenders, theirs, strict=True):
                    if not missing.any():
                        break
                    has = missing & plane.holds(*there)
                    for k in alike:
                        _borrow_plane(planes[k], there, out[k][band], has, limit)
                    missing &= ~has

    def _dressed(self, picture: Frame, frame: Frame) -> Frame:
        """Returns the new pixels with the time, colours and side data of the original frame."""
        if self.window is None and _SIDE_DATA & self.clip.side_data.keys():
            of_file(frame).make_writable()
            _copy_planes(self.clip.pixels.arrays(picture), self.clip.pixels.arrays(frame))
            return frame
        return picture if self.window is None else self._cut(picture, self.window)

    def _cut(self, frame: Frame, window: Tile) -> Frame:
        pixels = self.clip.pixels
        picture = pixels.blank(frame, *self.size)
        for plane, old, new in zip(pixels.planes, self.clip.planes(frame), pixels.arrays(picture), strict=True):
            top, left = window.top // plane.down, window.left // plane.across
            np.copyto(new, old[top : top + new.shape[0], left : left + new.shape[1]])
        return picture


def common_window(warper: Warper, frames: Iterable[tuple[Motion, View | None]]) -> Tile | None:
    """Returns the largest rectangle of the clip's shape that all rectified frames cover; None for all of it.

    Args:
        frames: motion (first row as the reference) and view of each.
    """
    clip = warper.clip
    height, width = clip.picture_size
    mask = np.ones((height // _COARSE, width // _COARSE), bool)
    for found, view in frames:
        motion = undone_part(found, warper.undo)
        if motion.is_zero and view is None:
            continue
        last = width / _COARSE - 2, height / _COARSE - 2  # a margin of one spacing
        safe = Extent(1, 1, *last)
        for rows, positions in grid_of_motion(motion, height, width, view).bands(_COARSE, _COARSE):
            part = mask[rows]
            part &= safe.holds(*positions)[: part.shape[0], : part.shape[1]]
    if mask.all():
        return None
    window = EdgePolicy("crop").decide(mask.shape, lambda: valid_window(mask), "frame").window
    return Tile(*(_COARSE * side for side in window))


def _copy_planes(old: list[np.ndarray], new: list[np.ndarray]) -> None:
    for source, target in zip(old, new, strict=True):
        np.copyto(target, source)


def _borrow_plane(
    plane: UInt[np.ndarray, "rows columns *bands"],
    positions: tuple[Float32[np.ndarray, "rows cols"], Float32[np.ndarray, "rows cols"]],
    out: UInt[np.ndarray, "rows columns *bands"],
    missing: Bool[np.ndarray, "rows cols"],
    limit: int,
) -> None:
    """Samples a plane of another frame at positions into the missing pixels.

    Args:
        missing: mask of its pixels to fill.
    """
    columns = np.flatnonzero(missing.any(axis=0))
    if not columns.size:
        return
    col, row = positions
    lent = np.empty((len(out), columns.size, *out.shape[2:]), out.dtype)
    sample_plane(plane, (col[:, columns], row[:, columns]), lent, limit)
    where = missing[:, columns]
    out[:, columns] = np.where(where if out.ndim == 2 else where[..., None], lent, out[:, columns])


def side_by_side(warper: Warper, frames: Iterable[MovingFrame | LinkedFrame], threads: int) -> Generator[NewFrame]:
    """Yields the frames to encode, in order, several warped in parallel."""
    running: deque[Future[NewFrame]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for frame in frames:
                running.append(pool.submit(warper, frame))
                if len(running) > threads:
                    yield running.popleft().result()
            while running:
                yield running.popleft().result()
        finally:
            for future in running:
                future.cancel()
