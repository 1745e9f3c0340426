"""How far a steady view stays inside what its frame shows, on all four sides.

Lengths are counted in heights of the readout frame from its middle: a frame reaches from -1/2 to 1/2 down and from
-aspect/2 to aspect/2 across.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from unshutter.geometry.rotations import rotation_matrix
from unshutter.motion import Motion

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float32, Float64

_PLACES = 9  # along each side at which it is known where the frame ends
_POINTS = 5  # of each side of a view that are looked at, corners among them
_HALVINGS, _LARGEST_ZOOM = 24, 4.0
LEFT, RIGHT, TOP, BOTTOM = range(4)


def borders_of(motion: Motion, aspect: float) -> Float32[np.ndarray, "4 9"]:
    """How far a frame reaches on its left, right, upper and lower side once its motion is undone.

    At nine places along each side, where it reaches least near them.

    Args:
        motion: the part of a frame's motion that is undone.
        aspect: width of the readout frame by its height.
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
    """[points] x, y of places on the border of a view, and the side on which each lies."""
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
    """How far places on the outlines of views lie inside their frames, and by how much a further turn changes that.

    Args:
        borders: what the frames show (:func:`borders_of`).
        turns: rotation vectors from the steady camera to the one that took the frame [rad].
        focal: focal length [heights].
        zoom: of all views, or of each.
        aspect: width of the readout frame by its height.

    Returns:
        Lengths, negative outside, and their slopes for turns [per rad].
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
    """The least zoom, 1 to 4, at which each view shows nothing beyond its frame's border; see :func:`margins`."""
    low, high = np.ones(len(turns)), np.full(len(turns), _LARGEST_ZOOM)
    fits = margins(borders, turns, focal, low, aspect)[0].min(axis=1) >= 0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        inside = margins(borders, turns, focal, middle, aspect)[0].min(axis=1) >= 0
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    return np.where(fits, 1.0, high)
