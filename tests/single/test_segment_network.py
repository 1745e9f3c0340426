"""The shipped network on segments, and files of weights that are not its."""

import math
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest

from unshutter import UnshutterError, version
from unshutter.cli import main
from unshutter.single.network import SegmentNetwork, Weights, gelu, read_weights, write_weights
from unshutter.single.register import method

SEGMENTS = np.random.default_rng(0).uniform(-0.5, 0.5, (30, 4))


def shipped() -> SegmentNetwork:
    return SegmentNetwork(method("segment-transformer").weights)


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


def test_the_mirror_image_is_worked_on_at_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    both = Barrier(2)
    alone = SegmentNetwork._correction

    def correction(self, tokens: np.ndarray, motion: np.ndarray) -> np.ndarray:
        both.wait(10)
        return alone(self, tokens, motion)

    expected = shipped().coefficients(SEGMENTS)
    monkeypatch.setattr(SegmentNetwork, "_correction", correction)
    np.testing.assert_array_equal(shipped().coefficients(SEGMENTS), expected)
    np.testing.assert_array_equal(shipped().coefficients(SEGMENTS * [-1, 1, -1, 1]), -expected)


def test_without_weights_it_says_so() -> None:
    with pytest.raises(UnshutterError, match="needs the weights"):
        SegmentNetwork(None).open()


def test_gelu_is_that_of_the_error_function() -> None:
    x = np.concatenate([np.linspace(-12, 12, 40_001), [-1e30, -1e5, 0, 1e5, 1e30]]).astype(np.float32)
    expected = [v * (1 + math.erf(v / math.sqrt(2))) / 2 for v in x.astype(float)]
    with np.errstate(over="ignore"):
        np.testing.assert_allclose(gelu(x.copy()), expected, rtol=3e-7, atol=3e-7)


def test_the_default_needs_no_onnxruntime(photo: Path) -> None:
    program = "import sys; sys.modules['onnxruntime'] = None\nimport unshutter; unshutter.estimate(sys.argv[1])"
    done = subprocess.run([sys.executable, "-c", program, photo], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "")


@pytest.fixture(scope="module")
def weights() -> Weights:
    path = method("segment-transformer").weights
    assert path is not None
    return read_weights(path)


def test_scores_that_exp_cannot_take_are_no_trouble(weights: Weights, tmp_path: Path) -> None:
    """Softmax does not care for a shift of its scores; the two ways to it must agree."""
    large = {**weights, "blocks.attention.query.weight": 40 * weights["blocks.attention.query.weight"]}
    write_weights(tmp_path / "large.npz", large)
    assert np.isfinite(SegmentNetwork(tmp_path / "large.npz").coefficients(SEGMENTS)).all()


def test_weights_in_16_bits_do_nearly_the_same(weights: Weights, tmp_path: Path) -> None:
    halves = {name: array if array.ndim == 0 else array.astype(np.float16) for name, array in weights.items()}
    write_weights(tmp_path / "half.npz", halves)
    expected = shipped().coefficients(SEGMENTS)
    found = SegmentNetwork(tmp_path / "half.npz").coefficients(SEGMENTS)
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert (found != expected).any()


def without(weights: Weights, name: str) -> Weights:
    return {each: array for each, array in weights.items() if each != name}


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda w: without(w, "head.output.bias"), "they are not segment-transformer weights"),
        (lambda w: {**w, "more": np.zeros(3, np.float32)}, "they are not segment-transformer weights"),
        (lambda w: {**w, "head.output.bias": np.zeros((3, 3), np.float32)}, "they are not segment-transformer weights"),
        (lambda w: {**w, "head.output.bias": np.zeros(9, np.int32)}, "they are not segment-transformer weights"),
        (lambda w: {**w, "heads": np.array(7)}, "they are not segment-transformer weights"),
        (lambda w: {**w, "heads": np.array(0)}, "they are not segment-transformer weights"),
        (lambda w: {**w, "iterations": np.array(10**9)}, "they are not segment-transformer weights"),
        (lambda w: {**w, "latents": np.zeros((10, 2_000_000), np.float32)}, " MB are too many for segment-transformer"),
        (lambda w: {**w, "head.output.bias": np.array([print] * 9, object)}, "damaged, or not an .npz"),
        (lambda w: {**w, "head.output.bias": np.full(9, np.nan, np.float32)}, "their answer is not a number"),
        (lambda w: {**w, "head.output.bias": np.full(9, 3e38, np.float32)}, "their answer is not a number"),
    ],
)
def test_other_weights_are_refused_in_one_line(
    changed, told: str, weights: Weights, tmp_path: Path, photo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.savez(tmp_path / "odd.npz", **changed(weights))
    assert main(["estimate", str(photo), "--estimator", f"segment-manhattan@{tmp_path / 'odd.npz'}"]) == 1
    message = capsys.readouterr().err
    assert (
        message.count("\n") == 1 and f"cannot use the weights {tmp_path / 'odd.npz'}: " in message and told in message
    )


def test_damaged_files_are_refused(weights: Weights, tmp_path: Path) -> None:
    write_weights(tmp_path / "whole.npz", weights)
    whole, path = (tmp_path / "whole.npz").read_bytes(), tmp_path / "damaged.npz"
    for data in (whole[:-9], whole[:5000], whole[:60] + b"x" * 40 + whole[100:]):
        path.write_bytes(data)
        with pytest.raises(UnshutterError, match="damaged, or not an"):
            SegmentNetwork(path).open()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("heads.npy", "no array")
    with pytest.raises(UnshutterError, match="they are not segment-transformer weights"):
        SegmentNetwork(path).open()
    with pytest.raises(UnshutterError, match="cannot read the weights"):
        SegmentNetwork(tmp_path).open()


def test_an_onnx_file_says_what_to_do(tmp_path: Path, photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "model.onnx").write_bytes(b"any")
    assert main(["estimate", str(photo), "--estimator", f"segment-transformer@{tmp_path / 'model.onnx'}"]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "needs an .npz file" in message and version.lab("train") in message


def test_incomplete_weights_are_not_written(weights: Weights, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not the weights"):
        write_weights(tmp_path / "odd.npz", without(weights, "heads"))
    assert not list(tmp_path.iterdir())
