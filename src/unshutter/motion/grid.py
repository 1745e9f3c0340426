"""Sampling positions of output pixels in the input picture, for photos and for the planes of video frames.

The map of a motion is smooth, so it is computed exactly (float64) at the nodes of a coarse grid, and linearly between
them. For photos, the grid is refined until interpolation is accurate to 0.01 px; for video frames, its step is chosen
beforehand. Pixels are computed for one tile or band at a time, so that memory does not grow with the picture.

Convention: positions are (col, row) of **stored** pixels (orientation.py), pixel centres at whole numbers.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from unshutter.motion import Motion
from unshutter.motion.shapes import Bool, Float, Float32, Real
from unshutter.motion.upright import Pose

# (col, row) of output pixels -> (col, row) of the input positions they show
PositionMap = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

_INSIDE_SLACK = 0.01  # px, the accuracy of the map
_TILE = (512, 512)  # rows and columns; with smaller tiles, threads wait for the interpreter
_BAND_POINTS = 1 << 18  # number of positions computed at a time


def gs_to_rs_map(motion: Motion, upright: Pose | None = None) -> PositionMap:
    """Returns the map of GS to RS positions: where a rectified picture samples the photo.

    The rectified picture is turned upright if ``upright`` is the pose to undo.
    """
    motion.check_unfolded()
    if upright is None:
        return _in_stored_frame(motion, motion.gs_to_rs)
    lean = partial(upright.leaning, height=motion.height, width=motion.width)
    return _in_stored_frame(motion, lambda col, row: motion.gs_to_rs(*lean(col, row)))


def rs_to_gs_map(motion: Motion, upright: Pose | None = None) -> PositionMap:
    """Returns the map of RS to GS positions (closed form): where a distorted picture samples the original."""
    motion.check_unfolded()
    if upright is None:
        return _in_stored_frame(motion, motion.rs_to_gs)
    rotation = partial(upright.leaning, height=motion.height, width=motion.width, back=True)
    return _in_stored_frame(motion, lambda col, row: rotation(*motion.rs_to_gs(col, row)))


class Tile(NamedTuple):
    """Output pixels in rows top <= row < bottom and columns left <= col < right."""

    top: int
    bottom: int
    left: int
    right: int

    def scaled(self, down: float, across: float) -> Tile:
        """Returns the same part of a picture with so many rows and columns for each."""
        return Tile(round(self.top * down), round(self.bottom * down), *(round(s * across) for s in self[2:]))

    @property
    def area(self) -> int:
        """Number of pixels."""
        return (self.bottom - self.top) * (self.right - self.left)

    def tiles(self) -> Iterator[Tile]:
        """Splits this tile into tiles of a size suitable for processing."""
        for top in range(self.top, self.bottom, _TILE[0]):
            for left in range(self.left, self.right, _TILE[1]):
                yield Tile(top, min(top + _TILE[0], self.bottom), left, min(left + _TILE[1], self.right))

    def within(self, window: Tile) -> tuple[slice, slice]:
        """Returns the slices of its pixels in an array that begins at the corner of ``window``."""
        rows = slice(self.top - window.top, self.bottom - window.top)
        return rows, slice(self.left - window.left, self.right - window.left)

    def halves(self) -> tuple[Tile, Tile]:
        """Splits the tile across its longer side."""
        if self.bottom - self.top > self.right - self.left:
            middle = (self.top + self.bottom) // 2
            return self._replace(bottom=middle), self._replace(top=middle)
        middle = (self.left + self.right) // 2
        return self._replace(right=middle), self._replace(left=middle)


class Extent(NamedTuple):
    """Minimum and maximum column and row [px] of positions."""

    left: float
    top: float
    right: float
    bottom: float

    @classmethod
    def of(cls, col: Float[np.ndarray, "rows cols"], row: Float[np.ndarray, "rows cols"]) -> Extent:
        """Computes the extent of positions."""
        return cls(float(col.min()), float(row.min()), float(col.max()), float(row.max()))

    @classmethod
    def of_picture(cls, height: int, width: int, across: float = 0.0, down: float = 0.0) -> Extent:
        """Returns the extent of a picture's pixel centres, enlarged at its sides and at its top and bottom [px]."""
        return cls(-across, -down, width - 1 + across, height - 1 + down)

    def holds(
        self, col: Float[np.ndarray, "rows cols"], row: Float[np.ndarray, "rows cols"]
    ) -> Bool[np.ndarray, "rows cols"]:
        """Returns which positions lie within the extent."""
        return (col >= self.left) & (col <= self.right) & (row >= self.top) & (row <= self.bottom)


