"""Rows that are exposed for a while: blurred by their own motion, and no further."""

import json

import numpy as np
import pytest

from support.drawn_photos import encoded, one_line, textured
from unshutter.errors import UsageError
from unshutter.motion import RowMotion
from unshutter.motion.warp import distort_pixels
from unshutter.photo import Photo
from unshutter_lab.synthesis.options import Synthesize
from unshutter_lab.synthesis.pairs import synthesize_folder
from unshutter_lab.synthesis.row_motions import distorted


def _light(pixels: np.ndarray) -> np.ndarray:
    """SRGB by its definition."""
    value = pixels / np.iinfo(pixels.dtype).max
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_an_edge_becomes_a_ramp_as_long_as_it_moved_meanwhile(dtype: type) -> None:
    """An even pan of 0.5 px a row, 24 rows of exposure: 12 px of blur, half of it on each side of the edge."""
    canvas = np.zeros((80, 120, 1), dtype)
    canvas[:, 60:] = np.iinfo(dtype).max
    motion = RowMotion(120, 0.5 * (np.arange(80.0) - 40), np.zeros(80))
    light = _light(distorted(canvas, motion, 24)[..., 0])
    for row in (20, 40, 60):
        edge = 59.5 + motion.tx_px[row]
        expected = np.clip((np.arange(120) - edge) / 12 + 0.5, 0, 1)
        inside = slice(20, 100)  # beyond, the canvas ends
        assert np.abs(light[row] - expected)[inside].max() < 0.06  # as far as the moments are apart


def test_a_turn_blurs_far_from_the_centre_only() -> None:
    canvas = textured(120, 120)
    motion = RowMotion(120, np.zeros(120), 0.002 * (np.arange(120.0) - 60))
    sharp, blurred = distort_pixels(canvas, motion).astype(float), distorted(canvas, motion, 60).astype(float)
    change = np.abs(sharp - blurred).mean(axis=-1)
    assert change[58:62, 58:62].mean() < 0.2 * change[55:65, 5:15].mean()


def test_no_exposure_and_no_motion_blur_nothing() -> None:
    canvas = textured(96, 96)
    moving = RowMotion(96, 0.1 * np.arange(96.0), np.zeros(96))
    assert np.array_equal(distorted(canvas, moving, 0), distort_pixels(canvas, moving))
    assert np.array_equal(distorted(canvas, RowMotion.zero(96, 96), 500), canvas)


def test_the_exposure_is_in_the_files(tmp_path) -> None:
    photo = tmp_path / "a.png"
    photo.write_bytes(encoded(textured(128, 128), "PNG"))
    small = {"size": 64, "canvas": 96}
    exposed = Synthesize(readout_ms=30, exposure_s=0.01, **small)
    assert synthesize_folder([photo], tmp_path / "blurred", exposed) == []
    assert synthesize_folder([photo], tmp_path / "sharp", Synthesize(**small)) == []
    blurred, sharp = (Photo.open(tmp_path / name / "rs" / "a_00.png") for name in ("blurred", "sharp"))
    assert blurred.exposure_s() == pytest.approx(0.01) and sharp.exposure_s() is None
    assert not np.array_equal(blurred.pixels, sharp.pixels)
    for same in ("gs/a_00.png", "motion/a_00.json"):
        assert (tmp_path / "blurred" / same).read_bytes() == (tmp_path / "sharp" / same).read_bytes()
    manifest = json.loads((tmp_path / "blurred" / "manifest.json").read_text())
    assert (manifest["exposure_s"], manifest["readout_ms"]) == (0.01, 30)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"exposure_s": 0.01}, "needs --readout-ms"),
        ({"exposure_s": 0.0, "readout_ms": 30}, "must be above 0"),
        ({"exposure_s": 0.01, "readout_ms": float("inf")}, "must be above 0"),
        ({"readout_ms": 30}, "and --exposure-s only"),
    ],
)
def test_exposures_that_cannot_be_are_refused(wrong: dict, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        Synthesize(**wrong)
    assert one_line(caught)
