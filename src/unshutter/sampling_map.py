"""Where each output pixel looks in the input picture: the exact map of a Motion, thinned to a grid.

The map is smooth, so it is computed exactly (float64) at the nodes of a coarse grid that is refined until
linear interpolation between nodes is good to 0.01 px; libvips fills in the pixels between nodes when a
tile is asked for, so that memory does not grow with the picture.

Convention: positions are (col, row) of **stored** pixels (readout.py), pixel centres at whole numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from unshutter.motion import Motion

if TYPE_CHECKING:
    import pyvips

# (col, row) of output pixels -> (col, row) of the input positions they show
PositionMap = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

_COARSEST_STEP = 64  # px between nodes to start from; a power of two
_TOLERANCE = 0.004  # px at the middle of a cell's sides; at its centre the two directions add up
_INSIDE_SLACK = 0.01  # px, what the map is good to
_BAND_POINTS = 1 << 18  # positions computed at a time


def gs_to_rs_map(motion: Motion) -> PositionMap:
    """GS -> RS positions: where a rectified picture looks in the photo.

    Raises:
        UnshutterError: the motion turns faster than rows are read.
    """
    motion.check_unfolded()
    return _in_stored_frame(motion, motion.gs_to_rs)


def rs_to_gs_map(motion: Motion) -> PositionMap:
    """RS -> GS positions (closed form): where a distorted picture looks in the one to be distorted.

    Raises:
        UnshutterError: the motion turns faster than rows are read.
    """
    motion.check_unfolded()
    return _in_stored_frame(motion, motion.rs_to_gs)


@dataclass(frozen=True)
class SamplingGrid:
    """A map of positions for a picture of height x width, known at nodes every so many pixels.

    Attributes:
        nodes: float32 [rows, cols, 2]: (col, row) at the nodes; the last lie beyond the picture's end.
        row_step, col_step: distance of the nodes [px].
        height, width: of the picture, output and input alike [px].
    """

    nodes: np.ndarray
    row_step: int
    col_step: int
    height: int
    width: int

    @classmethod
    def of(cls, position: PositionMap, height: int, width: int) -> SamplingGrid:
        """The exact map at as few nodes as linear interpolation allows."""
        steps = [_first_step(height), _first_step(width)]
        at = [np.arange(-(-size // s) + 1) * s for size, s in zip((height, width), steps, strict=True)]
        nodes = np.empty((len(at[0]), len(at[1]), 2), dtype=np.float32)
        _compute(position, at[0], at[1], nodes)
        axis, settled = 0, 0
        while settled < 2:
            if steps[axis] > 1:
                finer_at, finer = _halved(position, at, nodes, axis)
                if _worst_inside(finer, axis, height, width) > _TOLERANCE:
                    nodes, at[axis], steps[axis], settled = finer, finer_at, steps[axis] // 2, 0
                    continue
            axis, settled = 1 - axis, settled + 1
        # Far outside nothing is looked up, and a map that runs away would leave the range of libvips.
        far = float(height + width)
        np.nan_to_num(nodes, copy=False, nan=-far, posinf=2 * far, neginf=-far)
        return cls(np.clip(nodes, -far, 2 * far, out=nodes), steps[0], steps[1], height, width)

    @cached_property
    def index(self) -> pyvips.Image:
        """The map at every pixel, two float bands (col, row), computed tile by tile as it is asked for.

        Value and slope of each cell are repeated along the row (zoom) and put together: three times
        faster than ``affine``, which would interpolate two bands pixel by pixel.
        """
        lines = self._nodes_on_every_row()
        if self.col_step == 1:
            return _vips(lines).crop(0, 0, self.width, self.height)
        across = np.tile(np.arange(self.col_step, dtype=np.float32) / self.col_step, lines.shape[1] - 1)
        across = _vips(np.stack([across, across], axis=-1)[None]).replicate(1, len(lines))
        value, slope = _vips(lines[:, :-1]).zoom(self.col_step, 1), _vips(np.diff(lines, axis=1)).zoom(self.col_step, 1)
        return (value + slope * across).crop(0, 0, self.width, self.height)

    def _nodes_on_every_row(self) -> np.ndarray:  # float32 [height or more, cols, 2]
        if self.row_step == 1:
            return self.nodes
        at = np.arange(self.height) / self.row_step
        above = np.minimum(at.astype(int), len(self.nodes) - 2)
        weight = (at - above).astype(np.float32)[:, None, None]
        return self.nodes[above] + (self.nodes[above + 1] - self.nodes[above]) * weight

    @cached_property
    def inside(self) -> pyvips.Image:
        """255 where the position lies inside the picture, else 0, computed tile by tile."""
        middle = np.array([self.width - 1, self.height - 1]) / 2
        reach = middle + _INSIDE_SLACK
        exact = (self.index.linear((1 / reach).tolist(), (-middle / reach).tolist()).abs() <= 1).bandand()
        if self.row_step == self.col_step == 1:
            return exact
        nodes = np.all(np.abs(self.nodes - middle) <= reach, axis=-1)  # [rows, cols]
        cells = nodes[1:, 1:] & nodes[1:, :-1] & nodes[:-1, 1:] & nodes[:-1, :-1]
        whole = _vips(cells.astype(np.uint8) * 255).zoom(self.col_step, self.row_step)
        whole = whole.crop(0, 0, self.width, self.height)  # most of the picture needs no look at each pixel
        return whole.ifthenelse(255, exact)

    def reach_beyond(self) -> tuple[int, int]:
        """How far the map reaches outside the picture along columns and rows, with room to interpolate [px]."""
        least, most = self.nodes.min(axis=(0, 1)), self.nodes.max(axis=(0, 1))
        beyond = np.maximum(-least, most - np.array([self.width - 1, self.height - 1]))
        cols, rows = (int(np.ceil(max(b, 0))) + 2 for b in beyond)
        return cols, rows

    def moved(self, cols: int, rows: int) -> SamplingGrid:
        """The same map into a picture with so many more pixels at the left and the top."""
        return replace(self, nodes=self.nodes + np.array([cols, rows], dtype=np.float32))


def _in_stored_frame(motion: Motion, in_frame: PositionMap) -> PositionMap:
    """The map between stored positions, given the one between positions of the readout frame."""
    readout, size = motion.readout, motion.readout.frame_size(motion.height, motion.width)

    def in_stored(col: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return readout.points_to_stored(*in_frame(*readout.points_to_frame(col, row, *size)), *size)

    return in_stored


def _first_step(size: int) -> int:
    """Largest power of two up to an eighth of the side: nodes beyond the picture stay near it."""
    return min(1 << max((size // 8).bit_length() - 1, 0), _COARSEST_STEP)


def _compute(position: PositionMap, rows: np.ndarray, cols: np.ndarray, out: np.ndarray) -> None:
    """Writes the map at rows x cols into out [rows, cols, 2]; in bands, to bound memory."""
    band = max(_BAND_POINTS // len(cols), 1)
    for first in range(0, len(rows), band):
        row, col = np.meshgrid(rows[first : first + band].astype(float), cols.astype(float), indexing="ij")
        with np.errstate(all="ignore"):  # far outside, Newton's method may run away
            out[first : first + band, :, 0], out[first : first + band, :, 1] = position(col, row)


def _halved(position: PositionMap, at: list[np.ndarray], nodes: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the nodes, and nodes, with new ones midway between the old ones along an axis."""
    finer_at = np.linspace(at[axis][0], at[axis][-1], 2 * len(at[axis]) - 1).astype(int)
    shape = (len(finer_at), len(at[1]), 2) if axis == 0 else (len(at[0]), len(finer_at), 2)
    finer = np.empty(shape, dtype=np.float32)
    if axis == 0:
        finer[0::2] = nodes
        _compute(position, finer_at[1::2], at[1], finer[1::2])
    else:
        finer[:, 0::2] = nodes
        _compute(position, at[0], finer_at[1::2], finer[:, 1::2])
    return finer_at, finer


def _worst_inside(finer: np.ndarray, axis: int, height: int, width: int) -> float:
    """Largest error [px] of interpolating every other node along an axis, among positions inside."""
    lines = np.moveaxis(finer, axis, 0)
    before, exact, after = lines[:-1:2], lines[1::2], lines[2::2]
    band = max(_BAND_POINTS // exact.shape[1], 1)
    worst = 0.0
    for first in range(0, len(exact), band):
        part = slice(first, first + band)
        error = np.abs(exact[part] - (before[part] + after[part]) / 2).max(axis=-1)
        col, row = exact[part, :, 0], exact[part, :, 1]
        inside = (col >= -1) & (col <= width) & (row >= -1) & (row <= height)
        worst = max(worst, float(error[inside].max(initial=0.0)))
    return worst


def _vips(pixels: np.ndarray) -> pyvips.Image:
    import pyvips

    return pyvips.Image.new_from_array(np.ascontiguousarray(pixels))
