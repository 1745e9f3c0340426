"""Undoes a frame's motion on its planes as stored, without conversion to RGB or changes where nothing moves.

The map is smooth, so it is exact at the nodes of a grid and linear between them. A clip's motion is that of a small
picture of the same shape (``frame_motion.py``): its positions are scaled up to each plane's pixels, centre to centre.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from unshutter.frames.flow import bilinear
from unshutter.geometry.readout import Readout
from unshutter.motion import Motion
from unshutter.video.steady_view import SteadyView
from unshutter.warp.grid import gs_to_rs_map

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Bool, Float32, UInt

_NODES = 34  # approximate number of rows of nodes; half to twice as many columns
_BAND, _BAND_PX = 4, 128  # fewest rows of cells, and px, interpolated at a time, to stay in the processor's cache
_LEAST_STEP = 8  # px between nodes, a multiple of every subsampling
_FINE_STEP = 4  # px between nodes for the dense model


@dataclass(frozen=True)
class FrameMap:
    """Maps each pixel of the rectified frame to its position in the original frame.

    Attributes:
        nodes: [2, N, M] col and row [px of the frame], at the centres of square cells; the first and last lie outside.
        step: side of the cells [px].
        height, width: size of the frame [px].
    """

    nodes: Float32[np.ndarray, "2 node_rows node_cols"]
    step: int
    height: int
    width: int

    @classmethod
    def of(cls, motion: Motion, height: int, width: int, view: SteadyView | None = None) -> FrameMap:
        """Returns the map for a frame of height x width [px].

        Args:
            motion: motion of a picture of the same shape and any size.
            height, width: size of the stored frame [px].
            view: the stabilised view to show; None for the camera's own view.

        Raises:
            UnshutterError: the motion turns faster than rows are read.
        """
        small = motion.readout.frame_size(motion.height, motion.width)
        step = max(_LEAST_STEP, 1 << round(np.log2(min(height, width) / _NODES)))
        scale = np.array([small[1] / width, small[0] / height])  # px of the motion per px of the frame
        col, row = (_seen(view, step, height, width) + 0.5) * scale[:, None, None] - 0.5
        with np.errstate(all="ignore"):  # far outside, Newton's method may diverge
            looks = np.stack(gs_to_rs_map(motion)(col, row))
        looks = (looks + 0.5) / scale[:, None, None] - 0.5
        far = float(height + width)
        np.nan_to_num(looks, copy=False, nan=-far, posinf=2 * far, neginf=-far)
        return cls(np.clip(looks, -far, 2 * far).astype(np.float32), step, height, width)

    @classmethod
    def along(
        cls,
        shift: Float32[np.ndarray, "rows columns 2"],
        readout: Readout,
        height: int,
        width: int,
        view: SteadyView | None = None,
    ) -> FrameMap:
        """Returns the map for a frame of height x width [px] in which every pixel has its own shift.

        Args:
            shift: (columns, rows) [px of a small copy of the readout frame], at each pixel of that copy.
            readout: direction in which the stored pixels were read.
            height, width: size of the stored frame [px].
            view: the stabilised view to show; None for the camera's own view.
        """
        size = readout.frame_size(height, width)
        step = max(_FINE_STEP, 1 << int(np.log2(max(size[0] / shift.shape[0], 1))))
        col, row = _seen(view, step, height, width)
        at = np.stack(readout.points_to_frame(col, row, height, width), axis=-1)
        scale = np.array([size[1] / shift.shape[1], size[0] / shift.shape[0]])
        in_copy = ((at + 0.5) / scale - 0.5).astype(np.float32)
        looks = at + bilinear(shift, in_copy) * scale
        stored = readout.points_to_stored(looks[..., 0], looks[..., 1], height, width)
        return cls(np.stack(stored).astype(np.float32), step, height, width)

    def positions(
        self, across: int, down: int, scratch: Scratch | None = None
    ) -> Iterator[tuple[slice, tuple[Float32[np.ndarray, "rows cols"], ...]]]:
        """Yields (rows, (col, row) [px of the plane] of their pixels) for a plane, band by band from the top.

        Args:
            across, down: pixels of the frame per pixel of the plane.
            scratch: buffer for the positions, which are valid until the next band.
        """
        scratch = scratch or Scratch()
        height, width = -(-self.height // down), -(-self.width // across)
        step = (self.step // down, self.step // across)
        columns = slice(step[1], step[1] + width)
        band = max(_BAND, _BAND_PX // self.step)
        for first in range(0, self.nodes.shape[1] - 2, band):
            nodes = self.nodes[:, first : first + band + 2]
            top, bottom = first * step[0], min((first + nodes.shape[1] - 2) * step[0], height)
            filled = scratch.array((2, nodes.shape[1] * step[0], nodes.shape[2] * step[1]))
            for each, share, out in zip(nodes, (across, down), filled, strict=True):
                cv2.resize((each + 0.5) / share - 0.5, out.shape[::-1], dst=out, interpolation=cv2.INTER_LINEAR)
            rows = slice(step[0], step[0] + bottom - top)
            yield slice(top, bottom), (filled[0][rows, columns], filled[1][rows, columns])


def _middles(step: int, height: int, width: int) -> np.ndarray:
    """[2, N, M] col and row [px of the frame] of the centres of its cells and of those surrounding it."""
    rows, cols = ((np.arange(-1, -(-size // step) + 1) + 0.5) * step - 0.5 for size in (height, width))
    row, col = np.meshgrid(rows, cols, indexing="ij")
    return np.stack([col, row])


def _seen(view: SteadyView | None, step: int, height: int, width: int) -> np.ndarray:
    """[2, N, M] positions shown at the centres of the cells: col and row [px] of the global-shutter frame."""
    middles = _middles(step, height, width)
    return middles if view is None else np.stack(view.looks(middles[0], middles[1], height, width))


class Scratch(threading.local):
    """Buffers that a thread reuses for each frame, because allocating memory takes much of the time."""

    def __init__(self) -> None:
        self._arrays: dict[tuple[int, ...], np.ndarray] = {}

    def array(self, shape: tuple[int, ...]) -> Float32[np.ndarray, "*shape"]:
        """Returns an array with arbitrary content, valid until the next call with the same shape."""
        if shape not in self._arrays:
            self._arrays[shape] = np.empty(shape, np.float32)
        return self._arrays[shape]


def warp_plane(
    plane: UInt[np.ndarray, "rows columns *bands"],
    positions: tuple[Float32[np.ndarray, "rows cols"], ...],
    out: UInt[np.ndarray, "rows columns *bands"],
    black: int | None,
    limit: int,
) -> None:
    """Samples a plane at positions into another one, by bicubic interpolation (a = -0.75).

    Args:
        plane: values as stored.
        positions: (col, row) [px of the plane].
        out: output array of the same type.
        black: value for positions outside the plane; None mirrors the plane at its border.
        limit: greatest value, which cubic interpolation may exceed.
    """
    col, row = positions
    border = cv2.BORDER_REFLECT if black is None else cv2.BORDER_CONSTANT
    cv2.remap(plane, col, row, cv2.INTER_CUBIC, dst=out, borderMode=border, borderValue=[black or 0] * 4)
    if limit not in (0xFF, 0xFFFF):
        np.minimum(out, limit, out=out)


def borrow_plane(
    plane: UInt[np.ndarray, "rows columns *bands"],
    positions: tuple[Float32[np.ndarray, "rows cols"], ...],
    out: UInt[np.ndarray, "rows columns *bands"],
    missing: Bool[np.ndarray, "rows cols"],
    limit: int,
) -> None:
    """Samples a plane of another frame at positions into the missing pixels.

    Args:
        plane: values as stored.
        positions: (col, row) [px of the plane].
        out: output array of the same type.
        missing: mask of its pixels to fill.
        limit: greatest value.
    """
    columns = np.flatnonzero(missing.any(axis=0))
    if not columns.size:
        return
    lent = np.empty((len(out), columns.size, *out.shape[2:]), out.dtype)
    warp_plane(plane, tuple(each[:, columns] for each in positions), lent, None, limit)
    where = missing[:, columns]
    out[:, columns] = np.where(where if out.ndim == 2 else where[..., None], lent, out[:, columns])


def on_plane(positions: tuple[Float32[np.ndarray, "rows cols"], ...], height: int, width: int) -> np.ndarray:
    """Bool [rows, cols]: whether each position lies on a plane, including the outer halves of its border pixels."""
    col, row = positions
    return (col >= -0.5) & (col <= width - 0.5) & (row >= -0.5) & (row <= height - 0.5)
