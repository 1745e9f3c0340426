"""Warps batches of pictures by batches of row motions; differentiable in pictures, positions and motions.

Positions are (col, row) [px] of an r x r picture, pixel centres at integers. A motion is a tensor [B, 2, r]: t_x [px]
and r_z [rad] of every row, with the signs of geometry/rows.py.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from unshutter.geometry import rows as geometry


def pixel_grid(size: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Returns (col [1, size], row [size, 1]) of every pixel."""
    line = torch.arange(size, dtype=like.dtype, device=like.device)
    return line[None], line[:, None]


def sample(pictures: Tensor, col: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Samples pictures bilinearly at positions.

    Args:
        pictures: [B, C, H, W].
        col, row: [B, h, w] positions [px].

    Returns:
        [B, C, h, w] values, exactly 0 at positions outside the picture; [B, 1, h, w] 1 inside, 0 outside.
    """
    height, width = pictures.shape[-2:]
    inside = ((col >= 0) & (col <= width - 1) & (row >= 0) & (row <= height - 1))[:, None].to(pictures.dtype)
    grid = torch.stack([col * (2 / (width - 1)) - 1, row * (2 / (height - 1)) - 1], -1)
    values = F.grid_sample(pictures, grid, mode="bilinear", padding_mode="border", align_corners=True)
    return values * inside, inside


def polynomial_motion(tx: Tensor, rz: Tensor, size: int) -> geometry.MotionAtRow:
    """Returns the row motion with coefficients [B, K] in u = row / size, for rows that broadcast to [B, h, w]."""
    return geometry.row_motion_from_polynomial(tx[:, None, None], rz[:, None, None], first=0.0, last=float(size))


def sampled_motion(motion: Tensor) -> geometry.MotionAtRow:
    """Returns the row motion of a batch by linear interpolation of its samples [B, 2, r], for rows [B, h, w]."""
    last = motion.shape[-1] - 1

    def row_motion(v: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        inside = v.clamp(0, last)
        below = inside.detach().floor().clamp(max=last - 1)
        weight = (inside - below).flatten(1)[:, None]  # [B, 1, h w]
        # a motion that folds has no inverse everywhere: v may be NaN, and then so is the result
        index = below.nan_to_num().long().flatten(1)[:, None].expand(-1, 2, -1)
        low, high = motion.gather(2, index), motion.gather(2, index + 1)
        tx, rz = (low + (high - low) * weight).unflatten(2, v.shape[1:]).unbind(1)
        moving = (v >= 0) & (v <= last)
        return tx, rz, (high - low)[:, 1].view_as(v) * moving

    return row_motion


def rs_positions(motion: Tensor, row_map: Tensor | None, center_shift: Tensor | float = 0.0) -> tuple[Tensor, Tensor]:
    """Returns the RS position (col, row) [px] of every GS pixel, each [B, r, r].

    Args:
        motion: [B, 2, r] t_x [px] and r_z [rad] of every row.
        row_map: [B, r, r] row whose motion applies to each GS pixel; None for the row that read it (exact inverse).
        center_shift: shift of the rotation centre along the columns [px], 0 or [B, 1, 1].
    """
    size = motion.shape[-1]
    look_up, center = sampled_motion(motion), ((size - 1) / 2 + center_shift, (size - 1) / 2)
    col, row = (a.expand(len(motion), size, size) for a in pixel_grid(size, motion))
    if row_map is None:
        return geometry.gs_to_rs(col, row, look_up, center)
    tx, rz, _ = look_up(row_map)
    return geometry.gs_to_rs_by_row_map(col, row, tx, rz, center)


def from_first_row(motion: Tensor) -> tuple[Tensor, Tensor]:
    """Returns a motion [B, 2, r] with the first row as its reference, and the shift [B, 1, 1] of its centre.

    A network's output is not constrained to zero in the first row; ``Motion.rereferenced`` explains the shift.
    """
    return motion - motion[..., :1], motion[:, 0, :1, None]
