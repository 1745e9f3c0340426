"""kandula2020: the paper's network (ONNX) on a square of 256 px -> row motion, and the row map of its row block.

Columns beyond the square (wide photos) get the row map's residual at its border.

Trained by ``unshutter_lab.training``; the model card next to the weights describes how.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unshutter.estimators.base import Estimator, View
from unshutter.estimators.method import Method
from unshutter.estimators.onnx import open_network
from unshutter.motion import Motion, RowMap, RowMapMotion
from unshutter_lab.methods.square import SIZE, corner_of, motion_of_square, side_of, square_of


class Kandula2020(Estimator):
    """Runs the exported network."""

    def __init__(self, method: Method, weights: Path | None = None):
        super().__init__(method, weights)
        self._network = open_network(self.name, weights, ["rs"], "motion")

    def estimate(self, view: View) -> Motion:
        """Returns cubic t_x and r_z with the row map, enlarged to the photo; first row as the reference."""
        trajectory, row_map = self._answer(view)
        motion = motion_of_square(view, np.arange(SIZE), trajectory, self.name)
        if row_map is None:
            return motion.rereferenced("first")
        side = side_of(view)
        mapped = RowMapMotion(
            width=motion.width,
            tx_px=motion.tx_px,
            rz_rad=motion.rz_rad,
            readout=view.readout,
            estimator=self.name,
            row_map=RowMap(
                residual_px=(row_map - np.arange(SIZE)[:, None]) * (side / SIZE),
                corner=corner_of(view),
                size=(side, side),
            ),
        )
        return mapped.rereferenced("first")

    def _answer(self, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """Returns the network's trajectory [2, 256] (t_x [px of 256], r_z [rad]) and row map [256, 256], if any."""
        trajectory, *row_map = self._network.answers({"rs": square_of(view)}, (1, 2, SIZE), (1, SIZE, SIZE))
        return trajectory[0], row_map[0][0] if row_map else None
