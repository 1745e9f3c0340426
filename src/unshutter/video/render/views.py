"""Views of a clip's frames, by the camera itself, a stabilised or a straightened one, and where each samples its frame.

Borders and views of a stabilised camera are in heights of the readout frame, measured from its centre: a frame extends
from -1/2 to 1/2 down and from -aspect/2 to aspect/2 across.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from unshutter.frames.flow import bilinear
from unshutter.motion import Motion
from unshutter.motion.grid import SamplingGrid, gs_to_rs_map
from unshutter.motion.lens import Lens
from unshutter.motion.rotations import rotate_position, rotation_matrix
from unshutter.motion.shapes import Float32, Float64
from unshutter.orientation import ScanDirection

_PLACES = 9  # positions along each side at which the frame's border is stored
_POINTS = 5  # points on each side of a view that are checked, corners included
_HALVINGS = 24
_LARGEST_ZOOM = 4.0
LEFT, RIGHT, TOP, BOTTOM = range(4)


def borders_of(motion: Motion, aspect: float) -> Float32[np.ndarray, "4 9"]:
    """Returns the extent of a frame on its left, right, upper and lower sides once its motion is undone.

    Given at nine positions along each side, as the least extent near each of them.

    Args:
        motion: the part of a frame's motion that is undone.
    """
    at = np.linspace(-0.5, 0.5, _PLACES)
    ends = np.array([[-0.5 * aspect], [0.5 * aspect], [-0.5], [0.5]]) + np.zeros(_PLACES)
    if motion.is_zero:
        return ends.astype(np.float32)
    height = motion.height
    width = motion.width
    down = np.linspace(-0.5, height - 0.5, 2 * height)
    across = np.linspace(-0.5, width - 0.5, 2 * _PLACES)
    signs = (1, -1, 1, -1)
    sides = (
        (np.full_like(down, -0.5), down),
        (np.full_like(down, width - 0.5), down),
        (across, np.full_like(across, -0.5)),
        (across, np.full_like(across, height - 0.5)),
    )
    every = motion.rs_to_gs(*np.concatenate([np.stack(side) for side in sides], axis=1))
    ends_of_sides = np.cumsum([len(col) for col, _ in sides])[:-1]
    for side, (x, y) in enumerate(zip(*(np.split(each, ends_of_sides) for each in every), strict=True)):
        x = ((x + 0.5) / width - 0.5) * aspect
        y = (y + 0.5) / height - 0.5
        along, reach = (y, x) if side in (LEFT, RIGHT) else (x / aspect, y)
        known = np.isfinite(along) & np.isfinite(reach)
        place = np.clip(np.rint((along[known] - at[0]) * (_PLACES - 1)), 0, _PLACES - 1).astype(int)
        least = np.full(_PLACES, -np.inf)
        np.maximum.at(least, place, signs[side] * reach[known])
        ends[side] = np.where(np.isfinite(least), signs[side] * least, ends[side])
    return ends.astype(np.float32)


def outline(aspect: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[points] x and y of points on the border of a view, and the side on which each lies."""
    t = np.linspace(-0.5, 0.5, _POINTS)
    x = np.concatenate([np.full(_POINTS, -0.5), np.full(_POINTS, 0.5), t, t]) * aspect
    y = np.concatenate([t, t, np.full(_POINTS, -0.5), np.full(_POINTS, 0.5)])
    return x, y, np.repeat(np.arange(4), _POINTS)


def margins(
    borders: Float32[np.ndarray, "frames 4 9"],
    rotations: Float64[np.ndarray, "frames 3"],
    focal: float,
    zoom: float | Float64[np.ndarray, "frames"],
    aspect: float,
    lens: Lens | None = None,
) -> tuple[Float64[np.ndarray, "frames points"], Float64[np.ndarray, "frames points 3"]]:
    """Returns how far points on the outlines of views lie inside their frames, and how further rotation changes that.

    Args:
        rotations: rotation vectors from the stabilised camera to the real camera [rad].
        focal: focal length [heights].
        lens: the lens, if it bends straight lines.

    Returns:
        Lengths, negative outside, and their derivatives with respect to the rotation [per rad].
    """
    x, y, side = outline(aspect)
    size = np.asarray(zoom, np.float64).reshape(-1, 1)
    x = x / size / focal
    y = y / size / focal
    rays = np.stack(np.broadcast_arrays(*((x, y, 1.0) if lens is None else lens.direction(x, y))), axis=-1)
    rays = np.broadcast_to(rays, (len(rotations), *rays.shape[1:]))
    ray = np.moveaxis(np.einsum("nij,npj->npi", rotation_matrix(rotations), rays), -1, 0)
    x, y = (ray[0] / ray[2], ray[1] / ray[2]) if lens is None else lens.position(*ray)
    upright = side < TOP
    inward = np.where((side == LEFT) | (side == TOP), 1.0, -1.0)
    across = np.stack([-x * y, 1 + x * x, -y], axis=-1)
    down = np.stack([-(1 + y * y), x * y, x], axis=-1)
    if lens is not None:
        across, down = (np.cross(np.moveaxis(ray, 0, -1), np.stack(each, axis=-1)) for each in lens.slopes(*ray))
    slopes = (inward * focal)[:, None] * np.where(upright[:, None], across, down)
    return depths(borders, x * focal, y * focal, side, aspect), slopes


