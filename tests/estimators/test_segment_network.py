"""The shipped network on segments."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from unshutter import UnshutterError
from unshutter.estimators.register import method
from unshutter.estimators.segment_network import SegmentNetwork

SEGMENTS = np.random.default_rng(0).uniform(-0.5, 0.5, (30, 4))


def shipped() -> SegmentNetwork:
    return SegmentNetwork(method("segment-transformer").weights_path)


def test_it_is_opened_once_though_several_threads_ask() -> None:
    network = shipped()
    with ThreadPoolExecutor(4) as threads:
        assert len(set(threads.map(lambda _: id(network.open()), range(8)))) == 1


def test_neither_order_nor_ends_of_segments_matter() -> None:
    network = shipped()
    expected = network.coefficients(SEGMENTS)
    assert expected.shape == (2, 3)
    np.testing.assert_allclose(network.coefficients(SEGMENTS[::-1]), expected, atol=1e-5)
    np.testing.assert_allclose(network.coefficients(SEGMENTS[:, [2, 3, 0, 1]]), expected, atol=1e-5)
    assert not np.allclose(network.coefficients(SEGMENTS, up=(1, 0)), expected, atol=1e-3)


def test_without_weights_it_says_so() -> None:
    with pytest.raises(UnshutterError, match="needs the weights"):
        SegmentNetwork(None).open()
