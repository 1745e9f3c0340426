"""Distance between a stabilised view and the border of its frame's content, on all four sides.

Lengths are in heights of the readout frame, measured from its centre: a frame extends from -1/2 to 1/2 down and from
-aspect/2 to aspect/2 across.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from unshutter.geometry.rotations import rotation_matrix
from unshutter.motion import Motion

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float32, Float64

_PLACES = 9  # positions along each side at which the frame's border is stored
_POINTS = 5  # points on each side of a view that are checked, corners included
_HALVINGS, _LARGEST_ZOOM = 24, 4.0
LEFT, RIGHT, TOP, BOTTOM = range(4)


def borders_of(motion: Motion, aspect: float) -> Float32[np.ndarray, "4 9"]:
    """Returns the extent of a frame on its left, right, upper and lower sides once its motion is undone.

    Given at nine positions along each side, as the least extent near each of them.

    Args:
        motion: the part of a frame's motion that is undone.
        aspect: width of the readout frame divided by its height.
    """
    at = np.linspace(-0.5, 0.5, _PLACES)
    ends = np.array([[-0.5 * aspect], [0.5 * aspect], [-0.5], [0.5]]) + np.zeros(_PLACES)
    if motion.is_zero:
        return ends.astype(np.float32)
    height, width = motion.height, motion.width
    down, across = np.linspace(-0.5, height - 0.5, 2 * height), np.linspace(-0.5, width - 0.5, 2 * _PLACES)
    signs = (1, -1, 1, -1)
    sides = (
        (np.full_like(down, -0.5), down),
        (np.full_like(down, width - 0.5), down),
        (across, np.full_like(across, -0.5)),
        (across, np.full_like(across, height - 0.5)),
    )
    for side, (col, row) in enumerate(sides):
        x, y = motion.rs_to_gs(col, row)
        x, y = ((x + 0.5) / width - 0.5) * aspect, (y + 0.5) / height - 0.5
        along, reach = (y, x) if side in (LEFT, RIGHT) else (x / aspect, y)
        known = np.isfinite(along) & np.isfinite(reach)
        place = np.clip(np.rint((along[known] - at[0]) * (_PLACES - 1)), 0, _PLACES - 1).astype(int)
        least = np.full(_PLACES, -np.inf)
        np.maximum.at(least, place, signs[side] * reach[known])
        ends[side] = np.where(np.isfinite(least), signs[side] * least, ends[side])
    return ends.astype(np.float32)


def _outline(aspect: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[points] x and y of points on the border of a view, and the side on which each lies."""
    t = np.linspace(-0.5, 0.5, _POINTS)
    x = np.concatenate([np.full(_POINTS, -0.5), np.full(_POINTS, 0.5), t, t]) * aspect
    y = np.concatenate([t, t, np.full(_POINTS, -0.5), np.full(_POINTS, 0.5)])
    return x, y, np.repeat(np.arange(4), _POINTS)


def margins(
    borders: Float32[np.ndarray, "frames 4 9"],
    turns: Float64[np.ndarray, "frames 3"],
    focal: float,
    zoom: float | Float64[np.ndarray, "frames"],
    aspect: float,
) -> tuple[Float64[np.ndarray, "frames points"], Float64[np.ndarray, "frames points 3"]]:
    """Returns how far points on the outlines of views lie inside their frames, and how further rotation changes that.

    Args:
        borders: extent of the frames' content (:func:`borders_of`).
        turns: rotation vectors from the stabilised camera to the real camera [rad].
        focal: focal length [heights].
        zoom: zoom of all views, or of each.
        aspect: width of the readout frame divided by its height.

    Returns:
        Lengths, negative outside, and their derivatives with respect to the rotation [per rad].
    """
    x, y, side = _outline(aspect)
    size = np.asarray(zoom, np.float64).reshape(-1, 1)
    rays = np.stack(np.broadcast_arrays(x / size / focal, y / size / focal, 1.0), axis=-1)
    rays = np.broadcast_to(rays, (len(turns), *rays.shape[1:]))
    x, y, z = np.moveaxis(np.einsum("nij,npj->npi", rotation_matrix(turns), rays), -1, 0)
    x, y = x / z, y / z
    upright = side < TOP
    along = np.where(upright, y * focal, x * focal / aspect)
    place = np.clip((along + 0.5) * (_PLACES - 1), 0, _PLACES - 1)
    before = np.minimum(place.astype(int), _PLACES - 2)
    frames = np.arange(len(turns))[:, None]
    ends = [borders[frames, side, before + k].astype(np.float64) for k in (0, 1)]
    end = ends[0] + (ends[1] - ends[0]) * (place - before)
    inward = np.where((side == LEFT) | (side == TOP), 1.0, -1.0)
    across = np.stack([-x * y, 1 + x * x, -y], axis=-1)
    down = np.stack([-(1 + y * y), x * y, x], axis=-1)
    slopes = (inward * focal)[:, None] * np.where(upright[:, None], across, down)
    return inward * (np.where(upright, x, y) * focal - end), slopes


def zoom_needed(
    borders: Float32[np.ndarray, "frames 4 9"], turns: Float64[np.ndarray, "frames 3"], focal: float, aspect: float
) -> Float64[np.ndarray, "frames"]:
    """Returns the least zoom, 1 to 4, at which each view stays inside its frame's border; see :func:`margins`."""
    low, high = np.ones(len(turns)), np.full(len(turns), _LARGEST_ZOOM)
    fits = margins(borders, turns, focal, low, aspect)[0].min(axis=1) >= 0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        inside = margins(borders, turns, focal, middle, aspect)[0].min(axis=1) >= 0
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    return np.where(fits, 1.0, high)