def depths(
    borders: Float32[np.ndarray, "frames 4 9"], x: np.ndarray, y: np.ndarray, side: np.ndarray, aspect: float
) -> Float64[np.ndarray, "frames points"]:
    """Returns how far positions near the sides of frames lie inside their borders [heights]; negative outside.

    Args:
        x, y: [points] or [frames, points], from the centre [heights].
        side: [points] the side that each is near to.
    """
    upright = side < TOP
    place = np.clip((np.where(upright, y, x / aspect) + 0.5) * (_PLACES - 1), 0, _PLACES - 1)
    before = np.minimum(place.astype(int), _PLACES - 2)
    frames = np.arange(len(borders))[:, None]
    ends = [borders[frames, side, before + k].astype(np.float64) for k in (0, 1)]
    end = ends[0] + (ends[1] - ends[0]) * (place - before)
    inward = np.where((side == LEFT) | (side == TOP), 1.0, -1.0)
    return inward * (np.where(upright, x, y) - end)


def zoom_needed(
    borders: Float32[np.ndarray, "frames 4 9"],
    rotations: Float64[np.ndarray, "frames 3"],
    focal: float,
    aspect: float,
    lens: Lens | None = None,
) -> Float64[np.ndarray, "frames"]:
    """Returns the least zoom, 1 to 4, at which each view stays inside its frame's border; see :func:`margins`."""
    low = np.ones(len(rotations))
    high = np.full(len(rotations), _LARGEST_ZOOM)
    fits = margins(borders, rotations, focal, low, aspect, lens)[0].min(axis=1) >= 0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        inside = margins(borders, rotations, focal, middle, aspect, lens)[0].min(axis=1) >= 0
        low = np.where(inside, low, middle)
        high = np.where(inside, middle, high)
    return np.where(fits, 1.0, high)


