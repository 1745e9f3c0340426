"""The small transformer that estimates row motion from line segments, from either kind of weights file.

Used by several methods. Trained by ``unshutter_lab.training`` on drawn scenes; the card next to the weights describes
how.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import Lock

import numpy as np

from unshutter.errors import WeightsError
from unshutter.estimators.onnx import open_network

MOST_SEGMENTS = 320  # limit of its training; the longest are used
_NAME = "segment-transformer"
_START_OF_NPZ = b"PK"

Network = Callable[[np.ndarray], np.ndarray]  # tokens [N, 6] -> coefficients [2, 3]


class SegmentNetwork:
    """The network, opened when first needed. Thread-safe.

    Args:
        weights: an .npz file, run in NumPy, or an exported network (ONNX).
    """

    def __init__(self, weights: Path | None):
        self._weights = weights
        self._network: Network | None = None
        self._opening = Lock()

    def open(self) -> Network:
        """Returns the network, opening it the first time.

        Raises:
            WeightsError: the file is missing, or is not this network.
        """
        with self._opening:
            if self._network is None:
                self._network = _opened(self._weights)
            return self._network

    def coefficients(self, segments: np.ndarray, up: tuple[int, int] = (0, -1)) -> np.ndarray:
        """Runs the network.

        Args:
            segments: [N, 4] end points in centred units of rows (segments.py).
            up: unit vector (right, down) towards the top of the scene.

        Returns:
            [2, 3] coefficients of u, u^2, u^3 with u = (row + 1/2) / rows: t_x [rows], r_z [rad].

        Raises:
            WeightsError: the file turns out not to be this network.
        """
        tokens = np.concatenate([segments, np.broadcast_to(np.asarray(up), (len(segments), 2))], axis=1)
        return self.open()(tokens.astype(np.float32))


def _opened(weights: Path | None) -> Network:
    if weights is None:
        raise WeightsError(f"{_NAME} needs the weights of a network")
    try:
        with open(weights, "rb") as stream:
            is_npz = stream.read(len(_START_OF_NPZ)) == _START_OF_NPZ
    except OSError as error:
        raise WeightsError(f"cannot read the weights {weights}: {error.strerror or error}") from None
    return _in_numpy(weights) if is_npz else _in_onnx(weights)


def _in_numpy(weights: Path) -> Network:
    from unshutter.estimators.segment_transformer.network import SegmentTransformer
    from unshutter.estimators.segment_transformer.weights import read_weights

    network = SegmentTransformer(read_weights(weights, _NAME))

    def run(tokens: np.ndarray) -> np.ndarray:
        coefficients = network.coefficients(tokens)
        if not np.isfinite(coefficients).all():
            raise WeightsError(f"cannot use the weights {weights}: their answer is not a number")
        return coefficients.astype(np.float64)

    return run


def _in_onnx(weights: Path) -> Network:
    network = open_network(_NAME, weights, ["tokens", "mask"], "coefficients", opens_fast=True)

    def run(tokens: np.ndarray) -> np.ndarray:
        inputs = {"tokens": tokens[None], "mask": np.ones((1, len(tokens)), dtype=bool)}
        return network.answers(inputs, (1, 2, 3))[0][0]

    return run
