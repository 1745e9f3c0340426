"""The view of a stabilised camera: a frame as if the camera had pointed elsewhere when it was taken."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from unshutter.geometry.readout import Readout
from unshutter.geometry.rotations import rotate_position, rotation_matrix

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64


@dataclass(frozen=True, eq=False)
class SteadyView:
    """Direction and zoom of the stabilised camera relative to the real one.

    Attributes:
        turn: [3] rotation vector [rad] that takes directions of the stabilised camera to those of the real camera at
            the reference row, in the axes of the readout frame (geometry/rotations.py).
        focal_heights: focal length in heights of the readout frame.
        zoom: enlargement of the picture, at least 1.
        readout: direction in which the stored pixels were read.
    """

    turn: Float64[np.ndarray, "3"]
    focal_heights: float
    zoom: float
    readout: Readout

    def zoomed(self, zoom: float) -> SteadyView:
        """Returns this view at another zoom."""
        return replace(self, zoom=zoom)

    def looks(self, col: np.ndarray, row: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
        """Maps positions in the stabilised picture to the global-shutter frame at the reference row.

        Args:
            col, row: positions in the stabilised picture [px, stored].
            height, width: size of the stored frame [px].
        """
        rows, columns = self.readout.frame_size(height, width)
        middle = (columns - 1) / 2, (rows - 1) / 2
        col, row = self.readout.points_to_frame(col, row, height, width)
        col, row = ((at - centre) / self.zoom + centre for at, centre in zip((col, row), middle, strict=True))
        turned = np.broadcast_to(rotation_matrix(self.turn), (*col.shape, 3, 3))
        seen = rotate_position(col, row, turned, self.focal_heights * rows, middle)
        return self.readout.points_to_stored(*seen, height, width)