@dataclass(frozen=True, eq=False)
class SteadyView:
    """Direction and zoom of the stabilised camera relative to the real one."""

    # [3] rotation vector [rad] that takes directions of the stabilised camera to those of the real camera at the
    # reference row, in the axes of the readout frame (motion/rotations.py)
    rotation: Float64[np.ndarray, "3"]
    focal_heights: float  # focal length in heights of the readout frame
    zoom: float  # enlargement of the picture, at least 1
    scan_direction: ScanDirection  # direction in which the stored pixels were read
    lens: Lens | None = None  # the lens, if it bends straight lines

    def to_source(self, col: np.ndarray, row: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        """Maps positions in the stabilised picture to the global-shutter frame at the reference row."""
        rows, columns = self.scan_direction.frame_size(height, width)
        middle = (columns - 1) / 2, (rows - 1) / 2
        col, row = self.scan_direction.points_to_frame(col, row, height, width)
        col, row = ((at - centre) / self.zoom + centre for at, centre in zip((col, row), middle, strict=True))
        rotated = np.broadcast_to(rotation_matrix(self.rotation), (*col.shape, 3, 3))
        seen = rotate_position(col, row, rotated, self.focal_heights * rows, middle, self.lens)
        return self.scan_direction.points_to_stored(*seen, height, width)


@dataclass(frozen=True)
class StraightView:
    """The picture of a camera that stands where the real one does, with a lens that keeps lines straight."""

    lens: Lens  # the real camera's
    focal: float  # focal length [heights of the readout frame]
    scan_direction: ScanDirection  # direction in which the stored pixels were read

    @classmethod
    def of(cls, lens: Lens, scan_direction: ScanDirection, aspect: float) -> StraightView:
        """Returns the widest view that shows no border of the real frames, up to 120 degrees from corner to corner."""
        x, y, _ = outline(aspect)
        for focal in np.hypot(aspect, 1) / 2 / np.tan(np.radians(np.linspace(60, 1, 473))):
            col, row = lens.position(x / focal, y / focal, 1.0)
            if np.abs(col).max() <= aspect / 2 / lens.focal and np.abs(row).max() <= 0.5 / lens.focal:
                break
        return cls(lens, float(focal), scan_direction)

    def degrees(self, aspect: float) -> float:
        """Returns its field of view from corner to corner of frames of this width per height [degrees]."""
        return 2 * float(np.degrees(np.arctan(np.hypot(aspect, 1) / 2 / self.focal)))

    def to_source(self, col: np.ndarray, row: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        """Maps positions in the straightened picture to the global-shutter frame."""
        rows, columns = self.scan_direction.frame_size(height, width)
        col, row = self.scan_direction.points_to_frame(col, row, height, width)
        middle = (columns - 1) / 2, (rows - 1) / 2
        x, y = self.seen((col - middle[0]) / rows, (row - middle[1]) / rows)
        return self.scan_direction.points_to_stored(x * rows + middle[0], y * rows + middle[1], height, width)

    def seen(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Maps positions, from the centre [heights], in the straightened picture to the global-shutter frame."""
        seen = self.lens.position(x / self.focal, y / self.focal, 1.0)
        return seen[0] * self.lens.focal, seen[1] * self.lens.focal

    def enlarged(self, zoom: float) -> StraightView:
        """Returns the view of a camera with a longer focal length."""
        return replace(self, focal=self.focal * zoom)


View: TypeAlias = SteadyView | StraightView
_NODES = 24  # approximate number of rows of nodes; 0.7 to 1.4 times as many
_LEAST_STEP = 8  # px between nodes, a multiple of every subsampling
_FINE_STEP = 4  # px between nodes for the dense model


def grid_of_motion(motion: Motion, height: int, width: int, view: View | None = None) -> SamplingGrid:
    """Returns where a rectified frame of height x width [px] samples the original.

    Args:
        motion: motion of a picture of the same shape and any size: positions are scaled up, centre to centre.
        view: the stabilised or straightened view to show; None for the camera's own view.
    """
    small = motion.scan_direction.frame_size(motion.height, motion.width)
    scale = np.array([small[1] / width, small[0] / height])[:, None, None]  # px of the motion per px of the frame
    to_source = gs_to_rs_map(motion)

    def position(col: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        seen = (_seen(view, col, row, height, width) + 0.5) * scale - 0.5
        col, row = (np.stack(to_source(seen[0], seen[1])) + 0.5) / scale - 0.5
        return col, row

    step = max(_LEAST_STEP, 1 << round(np.log2(min(height, width) / _NODES)))
    return SamplingGrid.of_cells(position, step, height, width)


def grid_of_flow(
    shift: Float32[np.ndarray, "rows columns 2"],
    scan_direction: ScanDirection,
    height: int,
    width: int,
    view: View | None = None,
) -> SamplingGrid:
    """Returns where a frame of height x width [px] is sampled if every pixel has its own shift.

    Args:
        shift: (columns, rows) [px of a small copy of the readout frame], at each pixel of that copy.
    """
    size = scan_direction.frame_size(height, width)
    scale = np.array([size[1] / shift.shape[1], size[0] / shift.shape[0]])

    def position(col: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        seen = _seen(view, col, row, height, width)
        at = np.stack(scan_direction.points_to_frame(seen[0], seen[1], height, width), axis=-1)
        in_copy = ((at + 0.5) / scale - 0.5).astype(np.float32)
        to_source = at + bilinear(shift, in_copy) * scale
        return scan_direction.points_to_stored(to_source[..., 0], to_source[..., 1], height, width)

    step = max(_FINE_STEP, 1 << int(np.log2(max(size[0] / shift.shape[0], 1))))
    return SamplingGrid.of_cells(position, step, height, width)


def _seen(view: View | None, col: np.ndarray, row: np.ndarray, height: int, width: int) -> np.ndarray:
    """[2, N, M] positions that a view shows there: col and row [px] of the global-shutter frame."""
    return np.stack((col, row) if view is None else view.to_source(col, row, height, width))