class Scratch(threading.local):
    """Arrays that a thread reuses, because fresh memory from the system takes a third of the time."""

    def __init__(self) -> None:
        self._arrays: dict[str, np.ndarray] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> Float32[np.ndarray, "*shape"]:
        """Returns an uninitialised array, valid until the next request for that name."""
        size = math.prod(shape)
        if name not in self._arrays or self._arrays[name].size < size:
            self._arrays[name] = np.empty(size, np.float32)
        return self._arrays[name][:size].reshape(shape)


@dataclass(frozen=True)
class SamplingGrid:
    """A map of positions for a picture of height x width, known at regularly spaced nodes."""

    # col and row at the nodes; the last nodes are beyond the picture's end
    nodes: Float32[np.ndarray, "2 node_rows node_cols"]
    row_step: int  # distance from a row of nodes to the next [px]
    col_step: int  # distance from a column of nodes to the next [px]
    height: int  # rows of the output and of the input picture
    width: int  # columns of both

    @classmethod
    def of(cls, position: PositionMap, height: int, width: int) -> SamplingGrid:
        """Computes the exact map at as few nodes as linear interpolation permits, from the first pixel on."""
        steps = [_first_step(height), _first_step(width)]
        at = [np.arange(-(-size // s) + 1) * s for size, s in zip((height, width), steps, strict=True)]
        nodes = np.empty((2, len(at[0]), len(at[1])), dtype=np.float32)
        _compute(position, at[0], at[1], nodes)
        axis = 0
        settled = 0
        while settled < 2:
            if steps[axis] > 1:
                finer_at, finer = _halved(position, at, nodes, axis)
                # px at the midpoints of a cell's sides; at its centre the errors of both directions add up
                if _worst_inside(finer, axis, height, width, steps[axis]) > 0.004:
                    nodes = finer
                    at[axis] = finer_at
                    steps[axis] //= 2
                    settled = 0
                    continue
            axis = 1 - axis
            settled += 1
        return cls(_limited(nodes, height, width), steps[0], steps[1], height, width)

    @classmethod
    def of_cells(cls, position: PositionMap, step: int, height: int, width: int) -> SamplingGrid:
        """Computes the exact map at the centres of square cells of ``step`` px, and of those around the picture.

        Only :meth:`bands` interpolates such a grid.
        """
        rows, cols = ((np.arange(-1, -(-size // step) + 1) + 0.5) * step - 0.5 for size in (height, width))
        row, col = np.meshgrid(rows, cols, indexing="ij")
        with np.errstate(all="ignore"):  # far outside, Newton's method may diverge
            nodes = np.stack(position(col, row))
        return cls(_limited(nodes, height, width).astype(np.float32), step, step, height, width)

    @property
    def area_left(self) -> Tile:
        """The whole output, as one tile."""
        return Tile(0, self.height, 0, self.width)

    def everywhere(
        self,
    ) -> tuple[
        Float32[np.ndarray, "{self.height} {self.width}"],
        Float32[np.ndarray, "{self.height} {self.width}"],
    ]:
        """Computes the map at every pixel of the output: col and row, each float32 [H, W]."""
        col, row = (np.empty((self.height, self.width), np.float32) for _ in range(2))
        for tile in self.area_left.tiles():
            col[tile.within(self.area_left)], row[tile.within(self.area_left)] = self.positions(tile)
        return col, row

    def positions(
        self, tile: Tile, left: int = 0, top: int = 0, out: Float32[np.ndarray, "2 rows cols"] | None = None
    ) -> tuple[Float32[np.ndarray, "rows cols"], Float32[np.ndarray, "rows cols"]]:
        """Computes the map at every pixel of a tile: col and row, each float32 [rows, cols].

        Args:
            left, top: origin from which columns and rows of the input are counted.
            out: float32 [2, rows, cols] to write the result to; by default a new array.
        """
        nodes, first_row, first_col = self._nodes_about(tile)
        down = _weights(np.arange(first_row, first_row + tile.bottom - tile.top), self.row_step, nodes.shape[1])
        across = _weights(np.arange(first_col, first_col + tile.right - tile.left), self.col_step, nodes.shape[2])
        nodes = nodes - np.array([[[left]], [[top]]], dtype=np.float32)
        col, row = np.matmul(down @ nodes, across.T, out=out)
        return col, row

    def at(
        self, rows: Real[np.ndarray, "rows"], cols: Real[np.ndarray, "cols"]
    ) -> tuple[Float32[np.ndarray, "rows cols"], Float32[np.ndarray, "rows cols"]]:
        """Computes the map at the crossings of given rows and columns of the output: col and row."""
        down = _weights(rows, self.row_step, self.nodes.shape[1])
        across = _weights(cols, self.col_step, self.nodes.shape[2])
        col, row = np.matmul(down @ self.nodes, across.T)
        return col, row

    def near(
        self, rows: Real[np.ndarray, "rows"], cols: Real[np.ndarray, "cols"]
    ) -> tuple[Float32[np.ndarray, "rows cols"], Float32[np.ndarray, "rows cols"]]:
        """Computes what :meth:`at` does for ascending rows and columns, faster if they are close to each other."""
        first_row, last_row = (int(at // self.row_step) for at in rows[[0, -1]])
        first_col, last_col = (int(at // self.col_step) for at in cols[[0, -1]])
        part = replace(self, nodes=self.nodes[:, first_row : last_row + 2, first_col : last_col + 2])
        return part.at(rows - first_row * self.row_step, cols - first_col * self.col_step)

    def bands(
        self, across: int, down: int, scratch: Scratch | None = None
    ) -> Iterator[tuple[slice, tuple[Float32[np.ndarray, "rows cols"], Float32[np.ndarray, "rows cols"]]]]:
        """Yields (rows, (col, row) [px of the plane] of their pixels) for a plane, band by band from the top.

        Args:
            across, down: columns and rows of the picture per column and row of the plane; divisors of the step.
        """
        scratch = scratch or Scratch()
        height = -(-self.height // down)
        width = -(-self.width // across)
        step = (self.row_step // down, self.col_step // across)
        columns = slice(step[1], step[1] + width)
        band = max(4, 128 // self.row_step)  # stays in the processor's cache
        for first in range(0, self.nodes.shape[1] - 2, band):
            nodes = self.nodes[:, first : first + band + 2]
            top = first * step[0]
            bottom = min((first + nodes.shape[1] - 2) * step[0], height)
            filled = scratch.array("positions", (2, nodes.shape[1] * step[0], nodes.shape[2] * step[1]))
            for each, share, out in zip(nodes, (across, down), filled, strict=True):
                cv2.resize((each + 0.5) / share - 0.5, out.shape[::-1], dst=out, interpolation=cv2.INTER_LINEAR)
            rows = slice(step[0], step[0] + bottom - top)
            yield slice(top, bottom), (filled[0][rows, columns], filled[1][rows, columns])

    def extent(self, tile: Tile) -> Extent:
        """Returns bounds of a tile's positions from the surrounding nodes: cheaper than exact bounds, but wider."""
        nodes, _, _ = self._nodes_about(tile)
        left, top = nodes.min(axis=(1, 2)).tolist()
        right, bottom = nodes.max(axis=(1, 2)).tolist()
        return Extent(left, top, right, bottom)

    def contains(self, extent: Extent) -> bool:
        """Whether all positions within the bounds are inside the picture."""
        least = min(extent.left, extent.top)
        most = max(extent.right - self.width, extent.bottom - self.height)
        return least >= -_INSIDE_SLACK and most <= _INSIDE_SLACK - 1

    def inside(
        self,
        col: Float[np.ndarray, "rows cols"],
        row: Float[np.ndarray, "rows cols"],
        left: int = 0,
        top: int = 0,
        beyond: float = 0.0,
    ) -> Bool[np.ndarray, "rows cols"]:
        """Whether positions, counted from left and top, are inside the picture or up to ``beyond`` px outside; bool."""
        slack = beyond + _INSIDE_SLACK
        right = self.width - 1 - left + slack
        bottom = self.height - 1 - top + slack
        return Extent(-left - slack, -top - slack, right, bottom).holds(col, row)

    def _nodes_about(self, tile: Tile) -> tuple[np.ndarray, int, int]:
        """Returns the nodes of a tile's cells, and row and column of its first pixel relative to the first node."""
        first_row = tile.top // self.row_step
        first_col = tile.left // self.col_step
        last_row = -(-tile.bottom // self.row_step)
        last_col = -(-tile.right // self.col_step)
        nodes = self.nodes[:, first_row : last_row + 1, first_col : last_col + 1]
        return nodes, tile.top - first_row * self.row_step, tile.left - first_col * self.col_step


def _weights(at: np.ndarray, step: int, nodes: int) -> np.ndarray:
    """Returns [N, nodes] linear interpolation weights at some pixels, for nodes ``step`` pixels apart.

    Multiplying by zeros costs less than picking two nodes for each pixel.
    """
    return np.maximum(1 - np.abs(at[:, None] / step - np.arange(nodes)), 0).astype(np.float32)


def _limited(nodes: np.ndarray, height: int, width: int) -> np.ndarray:
    """Keeps nodes near the picture, in place: nothing is sampled far outside, and a diverging map knows no limit."""
    far = float(height + width)
    np.nan_to_num(nodes, copy=False, nan=-far, posinf=2 * far, neginf=-far)
    return np.clip(nodes, -far, 2 * far, out=nodes)


def _in_stored_frame(motion: Motion, in_frame: PositionMap) -> PositionMap:
    """Converts a map between positions of the readout frame to one between stored positions."""
    scan_direction = motion.scan_direction
    size = motion.scan_direction.frame_size(motion.height, motion.width)

    def in_stored(col: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return scan_direction.points_to_stored(*in_frame(*scan_direction.points_to_frame(col, row, *size)), *size)

    return in_stored


def _first_step(size: int) -> int:
    """Returns the largest power of two up to an eighth of the side, keeping nodes beyond the picture close to it."""
    return min(1 << max((size // 8).bit_length() - 1, 0), 64)


def _compute(position: PositionMap, rows: np.ndarray, cols: np.ndarray, out: np.ndarray) -> None:
    """Writes the map at rows x cols to out [2, rows, cols], in bands to limit memory."""
    band = max(_BAND_POINTS // len(cols), 1)
    for first in range(0, len(rows), band):
        row, col = np.meshgrid(rows[first : first + band].astype(float), cols.astype(float), indexing="ij")
        with np.errstate(all="ignore"):  # far outside, Newton's method may diverge
            out[0, first : first + band], out[1, first : first + band] = position(col, row)


def _halved(position: PositionMap, at: list[np.ndarray], nodes: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Inserts nodes midway between the existing ones along an axis; returns their positions and the nodes."""
    finer_at = np.linspace(at[axis][0], at[axis][-1], 2 * len(at[axis]) - 1).astype(int)
    shape = (2, len(finer_at), len(at[1])) if axis == 0 else (2, len(at[0]), len(finer_at))
    finer = np.empty(shape, dtype=np.float32)
    if axis == 0:
        finer[:, 0::2] = nodes
        _compute(position, finer_at[1::2], at[1], finer[:, 1::2])
    else:
        finer[..., 0::2] = nodes
        _compute(position, at[0], finer_at[1::2], finer[..., 1::2])
    return finer_at, finer


def _worst_inside(finer: np.ndarray, axis: int, height: int, width: int, step: int) -> float:
    """Returns the largest error [px] of interpolating every other node along an axis, for positions inside the picture.

    Positions up to half a step outside are included, because other pixels of their cells may be inside.
    """
    near = max(step / 2, 1)
    picture = Extent.of_picture(height, width, near, near)
    lines = np.moveaxis(finer, 1 + axis, 1)
    before = lines[:, :-1:2]
    exact = lines[:, 1::2]
    after = lines[:, 2::2]
    band = max(_BAND_POINTS // exact.shape[2], 1)
    worst = 0.0
    for first in range(0, exact.shape[1], band):
        part = slice(first, first + band)
        error = np.abs(exact[:, part] - (before[:, part] + after[:, part]) / 2).max(axis=0)
        worst = max(worst, float(error[picture.holds(*exact[:, part])].max(initial=0.0)))
    return worst
