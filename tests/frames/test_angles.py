"""The readout ratio from right angles: the lean of upright things against how fast they move."""

import numpy as np
import pytest

from unshutter import Photo
from unshutter.errors import UnknownRatioError
from unshutter.frames.sequence import PhotoSpeed, combined, ratio_from_angles, speed_of
from unshutter.frames.tracks import Tracks
from unshutter.readout_time import ReadoutTime
from unshutter.single.estimator import View

RATIO, HEIGHT, WIDTH = 0.6, 480, 640


def facade(sideways):
    """A facade with windows that moves sideways by so many rows in a frame interval, each row a little later."""
    row, col = np.mgrid[0 : 4 * HEIGHT, 0 : 4 * WIDTH] / 4  # finer than the picture, or edges are stairs
    window = ((col + 400 - sideways * RATIO * row) % 90 > 35) & (row % 80 > 30)
    grey = np.where(window, 60, 190).reshape(HEIGHT, 4, WIDTH, 4).mean(axis=(1, 3)).astype(np.uint8)
    return PhotoSpeed(View(Photo.from_array(grey)), np.array([sideways, 0.0, 0.0]))


def test_frames_that_move_differently_say_it():
    answer = ratio_from_angles([facade(sideways) for sideways in (0.15, -0.12, 0.08)])
    assert answer.value == pytest.approx(RATIO, abs=0.1)
    assert abs(answer.value - RATIO) < 2 * answer.error < 0.2


def test_one_frame_might_be_held_askew():
    with pytest.raises(UnknownRatioError, match=r"right angles give 0\.\d\d ± 0\.\d\d"):
        ratio_from_angles([facade(0.15)])


@pytest.mark.parametrize("photos", [[], [facade(0.001)]])
def test_nothing_that_leans_says_nothing(photos):
    with pytest.raises(UnknownRatioError, match="no right angles, or barely move"):
        ratio_from_angles(photos)


def test_a_photo_without_lines_says_nothing():
    plain = View(Photo.from_array(np.full((HEIGHT, WIDTH), 90, np.uint8)))
    with pytest.raises(UnknownRatioError, match="no right angles"):
        ratio_from_angles([PhotoSpeed(plain, np.array([0.1, 0.0, 0.0]))])


def test_speed_of_tracks():
    rng = np.random.default_rng(0)
    start = rng.uniform(20, 300, (40, 2))
    about = start + 0.5 - [WIDTH / 4, HEIGHT / 4]
    turned = about[:, ::-1] * [-0.01, 0.01]  # clockwise
    tracks = Tracks(start, start + turned + np.array([12.0, 0.0]), HEIGHT // 2, WIDTH // 2, 40)
    np.testing.assert_allclose(speed_of(tracks), [12 / 240, 0.0, 0.01], atol=5e-4)


def test_two_findings_weigh_by_their_errors():
    both = combined(ReadoutTime(0.5, 0.02, "motion"), ReadoutTime(0.6, 0.04, "right angles"))
    assert both.value == pytest.approx(0.52)
    assert both.source == "motion and right angles"
    assert both.error == pytest.approx(0.1 / np.hypot(0.02, 0.04) / np.sqrt(1 / 0.02**2 + 1 / 0.04**2))
    alike = combined(ReadoutTime(0.5, 0.02, "motion"), ReadoutTime(0.5, 0.02, "right angles"))
    assert alike.error == pytest.approx(0.02 / np.sqrt(2))
