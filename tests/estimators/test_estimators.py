import json
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

import unshutter
from unshutter import Motion, RowMotion
from unshutter.cli import main
from unshutter.estimators.lines.segments import find_segments, in_rows
from unshutter.evaluation.metrics import motion_error
from unshutter.options import DEFAULT_ESTIMATOR
from unshutter.photo import Photo


def test_segments_of_a_drawn_edge_lie_on_it() -> None:
    """Dark up to column 99, bright from column 100: the edge is at 99.5, pixel centres at whole numbers."""
    grey = np.zeros((200, 160), np.uint8)
    grey[:, 100:] = 255
    for picture, edge in ((grey, slice(0, 4, 2)), (np.ascontiguousarray(grey.T), slice(1, 4, 2))):
        (found,) = find_segments(picture)
        np.testing.assert_allclose(found[edge], 99.5, atol=0.1)


def test_segments_come_longest_first_and_in_rows() -> None:
    grey = np.zeros((200, 300), np.uint8)
    grey[20:180, 40:60] = 255
    grey[50:100, 200:280] = 200
    found = find_segments(grey)
    lengths = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
    assert (np.diff(lengths) <= 0).all()
    np.testing.assert_array_equal(find_segments(grey, 2), found[:2])
    corners = in_rows(np.array([[0.0, 0.0, 299.0, 199.0]]), 200, 300)
    np.testing.assert_allclose(corners, [[-149.5 / 200, -99.5 / 200, 149.5 / 200, 99.5 / 200]])
    assert find_segments(np.zeros((64, 64), np.uint8)).shape == (0, 4)


def test_the_shipped_model_finds_the_motion_of_a_photo(basilica: tuple[np.ndarray, Motion]) -> None:
    picture, truth = basilica
    found = unshutter.estimate(picture)
    nothing = motion_error(RowMotion.zero(truth.height, truth.width), truth).epe
    assert nothing > 5
    assert (found.height, found.width, found.estimator) == (truth.height, truth.width, DEFAULT_ESTIMATOR)
    assert found.tx_px[0] == found.rz_rad[0] == 0
    assert motion_error(found, truth).epe < 0.35 * nothing


def test_an_undistorted_facade_is_left_nearly_alone(facade: np.ndarray) -> None:
    found = unshutter.estimate(facade)
    assert np.abs(found.tx_px).max() * 256 / found.height < 2.5
    assert np.degrees(np.abs(found.rz_rad).max()) < 1


def test_the_size_of_the_photo_does_not_matter_much(basilica: tuple[np.ndarray, Motion]) -> None:
    picture, truth = basilica
    half = np.asarray(picture.reshape(245, 2, 245, 2, 3).mean((1, 3)), np.uint8)
    found = unshutter.estimate(half).resized(490, 490)
    assert motion_error(found, truth).epe < 0.5 * motion_error(RowMotion.zero(490, 490), truth).epe


def test_mirroring_mirrors_the_motion(basilica: tuple[np.ndarray, Motion]) -> None:
    """Up to what the detector finds differently."""
    picture, _ = basilica
    found, mirrored = unshutter.estimate(picture), unshutter.estimate(picture[:, ::-1].copy())
    opposite = RowMotion(found.width, -mirrored.tx_px, -mirrored.rz_rad)
    assert motion_error(opposite, found).epe < 1.0


def test_without_segments_it_says_so_and_does_nothing() -> None:
    grey = np.full((200, 300), 128, np.uint8)
    motion = unshutter.estimate(grey)
    assert motion.is_zero
    assert "0 straight segments" in motion.reason
    assert json.loads(motion.to_json())["reason"] == motion.reason
    np.testing.assert_array_equal(unshutter.rectify(grey), grey)


def test_a_panorama_is_declined() -> None:
    motion = unshutter.estimate(np.zeros((100, 400), np.uint8))
    assert motion.is_zero
    assert "2.5 times" in motion.reason


@pytest.mark.parametrize("name", ["segment-transformer", "segment-manhattan", "kandula2020", "rengarajan2017"])
def test_weights_that_are_none_are_told_in_one_line(
    name: str, tmp_path: Path, rolling_facade: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, text = tmp_path / "photo.png", tmp_path / "text.onnx"
    Photo.from_array(rolling_facade).save(photo)
    text.write_text("no network")
    other = files("unshutter") / "weights" / ("segment-transformer.onnx" if "20" in name else "kandula2020.onnx")
    for command in (["rectify", str(photo), "-o", str(tmp_path / "out.png")], ["estimate", str(photo)]):
        for weights, told in ((text, "PROTOBUF"), (other, "they are not of")):
            assert main([*command, "--estimator", f"{name}@{weights}"]) == 1
            message = capsys.readouterr().err
            assert message.count("\n") == 1 and "cannot use the weights" in message and told in message
    assert not (tmp_path / "out.png").exists()
