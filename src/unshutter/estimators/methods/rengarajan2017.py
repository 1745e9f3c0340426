"""rengarajan2017: the predecessor's network (ONNX) on a square of 256 px -> motion at 15 key rows -> quadratic.

Trained by ``unshutter.learn``; its weights are too large to be shipped (40 MB and more): ``rengarajan2017@FILE``.
"""

from __future__ import annotations

import os

import numpy as np

from unshutter.estimators.base import View
from unshutter.estimators.methods.kandula2020 import SIZE, motion_of_square, square
from unshutter.estimators.onnx import open_network
from unshutter.motion import Motion

KEY_ROWS = np.arange(0, SIZE, 18)


class Rengarajan2017:
    """Runs the exported network.

    Args:
        weights: path of an exported network; by default the one in the package.
    """

    name = "rengarajan2017"

    def __init__(self, weights: str | os.PathLike[str] | None = None):
        self._session = open_network(self.name, ["rs"], "key_rows", weights)

    def estimate(self, view: View) -> Motion:
        """Quadratic t_x and r_z through the key rows, first row as the reference."""
        (answer,) = self._session.run(None, {"rs": square(view)})
        key_rows = np.asarray(answer, dtype=np.float64)[0]
        motion = motion_of_square(view, KEY_ROWS, key_rows, self.name, degree=2)
        return motion.rereferenced("first")
