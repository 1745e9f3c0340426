"""Interpolation and extrapolation of per-row values, and resampling to another number of rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UsageError
from unshutter.options import Reference

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float, Float64

BEYOND = 128  # rows beyond the first and last to which a motion is extrapolated smoothly


def row_index(reference: Reference, height: int) -> int:
    """Returns the index of a reference row.

    Raises:
        UsageError: unknown reference row.
    """
    rows = {"first": 0, "middle": height // 2, "last": height - 1}
    if reference not in rows:
        raise UsageError(f"unknown reference row '{reference}': choose first, middle or last")
    return rows[reference]


def matching_rows(height: int, new_height: int) -> Float64[np.ndarray, "{new_height}"]:
    """[new_height] positions, by row centres, of the rows of a picture scaled to ``new_height`` in the original."""
    return (np.arange(new_height) + 0.5) * (height / new_height) - 0.5


def interpolated(
    at: Float[np.ndarray, "rows"], known_at: Float[np.ndarray, "known"], values: Float[np.ndarray, "known"]
) -> Float[np.ndarray, "rows"]:
    """Interpolates linearly, extrapolating the first and last slopes beyond the ends."""
    inner = np.interp(at, known_at, values)
    if len(known_at) < 2:
        return inner
    first = (values[1] - values[0]) / (known_at[1] - known_at[0])
    last = (values[-1] - values[-2]) / (known_at[-1] - known_at[-2])
    before = np.minimum(at - known_at[0], 0.0) * first
    after = np.maximum(at - known_at[-1], 0.0) * last
    return inner + before + after


def slope(values: Float[np.ndarray, "rows *rest"]) -> Float[np.ndarray, "rows *rest"]:
    """Returns the change per row of values [H, ...] with at least two rows."""
    return np.gradient(values, axis=0, edge_order=2 if len(values) > 2 else 1)


def positions(col: object, row: object) -> tuple[Float64[np.ndarray, "*at"], Float64[np.ndarray, "*at"]]:
    """Returns two float64 arrays broadcast to a common shape."""
    col, row = np.broadcast_arrays(np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64))
    return col, row
