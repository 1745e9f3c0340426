"""What Python takes for a photo, and gives back in kind."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import unshutter
from support.drawn_photos import drawn
from support.sure_estimator import Sure
from unshutter.errors import UnshutterError
from unshutter.options import MIN_CONFIDENCE
from unshutter.photo import Photo

MOTION = unshutter.RowMotion.from_polynomials([0, 9], [0], 120, 160)
UNSURE = Sure(MIN_CONFIDENCE / 2)


@pytest.fixture
def pixels() -> np.ndarray:
    return drawn(120, 160)


def test_rectified_tells_of_whatever_it_is_given(pixels: np.ndarray) -> None:
    result = unshutter.rectified(pixels, motion=MOTION)
    assert result.changed and result.motion == MOTION
    np.testing.assert_array_equal(result.to_array(), unshutter.rectify(pixels, motion=MOTION))
    encoded = Photo.from_array(pixels).to_bytes("png")
    np.testing.assert_array_equal(unshutter.rectified(encoded, motion=MOTION, edges="keep").pixels, result.pixels)
    assert not unshutter.rectified(pixels, estimator=UNSURE).changed


def test_automatic_edges_keep_the_coordinates_of_pixels_and_crop_files(pixels: np.ndarray) -> None:
    encoded = Photo.from_array(pixels).to_bytes("png")
    choices: tuple[dict[str, Any], ...] = ({}, {"edges": "auto"})
    for edges in choices:
        assert unshutter.rectify(pixels, motion=MOTION, **edges).shape == pixels.shape
        assert unshutter.rectified(Image.fromarray(pixels), motion=MOTION, **edges).edges == "keep"
        cropped = unshutter.rectified(encoded, motion=MOTION, **edges)
        assert cropped.edges == "crop" and cropped.pixels.shape < pixels.shape


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("bands", [None, 1, 3])
def test_floating_point_from_0_to_1(dtype: type, bands: int | None, pixels: np.ndarray) -> None:
    given = pixels[..., :bands] if bands else pixels[..., 0]
    found = unshutter.rectify((given / 255).astype(dtype), motion=MOTION)
    assert (found.dtype, found.shape) == (dtype, given.shape)
    # 16 bits in between, where 8 bits are rounded
    assert np.abs(found - unshutter.rectify(given, motion=MOTION) / 255).max() < 1.5 / 255
    same = (given / 255).astype(dtype)
    np.testing.assert_array_equal(unshutter.rectify(same, estimator=UNSURE), same, strict=True)


@pytest.mark.parametrize("wrong", [-0.01, 1.01, np.nan, np.inf])
def test_floating_point_of_another_range_is_refused(wrong: float) -> None:
    pixels = np.full((100, 100), 0.5)
    pixels[3, 4] = wrong
    with pytest.raises(UnshutterError, match="between 0 and 1: scale them first"):
        unshutter.rectify(pixels, motion=MOTION)


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA", "I;16"])
def test_pillow_images_come_back_as_such(mode: str, pixels: np.ndarray) -> None:
    if mode == "I;16":
        given = Image.fromarray(pixels[..., 0].astype(np.uint16) * 257)
    else:
        given = Image.fromarray(pixels).convert(mode)
    given.info = {"icc_profile": b"as it was"}
    found = unshutter.rectify(given, motion=MOTION)
    assert isinstance(found, Image.Image)
    assert (found.mode, found.size, found.info) == (mode, given.size, given.info)
    np.testing.assert_array_equal(np.asarray(found), unshutter.rectify(np.asarray(given), motion=MOTION))
    left = unshutter.rectify(given, estimator=UNSURE)
    assert left is not given and left.tobytes() == given.tobytes()


@pytest.mark.parametrize("mode", ["P", "1", "CMYK", "F"])
def test_pillow_images_of_other_modes_are_refused(mode: str) -> None:
    with pytest.raises(UnshutterError, match=f"mode {mode} is not taken: convert it first"):
        unshutter.rectify(Image.new(mode, (160, 120)), motion=MOTION)


def test_open_files_and_buffers(pixels: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    Photo.from_array(pixels).save(path)
    data = path.read_bytes()
    expected = unshutter.rectify(path, motion=MOTION).pixels
    with path.open("rb") as stream:
        np.testing.assert_array_equal(unshutter.rectify(stream, motion=MOTION).pixels, expected)
    np.testing.assert_array_equal(unshutter.rectify(io.BytesIO(data), motion=MOTION).pixels, expected)
    for kind in (bytearray, memoryview):
        assert unshutter.rectify(kind(data), estimator=UNSURE) == data
    with (
        pytest.raises(UnshutterError, match="binary mode"),
        (tmp_path / "text").open("w+") as stream,
    ):
        unshutter.rectify(stream, motion=MOTION)


def test_a_motion_by_the_name_of_its_file(pixels: np.ndarray, tmp_path: Path) -> None:
    MOTION.save(tmp_path / "m.json")
    for name in (tmp_path / "m.json", str(tmp_path / "m.json")):
        expected = unshutter.rectify(pixels, motion=MOTION)
        np.testing.assert_array_equal(unshutter.rectify(pixels, motion=name), expected)


@pytest.mark.parametrize("nothing", [None, {"a": 1}, object()])
def test_what_is_no_photo_gets_a_sentence(nothing: object) -> None:
    with pytest.raises(UnshutterError, match=r"a photo is a path, bytes, .*; got"):
        unshutter.rectify(nothing, motion=MOTION)  # type: ignore[call-overload]


def test_what_is_missing_is_a_file_that_is_not_found(tmp_path: Path) -> None:
    for ask in (
        lambda: unshutter.rectify(tmp_path / "no.jpg"),
        lambda: unshutter.Motion.load(tmp_path / "no.json"),
        lambda: unshutter.load(f"segment-transformer@{tmp_path}/no.onnx"),
    ):
        with pytest.raises(FileNotFoundError, match="cannot read") as caught:
            ask()
        assert isinstance(caught.value, unshutter.UnshutterError)
        assert isinstance(caught.value, unshutter.MissingFileError)


def test_frames_are_opened_as_photos_are(tmp_path: Path) -> None:
    pixels = drawn(120, 160)
    Photo.from_array(pixels).save(tmp_path / "a.png")
    data = (tmp_path / "a.png").read_bytes()
    kinds = [tmp_path / "a.png", data, io.BytesIO(data), pixels, Image.fromarray(pixels), Photo.from_array(pixels)]
    for kind, again in zip(kinds, [*kinds[:2], io.BytesIO(data), *kinds[3:]], strict=True):
        assert all(motion.is_zero for motion in unshutter.estimate_frames([kind, again], readout_ratio=0.5))
    made = list(unshutter.rectify_frames([Image.fromarray(pixels)] * 2, readout_ratio=0.5))
    assert all(isinstance(each, Image.Image) for each in made)
