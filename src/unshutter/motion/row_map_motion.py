"""A motion with the paper's row map, which says which row's motion each pixel of the GS picture is given."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.geometry import rows as geometry
from unshutter.motion.motion import Motion, Reference


@dataclass(frozen=True, eq=False)
class RowMapMotion(Motion):
    """Row motion whose GS -> RS map follows a row map (paper, row block) instead of the exact inverse.

    ``gs_to_rs`` differs from that of a plain :class:`Motion` by the row map's error; ``rs_to_gs`` is the same. The
    file form keeps t_x and r_z only.

    Attributes:
        row_residual: [h, w] row map less the pixel's own row [px], over the square from ``corner``.
        corner: (left, top) of that square in the readout frame [px].
        side: of that square [px]; beyond it the residual of its border goes on.
        map_pose: (t_x [px], r_z [rad]) of the GS picture in the frame for which the row map was made.
    """

    row_residual: np.ndarray = field(default_factory=lambda: np.zeros((2, 2)))
    corner: tuple[int, int] = (0, 0)
    side: int = 2
    map_pose: tuple[float, float] = (0.0, 0.0)

    def gs_to_rs(self, col: Any, row: Any) -> tuple[np.ndarray, np.ndarray]:
        """GS positions [px] of the readout frame -> RS positions [px], Eq. 1 with the row map's motion."""
        col, row = np.broadcast_arrays(np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64))
        middle = ((self.width - 1) / 2, (self.height - 1) / 2)
        turned, moved = np.float64(self.map_pose[1]), self.map_pose[0]
        mapped_col, mapped_row = geometry.rs_to_gs(col, row, moved, turned, middle)
        seen_by = np.clip(mapped_row + self._residual(mapped_col, mapped_row), 0, self.height - 1)
        tx, rz, _ = self._at(seen_by)
        return geometry.gs_to_rs_by_row_map(col, row, tx, rz, self.center)

    def rereferenced(self, reference: Reference) -> RowMapMotion:
        """The same camera motion, with the picture taken at another row's moment; exact."""
        row = replace(self, reference=reference).reference_row
        pose = (self.map_pose[0] + float(self.tx_px[row]), self.map_pose[1] + float(self.rz_rad[row]))
        return replace(super().rereferenced(reference), map_pose=pose)  # type: ignore[return-value]

    def resized(self, height: int, width: int) -> Motion:
        """Its own size only: a row map belongs to one photo.

        Raises:
            UnshutterError: another size.
        """
        if (height, width) != (self.height, self.width):
            raise UnshutterError("a motion with a row map cannot be resized: estimate it for the photo itself")
        return self

    def scaled(self, strength: float) -> RowMapMotion:
        """Motion and row map times ``strength``."""
        pose = (self.map_pose[0] * strength, self.map_pose[1] * strength)
        residual = self.row_residual * strength
        return replace(super().scaled(strength), row_residual=residual, map_pose=pose)  # type: ignore[return-value]

    def _residual(self, col: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Row map less the row [px], bilinear."""
        height, width = self.row_residual.shape
        x = (col - self.corner[0] + 0.5) * (width / self.side) - 0.5
        y = (row - self.corner[1] + 0.5) * (height / self.side) - 0.5
        return _bilinear(self.row_residual, np.nan_to_num(x), np.nan_to_num(y))


def _bilinear(table: np.ndarray, col: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Values of a table [h, w] at positions, the border's beyond it."""
    height, width = table.shape
    x, y = np.clip(col, 0, width - 1), np.clip(row, 0, height - 1)
    left, top = (np.minimum(np.floor(p).astype(int), last) for p, last in ((x, width - 2), (y, height - 2)))
    u, v = x - left, y - top
    above = table[top, left] * (1 - u) + table[top, left + 1] * u
    below = table[top + 1, left] * (1 - u) + table[top + 1, left + 1] * u
    return above * (1 - v) + below * v
