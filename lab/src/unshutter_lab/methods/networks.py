"""kandula2020 and rengarajan2017: exported networks (ONNX) on the central square of 256 px -> the photo's motion.

Rows beyond the square (tall photos) get the motion extrapolated by the last slope, columns beyond it (wide photos) the
row map's residual at its border. Trained by ``unshutter_lab.training``; the model cards next to the weights describe
how, and how they were compressed.
"""

from __future__ import annotations

import numpy as np

from unshutter.motion import Motion, RowMotion
from unshutter.single.estimator import Estimator, View
from unshutter_lab.methods.onnx import run_network
from unshutter_lab.methods.row_map import RowMapMotion

SIZE = 256  # px of the square


def square_of(view: View) -> np.ndarray:
    """Returns the largest central square of the readout frame: float32 [1, 3, 256, 256], RGB in 0 ... 1."""
    import cv2

    pixels = view.readout.turn(view.photo.to_array())
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    side, (left, top) = side_of(view), corner_of(view)
    pixels = np.ascontiguousarray(pixels[top : top + side, left : left + side, : 3 if pixels.shape[-1] > 2 else 1])
    shrinks = side >= SIZE
    small = cv2.resize(pixels, (SIZE, SIZE), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    scaled = small.reshape(SIZE, SIZE, -1).astype(np.float32) / np.iinfo(pixels.dtype).max
    return np.ascontiguousarray(np.broadcast_to(scaled, (SIZE, SIZE, 3)).transpose(2, 0, 1)[None])


def motion_of_square(
    view: View, rows: np.ndarray, samples: np.ndarray, estimator: str, degree: int | None = None
) -> Motion:
    """Returns the motion of the whole photo from samples [2, N] (t_x [px of 256], r_z [rad]) at rows [N] of its square.

    A polynomial of the degree is fitted; None interpolates linearly.
    """
    scale = side_of(view) / SIZE
    at = (rows + 0.5) * scale - 0.5 + corner_of(view)[1]
    key_rows = at.tolist(), (samples[0] * scale).tolist(), samples[1].tolist()
    common = {"readout": view.readout, "estimator": estimator}
    return RowMotion.from_key_rows(*key_rows, view.height, view.width, degree, **common)


def side_of(view: View) -> int:
    """Number of rows and columns of the photo within the square [px]."""
    return min(view.height, view.width)


def corner_of(view: View) -> tuple[int, int]:
    """(left, top) of the square in the photo [px]."""
    return (view.width - side_of(view)) // 2, (view.height - side_of(view)) // 2


class SquareNetwork(Estimator):
    """Runs an exported network on the square."""

    answer: str  # name of its first output
    shapes: tuple[tuple[int, ...], ...]  # of its outputs, of which only the first is required

    def prepare(self) -> None:
        """Runs a network of the user's once, since its file may be anything."""
        if self.weights != self.method.weights:
            self.run(np.zeros((1, 3, SIZE, SIZE), np.float32))

    def run(self, square: np.ndarray) -> list[np.ndarray]:
        """Returns the outputs for a picture."""
        return [output[0] for output in run_network(self.name, self.weights, square, self.answer, *self.shapes)]


class Kandula2020(SquareNetwork):
    """t_x [px of 256] and r_z [rad] of every row, and the row map, if the network has one."""

    answer, shapes = "motion", ((1, 2, SIZE), (1, SIZE, SIZE))

    def estimate(self, view: View) -> Motion:
        """Returns cubic t_x and r_z with the row map, enlarged to the photo; first row as the reference."""
        trajectory, *row_map = self.run(square_of(view))
        motion = motion_of_square(view, np.arange(SIZE), trajectory, self.name)
        if not row_map:
            return motion.rereferenced("first")
        side = side_of(view)
        mapped = RowMapMotion(
            width=motion.width,
            tx_px=motion.tx_px,
            rz_rad=motion.rz_rad,
            readout=view.readout,
            estimator=self.name,
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
        return motion_of_square(view, KEY_ROWS, key_rows, self.name, degree=2).rereferenced("first")
