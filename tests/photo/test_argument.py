"""What Python takes for a photo, and the kinds of what it gives back."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import unshutter
from support.drawn_photos import drawn, one_line
from support.sure_estimator import Sure
from unshutter.errors import UnshutterError
from unshutter.options import MIN_CONFIDENCE
from unshutter.photo import Photo

MOTION = unshutter.RowMotion.from_polynomials([0, 9], [0], 120, 160)
UNSURE = Sure(MIN_CONFIDENCE / 2)


@pytest.fixture
def pixels() -> np.ndarray:
    return drawn(120, 160)


def kinds(pixels: np.ndarray, folder: Path) -> list[Any]:
    """All that stands for a photo of these pixels."""
    photo = Photo.from_array(pixels)
    photo.save(folder / "a.png", overwrite=True)
    data = photo.to_bytes("png")
    return [folder / "a.png", str(folder / "a.png"), data, io.BytesIO(data), pixels, Image.fromarray(pixels), photo]


def test_the_result_is_the_same_whatever_is_given(pixels: np.ndarray, tmp_path: Path) -> None:
    expected = unshutter.rectify(pixels, motion=MOTION)
    assert expected.edges == "crop" and expected.array.shape < pixels.shape
    for given in kinds(pixels, tmp_path):
        result = unshutter.rectify(given, motion=MOTION)
        assert isinstance(result, unshutter.Rectified) and result.changed and result.motion == MOTION
        for made in (result.array, np.asarray(result.image), Photo.from_bytes(result.bytes).pixels):
            np.testing.assert_array_equal(made, expected.pixels)
        result.save(tmp_path / "b.png", overwrite=True)
        np.testing.assert_array_equal(Photo.open(tmp_path / "b.png").pixels, expected.pixels)
    assert not unshutter.rectify(pixels, estimator=UNSURE).changed
    assert unshutter.rectify(pixels, motion=MOTION, edges="keep").array.shape == pixels.shape


def test_an_array_is_a_copy(pixels: np.ndarray) -> None:
    result = unshutter.rectify(pixels, motion=MOTION)
    result.array[:] = 0
    assert result.array.any()


def test_an_image_of_a_file_has_its_exif_and_profile(pixels: np.ndarray) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", exif=exif, icc_profile=b"profile")
    image = unshutter.rectify(stream.getvalue(), motion=MOTION).image
    assert image.getexif()[0x0112] == 6 and image.info["icc_profile"] == b"profile"


def test_an_image_of_16_bit_colours_has_8(pixels: np.ndarray) -> None:
    image = unshutter.rectify(pixels.astype(np.uint16) * 257, estimator=UNSURE).image
    np.testing.assert_array_equal(np.asarray(image), pixels)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("bands", [None, 1, 3])
def test_floating_point_from_0_to_1(dtype: type, bands: int | None, pixels: np.ndarray) -> None:
    given = pixels[..., :bands] if bands else pixels[..., 0]
    found = unshutter.rectify((given / 255).astype(dtype), motion=MOTION, edges="keep").array
    assert (found.dtype, found.shape) == (dtype, given.shape)
    # 16 bits in between, where 8 bits are rounded
    assert np.abs(found - unshutter.rectify(given, motion=MOTION, edges="keep").array / 255).max() < 1.5 / 255
    same = (given / 255).astype(dtype)
    np.testing.assert_array_equal(unshutter.rectify(same, estimator=UNSURE).array, same, strict=True)


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
    found = unshutter.rectify(given, motion=MOTION, edges="keep").image
    assert (found.mode, found.size, found.info) == (mode, given.size, given.info)
    expected = unshutter.rectify(np.asarray(given), motion=MOTION, edges="keep").array
    np.testing.assert_array_equal(np.asarray(found), expected)
    left = unshutter.rectify(given, estimator=UNSURE).image
    assert left is not given and left.tobytes() == given.tobytes()


@pytest.mark.parametrize("mode", ["P", "1", "CMYK", "F"])
def test_pillow_images_of_other_modes_are_refused(mode: str) -> None:
    with pytest.raises(UnshutterError, match=f"mode {mode} is not supported: convert it first"):
        unshutter.rectify(Image.new(mode, (160, 120)), motion=MOTION)


def test_open_files_and_buffers(pixels: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    Photo.from_array(pixels).save(path)
    data = path.read_bytes()
    expected = unshutter.rectify(path, motion=MOTION).pixels
    with path.open("rb") as stream:
        np.testing.assert_array_equal(unshutter.rectify(stream, motion=MOTION).pixels, expected)
    for kind in (bytearray, memoryview):
        assert unshutter.rectify(kind(data), estimator=UNSURE).bytes == data
    with (
        pytest.raises(UnshutterError, match="binary mode"),
        (tmp_path / "text").open("w+") as stream,
    ):
        unshutter.rectify(stream, motion=MOTION)


def test_a_motion_by_the_name_of_its_file(pixels: np.ndarray, tmp_path: Path) -> None:
    MOTION.save(tmp_path / "m.json")
    for name in (tmp_path / "m.json", str(tmp_path / "m.json")):
        expected = unshutter.rectify(pixels, motion=MOTION).pixels
        np.testing.assert_array_equal(unshutter.rectify(pixels, motion=name).pixels, expected)


@pytest.mark.parametrize("nothing", [None, {"a": 1}, object(), 5, 0.5, True, np.float32(1)])
def test_what_is_no_photo_gets_a_sentence(nothing: object) -> None:
    with pytest.raises(UnshutterError, match=r"a photo is a path, bytes, .*; got") as error:
        unshutter.rectify(nothing, motion=MOTION)  # type: ignore[arg-type]
    one_line(error)


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
    for pair in zip(kinds(pixels, tmp_path), kinds(pixels, tmp_path), strict=True):
        assert all(found.motion.is_zero for found in unshutter.estimate_frames(pair, readout_ratio=0.5))
    made = list(unshutter.rectify_frames(kinds(pixels, tmp_path), readout_ratio=0.5))
    assert len(made) == 7 and all(isinstance(each, unshutter.RectifiedFrame) for each in made)
    np.testing.assert_array_equal(made[5].image, pixels)


def test_whole_numbers_of_another_type() -> None:
    with pytest.raises(UnshutterError, match="uint8, uint16, or floating point from 0 to 1, got int64"):
        unshutter.rectify(np.zeros((80, 80), np.int64))


@pytest.mark.parametrize("head", [b"\0\0\0\x18ftypmp42", b"\x1a\x45\xdf\xa3\x01\0\0", b"RIFF\0\0\0\0AVI LIST"])
def test_a_clip_is_led_to_its_function(head: bytes) -> None:
    with pytest.raises(UnshutterError, match=r"is a video, not a photo: .*unshutter\.rectify_clip"):
        unshutter.rectify(head + bytes(1000))
