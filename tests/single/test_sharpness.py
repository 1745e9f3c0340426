"""The fastest motion that a photo's sharpness allows, on pictures blurred as far as the test says."""

import numpy as np
import pytest
from PIL import Image

from support.drawn_photos import encoded
from support.tagged_files import EXIF
from unshutter import View
from unshutter.motion import Motion, RowMotion
from unshutter.motion.finding import Finding
from unshutter.options import Camera
from unshutter.photo import Photo
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.single.estimator import Estimator
from unshutter.single.methods import find_candidates
from unshutter.single.register import load
from unshutter.single.sharpness import BANDS, EdgeWidths, SpeedLimit, speed_limit

KNOWN = ReadoutTime.of_ms(20, ReadoutSource.GIVEN)


def stripes(blur_x: int = 1, blur_y: int = 1, size: int = 480) -> np.ndarray:
    """uint8 [size, size, 3]: a coarse chessboard, blurred along its rows and columns by boxes [px]."""
    at = np.arange(size)
    board = np.where((at[:, None] // 24 + at[None, :] // 24) % 2, 220.0, 30.0)
    for axis, length in ((1, blur_x), (0, blur_y)):
        board = sum(np.roll(board, k - length // 2, axis) for k in range(length)) / length
    return np.repeat(board.astype(np.uint8)[..., None], 3, axis=2)


def limit_of(pixels: np.ndarray, exposure_s: float = 0.01, readout: ReadoutTime = KNOWN) -> SpeedLimit:
    limit = speed_limit(lambda: EdgeWidths.of(pixels), exposure_s, readout, merged=False)
    assert limit is not None
    return limit


@pytest.mark.parametrize("blur", [3, 6, 12])
def test_blur_along_rows_is_how_far_the_camera_can_have_moved_to_the_side(blur: int) -> None:
    limit = limit_of(stripes(blur))
    np.testing.assert_allclose(limit.tx_px, blur * 2, rtol=0.15)  # the readout is twice as long as the exposure
    np.testing.assert_allclose(limit.ty_px, 2, rtol=0.15)
    np.testing.assert_allclose(limit_of(stripes(1, blur)).ty_px, blur * 2, rtol=0.15)


def test_a_longer_exposure_allows_less_and_a_longer_readout_more() -> None:
    short, long = limit_of(stripes(), 0.001), limit_of(stripes(), 0.1)
    np.testing.assert_allclose(short.tx_px, 100 * long.tx_px)
    twice = limit_of(stripes(), 0.001, ReadoutTime.of_ms(40, ReadoutSource.GIVEN))
    np.testing.assert_allclose(twice.tx_px, 2 * short.tx_px)
    unsure = limit_of(stripes(), 0.001, ReadoutTime.of_ms(10, ReadoutSource.PHONE, plausible_ms=(0, 90)))
    np.testing.assert_allclose(unsure.tx_px, 1.5 * short.tx_px)


def test_bands_that_are_blurred_may_have_moved_faster() -> None:
    half_blurred = np.concatenate([stripes()[:240], stripes(9)[240:]])
    limit = limit_of(half_blurred)
    assert len(limit.tx_px) == BANDS
    np.testing.assert_allclose(limit.tx_px, (2, 2, 18, 18), rtol=0.2)


def test_turning_is_bounded_by_edges_far_from_the_middle() -> None:
    sharp, blurred = limit_of(stripes()), limit_of(stripes(1, 8))
    assert blurred.rz_rad == pytest.approx(8 * sharp.rz_rad, rel=0.2)
    assert sharp.rz_rad == pytest.approx(2 / (0.4 * 480), rel=0.3)  # 2 px over a readout, some 0.4 widths out


def test_noise_does_not_make_a_photo_sharper() -> None:
    blurred = stripes(8).astype(float)
    noisy = np.clip(blurred + np.random.default_rng(0).normal(0, 4, blurred.shape[:2])[..., None], 0, 255)
    np.testing.assert_allclose(limit_of(noisy.astype(np.uint8)).tx_px, 16, rtol=0.45)


def test_what_has_no_exposure_or_no_edges_says_nothing() -> None:
    assert speed_limit(stripes, None, KNOWN, merged=False) is None
    grey = np.full((200, 200, 1), 128, np.uint8)
    assert speed_limit(lambda: EdgeWidths.of(grey), 0.01, KNOWN, merged=False) is None


def test_16_bits_and_grey_say_the_same() -> None:
    grey = stripes(5)[..., :1]
    np.testing.assert_allclose(limit_of(grey).tx_px, limit_of(stripes(5)).tx_px)
    np.testing.assert_allclose(limit_of(grey.astype(np.uint16) * 257).tx_px, limit_of(grey).tx_px)


def test_edges_smeared_to_one_side_show_that_the_camera_moved() -> None:
    def smeared(pixels: np.ndarray) -> float:
        return EdgeWidths.of(pixels).smeared

    assert smeared(stripes(8)) == smeared(stripes(3)) == 1
    assert 0 < smeared(stripes(7, 5)) < 1  # a ratio of 1.4
    assert smeared(stripes(8, 8)) == 0  # out of focus
    assert smeared(stripes(1, 8)) == smeared(stripes(1)) == 0  # up or down, or not at all
    assert smeared(np.full((64, 64, 3), 99, np.uint8)) == 0  # no edges


def sheared(px: float) -> RowMotion:
    return RowMotion.from_polynomials([0, px], [0], 480, 480)


def test_what_would_have_blurred_the_photo_is_refuted() -> None:
    limit = limit_of(stripes(6))  # 12 px over the readout
    assert not limit.refutes(sheared(12))
    assert limit.refutes(sheared(-30))
    assert limit.refutes(RowMotion.from_polynomials([0], [0, 0.2], 480, 480))
    assert not limit.refutes(RowMotion.from_polynomials([0], [0, 0.005], 480, 480))


class Shear(Estimator):
    """Finds 30 px whatever it sees."""

    def estimate(self, view: View) -> Motion:
        return sheared(30)


def test_every_estimators_answer_is_bounded() -> None:
    shear = Shear(load("none").method)
    sharp, blurred = (Photo.from_array(stripes(blur)) for blur in (1, 16))

    def found(photo: Photo, camera: Camera) -> Finding:
        return find_candidates(shear, View(photo, camera))[0].finding

    assert not found(sharp, Camera()).motion.is_zero  # nobody knows how long it was exposed
    told = found(sharp, Camera(exposure_s=0.01, readout_ms=20))
    assert told.motion.is_zero
    assert "too sharp" in str(told.reason)
    assert "1/100 s" in str(told.reason)
    assert not found(blurred, Camera(exposure_s=0.01, readout_ms=20)).motion.is_zero
    assert not found(sharp, Camera(exposure_s=0.0005, readout_ms=20)).motion.is_zero


def test_lines_seen_through_a_fisheye_prove_nothing() -> None:
    """Unless the user states a focal length, and so a straight lens."""
    shear, tags = Shear(load("none").method), Image.Exif()
    tags.get_ifd(EXIF)[0xA434] = "8mm f/3.5 Fish-Eye"
    photo = Photo.from_bytes(encoded(stripes(1), "JPEG", exif=tags.tobytes()))
    told = find_candidates(shear, View(photo))[0].finding
    assert told.motion.is_zero and told.reason == Reason(Code.WIDE_LENS)
    assert not find_candidates(shear, View(photo, Camera(focal_px=400.0)))[0].motion.is_zero
