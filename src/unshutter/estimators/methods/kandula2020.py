"""kandula2020: the paper's network (ONNX) on a square of 256 px -> row motion, and the row map of its row block.

The square in the middle of the photo is what the network sees. Rows beyond it (tall photos) get the motion that goes
on with the last slope, columns beyond it (wide photos) the row map's residual at its border.
Trained by ``unshutter.learn``; the card beside the weights says how.
"""

from __future__ import annotations

import os

import numpy as np

from unshutter.estimators.base import View
from unshutter.estimators.onnx import open_network
from unshutter.motion import Motion, RowMap, RowMapMotion, RowMotion

SIZE = 256  # px of the square that networks of the paper read


class Kandula2020:
    """Runs the exported network.

    Args:
        weights: path of an exported network; by default the one in the package.
    """

    name = "kandula2020"

    def __init__(self, weights: str | os.PathLike[str] | None = None):
        self._session = open_network(self.name, ["rs"], "motion", weights)

    def estimate(self, view: View) -> Motion:
        """Cubic t_x and r_z with the row map, enlarged to the photo; first row as the reference."""
        trajectory, row_map = self.answer(view)
        motion = motion_of_square(view, np.arange(SIZE), trajectory, self.name)
        if row_map is None:
            return motion.rereferenced("first")
        side = min(view.height, view.width)
        mapped = RowMapMotion(
            width=motion.width,
            tx_px=motion.tx_px,
            rz_rad=motion.rz_rad,
            readout=view.readout,
            estimator=self.name,
            row_map=RowMap(
                residual_px=(row_map - np.arange(SIZE)[:, None]) * (side / SIZE),
                corner=_corner(view),
                size=(side, side),
            ),
        )
        return mapped.rereferenced("first")

    def answer(self, view: View) -> tuple[np.ndarray, np.ndarray | None]:
        """What the network says: trajectory [2, 256] (t_x [px of 256], r_z [rad]) and row map [256, 256], if any."""
        outputs = self._session.run(None, {"rs": square(view)})
        trajectory, *row_map = (np.asarray(output, dtype=np.float64)[0] for output in outputs)
        return trajectory, row_map[0] if row_map else None


def square(view: View) -> np.ndarray:
    """The largest square in the middle of the readout frame: float32 [1, 3, 256, 256], RGB in 0 ... 1."""
    import cv2

    pixels = view.readout.turn(view.photo.to_array())
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    side, (left, top) = min(view.height, view.width), _corner(view)
    pixels = np.ascontiguousarray(pixels[top : top + side, left : left + side, : 3 if pixels.shape[-1] > 2 else 1])
    shrinks = side >= SIZE
    small = cv2.resize(pixels, (SIZE, SIZE), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    scaled = small.reshape(SIZE, SIZE, -1).astype(np.float32) / np.iinfo(pixels.dtype).max
    return np.ascontiguousarray(np.broadcast_to(scaled, (SIZE, SIZE, 3)).transpose(2, 0, 1)[None])


def motion_of_square(view: View, rows: np.ndarray, samples: np.ndarray, name: str, degree: int | None = None) -> Motion:
    """Motion of the whole photo from samples [2, N] (t_x [px of 256], r_z [rad]) at rows [N] of its square.

    Args:
        view: the photo.
        rows: increasing, of 256.
        samples: motion at these rows.
        name: of the estimator.
        degree: of the polynomial to fit; None: straight lines between the samples.
    """
    side = min(view.height, view.width)
    at = (rows + 0.5) * (side / SIZE) - 0.5 + _corner(view)[1]
    tx, rz = samples[0] * (side / SIZE), samples[1]
    about = {"readout": view.readout, "estimator": name}
    return RowMotion.from_key_rows(at.tolist(), tx.tolist(), rz.tolist(), view.height, view.width, degree, **about)


def _corner(view: View) -> tuple[int, int]:
    """(left, top) of the square [px]."""
    side = min(view.height, view.width)
    return (view.width - side) // 2, (view.height - side) // 2
