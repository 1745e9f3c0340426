"""The product's kandula2020, which OpenCV runs, next to onnxruntime on the same file."""

import numpy as np
import pytest

from support.drawn_photos import drawn
from unshutter.single.register import method
from unshutter.single.row_network import SIZE, RowNetwork, as_input
from unshutter_lab.methods.onnx import run_network


@pytest.mark.parametrize("kind", ["street", "noise"])
def test_opencv_answers_as_onnxruntime_does(kind: str) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (SIZE, SIZE, 3), np.uint8)
    square = drawn(SIZE, SIZE) if kind == "street" else noise
    weights = method("kandula2020").weights
    (expected,) = run_network("kandula2020", weights, as_input(square), "motion", (1, 2, SIZE))
    found = RowNetwork("kandula2020", weights).motion_of(square)
    assert np.abs(expected[0, 0]).max() > 0.5
    np.testing.assert_allclose(found, expected[0], atol=1e-4)
    np.testing.assert_allclose(found[1], expected[0, 1], atol=2e-6)
