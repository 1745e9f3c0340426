"""How fast the camera moved, by the smears that it left, on pictures blurred by a known motion."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from unshutter.motion import RowMotion
from unshutter.options import Camera, DecisionOptions
from unshutter.photo import Photo
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.single.estimator import View
from unshutter.single.register import load
from unshutter.single.sharpness import EdgeWidths, speed_limit
from unshutter.single.smear import Smear, smear_of
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.synthesis.row_motions import distorted

READOUT_S, EXPOSURE_S = 0.03, 0.01
KNOWN = ReadoutTime.of_ms(1000 * READOUT_S, ReadoutSource.GIVEN)


def scene(grain: float = 25.0, height: int = 400, width: int = 560) -> np.ndarray:
    """[H, W, 3] rectangles of all sizes and shades, with a grain as fine and as coarse as that of real scenes."""
    rng, picture = np.random.default_rng(2), np.full((height, width, 3), 120, np.uint8)
    for _ in range(120):
        x, y = rng.uniform((0, 0), (width, height)).astype(int)
        w, h = rng.integers(12, 90, 2)
        cv2.rectangle(picture, (int(x), int(y)), (int(x + w), int(y + h)), rng.integers(30, 225, 3).tolist(), -1)
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)) + 1 / width
    fine = np.fft.irfft2(np.fft.rfft2(rng.normal(0, 1, (height, width))) / frequency, (height, width))
    return np.clip(picture + grain * (fine / fine.std())[..., None], 0, 255).astype(np.uint8)


def moved(tx_px: float, bend_px: float = 0.0, grain: float = 25.0) -> tuple[RowMotion, np.ndarray]:
    """(a motion, the scene as a camera takes it that moves so and exposes rows for a third of the readout)."""
    pixels = scene(grain)
    height, width = pixels.shape[:2]
    motion = RowMotion.from_polynomials([0, tx_px, bend_px], [0], height, width)
    return motion, distorted(pixels, motion, height * EXPOSURE_S / READOUT_S)


def smear_in(pixels: np.ndarray, readout: ReadoutTime = KNOWN) -> Smear | None:
    limit = speed_limit(lambda: EdgeWidths.of(pixels), EXPOSURE_S, readout, merged=False)
    assert limit is not None
    return smear_of(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), 1.0, limit, 0.0)


@pytest.mark.parametrize("tx_px", [-60, -30, 30, 45, 100])
def test_the_length_of_smears_says_how_far_the_picture_moved(tx_px: float) -> None:
    smear = smear_in(moved(tx_px)[1])
    assert smear is not None
    assert 400 * smear.speed[0] == pytest.approx(abs(tx_px), rel=0.03)


def test_the_length_of_smears_of_every_row_says_how_the_speed_changes() -> None:
    motion, pixels = moved(10, 40)
    smear = smear_in(pixels)
    assert smear is not None
    expected = np.polyfit(np.linspace(-0.5, 0.5, 400), np.gradient(motion.tx_px), 1)[::-1]  # [rows per row]
    assert smear.speed == pytest.approx(expected, rel=0.2)


def test_smears_of_a_turning_camera_show_its_speed_at_every_row() -> None:
    coefficients, u = np.array([0.1, 0.02, -0.03, 0.05, 0.04, 0.02]), np.linspace(0, 1, 4001)
    tx, rz = (np.gradient(c @ [u, u**2, u**3], u) for c in coefficients.reshape(2, 3))
    speed = np.polyfit(u - 0.5, tx - rz * (u - 0.5), 1)[::-1]
    assert Smear.jacobian() @ coefficients == pytest.approx(speed, abs=0.002)


def test_a_sharp_photo_and_one_that_moved_upwards_show_no_such_smears() -> None:
    assert smear_in(scene()) is None
    upwards = cv2.blur(scene(), (1, 15))
    assert smear_in(upwards) is None
    assert smear_in(cv2.GaussianBlur(scene(), (0, 0), 5)) is None  # out of focus


def test_a_pattern_is_not_a_smear() -> None:
    pixels = scene()
    pixels[:, :, :] = np.where((np.arange(pixels.shape[1]) // 9 % 2)[None, :, None], pixels // 2 + 90, pixels // 2)
    assert smear_in(pixels) is None


def test_small_pictures_and_shutters_that_do_not_roll_show_nothing() -> None:
    pixels = moved(45)[1]
    assert smear_in(pixels[:100, :100]) is None
    assert smear_in(pixels, ReadoutTime.of_ms(0, ReadoutSource.LEAF)) is None


def test_a_smeared_photo_is_moved_as_far_as_its_smears_say() -> None:
    motion, pixels = moved(42, 10, grain=22)
    photo = Photo.from_array(pixels, EXPOSURE_S)
    method = load("segment-manhattan")
    told = View(photo, Camera(readout_ms=1000 * READOUT_S, roll_deg=0, tilt_deg=0))
    first, second, still = method.candidates(told)
    zero = RowMotion.zero(motion.height, motion.width)
    assert motion_error(first.motion, motion).epe < 0.4 * motion_error(zero, motion).epe
    assert first.probability > 0.8 > 0.2 > second.probability and still.motion.is_zero
    assert first.probability + second.probability == pytest.approx(1)
    assert np.sign(first.motion.tx_px[-1]) == -np.sign(second.motion.tx_px[-1])
    unknown = method.candidates(View(photo, Camera(roll_deg=0, tilt_deg=0)))  # how long the readout took
    assert unknown[0].probability != first.probability


def test_a_smeared_photo_is_left_alone_until_its_direction_is_likely_or_stated() -> None:
    pixels = scene(grain=22)
    height, width = pixels.shape[:2]
    leaning = np.array(
        [[1, -42 / height, 21], [0, 1, 0]]
    )  # as much as the motion, the other way: verticals look upright
    askew = cv2.warpAffine(pixels, leaning, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    motion = RowMotion.from_polynomials([0, 42], [0], height, width)
    photo = Photo.from_array(distorted(askew, motion, height * EXPOSURE_S / READOUT_S), EXPOSURE_S)
    method, camera = load("segment-manhattan"), Camera(readout_ms=1000 * READOUT_S)
    still, first, second = method.candidates(View(photo, camera))
    assert still.motion.is_zero and still.finding.reason == Reason(Code.WHICH_WAY)
    assert first.probability < 0.8 and first.probability + second.probability == pytest.approx(1)
    assert still.finding.confidence == first.probability
    for way, sign in (("left", 1), ("right", -1)):
        stated = method.candidates(View(photo, replace(camera, moving=way)))[0]
        assert stated.probability > 0.95 and np.sign(stated.motion.tx_px[-1]) == sign
    bold = method.candidates(View(photo, camera, decision=DecisionOptions(0.3)))[0]
    assert bold.motion.tx_px == pytest.approx(first.motion.tx_px)
