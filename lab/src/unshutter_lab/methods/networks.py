"""kandula2020-research and rengarajan2017: exported networks (ONNX) on the central square of 256 px -> the motion.

The row map continues beyond the square (wide photos) with its residual at the border. Trained by
``unshutter_lab.training``; the model cards next to the weights describe how, and how they were compressed.
"""

from __future__ import annotations

import numpy as np

from unshutter.motion import Motion
from unshutter.single.estimator import Estimator, View
from unshutter.single.row_network import SIZE, as_input, corner_of, motion_of_square, side_of, square_of
from unshutter_lab.methods.onnx import run_network
from unshutter_lab.methods.row_map import RowMapMotion


class SquareNetwork(Estimator):
    """Runs an exported network on the square."""

    answer: str  # name of its first output
    shapes: tuple[tuple[int, ...], ...]  # of its outputs, of which only the first is required

    def prepare(self) -> None:
        """Runs a network of the user's once, since its file may be anything."""
        if self.weights != self.method.weights:
            self.run(np.zeros((SIZE, SIZE, 3), np.uint8))

    def run(self, square: np.ndarray) -> list[np.ndarray]:
        """Returns the outputs for a square."""
        outputs = run_network(self.name, self.weights, as_input(square), self.answer, *self.shapes)
        return [output[0] for output in outputs]


class Kandula2020Research(SquareNetwork):
    """t_x [px of 256] and r_z [rad] of every row, and the row map, if the network has one."""

    answer, shapes = "motion", ((1, 2, SIZE), (1, SIZE, SIZE))

    def estimate(self, view: View) -> Motion:
        """Returns cubic t_x and r_z with the row map, enlarged to the photo; first row as the reference."""
        trajectory, *row_map = self.run(square_of(view))
        motion = motion_of_square(view, np.arange(SIZE), trajectory)
        if not row_map:
            return motion.rereferenced("first")
        side = side_of(view)
        mapped = RowMapMotion(
            width=motion.width,
            tx_px=motion.tx_px,
            rz_rad=motion.rz_rad,
            scan_direction=view.scan_direction,
            residual_px=(row_map[0] - np.arange(SIZE)[:, None]) * (side / SIZE),
            corner=corner_of(view),
            size=(side, side),
        )
        return mapped.rereferenced("first")


KEY_ROWS = np.arange(0, SIZE, 18)


class Rengarajan2017(SquareNetwork):
    """t_x [px of 256] and r_z [rad] at the key rows."""

    answer, shapes = "key_rows", ((1, 2, len(KEY_ROWS)),)

    def estimate(self, view: View) -> Motion:
        """Returns quadratic t_x and r_z through the key rows, first row as the reference."""
        key_rows = self.run(square_of(view))[0]
        return motion_of_square(view, KEY_ROWS, key_rows, degree=2).rereferenced("first")
