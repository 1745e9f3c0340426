import cv2
import numpy as np
import pytest

from support.frame_pairs import HEIGHT, WIDTH, Scene, off
from unshutter.errors import UnshutterError
from unshutter.frames.frame_motion import Timing
from unshutter.frames.neighbours import link, render_moment
from unshutter.reasons import Code


def small(picture):
    eight = (picture >> 8).astype(np.uint8) if picture.dtype == np.uint16 else picture
    return cv2.cvtColor(eight, cv2.COLOR_RGB2GRAY)


def rectified(scene, ratio, moment, numbers=(0, 1), **options):
    frames = {number: scene.frame(number, ratio) for number in numbers}
    sides = [number for number in numbers if number]
    links = {side: link(small(frames[min(side, 0)]), small(frames[max(side, 0)])) for side in sides}
    return frames[0], render_moment(frames, links, Timing(ratio, HEIGHT), moment, **options)


@pytest.mark.parametrize("numbers", [(0, 1), (-1, 0), (-1, 0, 1)])
@pytest.mark.parametrize("moment", [0.0, 0.4])
def test_a_wall(numbers, moment) -> None:
    scene = Scene(speed=(20, 4))
    taken, view = rectified(scene, 0.8, moment, numbers)
    truth = scene.at(moment)
    assert view.valid.mean() > 0.9
    assert off(taken, truth, view.valid) > 8
    assert off(view.pixels, truth, view.valid) < 1.5


def test_near_and_far_move_differently() -> None:
    scene = Scene(speed=(16, 2), board_speed=(9, 0))
    taken, view = rectified(scene, 0.9, 0.45)
    truth, board = scene.at(0.45), np.zeros((HEIGHT, WIDTH), bool)
    board[40:110, 95:140] = True  # well inside it
    assert off(taken, truth, board) > 8
    assert off(view.pixels, truth, board) < 3
    assert off(view.pixels, truth, view.valid) < off(taken, truth, view.valid) / 2


def test_three_frames_know_that_the_speed_changes() -> None:
    scene = Scene(speed=(15, 0), gain=(12, 0))
    _, two = rectified(scene, 0.8, 0.0)
    _, three = rectified(scene, 0.8, 0.0, (-1, 0, 1))
    truth = scene.at(0.0)
    both = two.valid & three.valid
    assert off(three.pixels, truth, both) < off(two.pixels, truth, both) / 2


@pytest.mark.parametrize("side", [-1, 1])
def test_frames_may_come_unevenly(side) -> None:
    scene, ratio, apart = Scene(speed=(11, 2)), 0.8, 2.0
    frames = {0: scene.frame(0, ratio), side: scene.frame(apart * side, ratio)}
    pair = [small(frames[number]) for number in sorted(frames)]
    truth = scene.at(0.4)
    view, even = (render_moment(frames, {side: link(*pair, each)}, Timing(ratio, HEIGHT), 0.4) for each in (apart, 1.0))
    assert off(view.pixels, truth, view.valid) < 1.5
    assert off(even.pixels, truth, even.valid) > 5


def test_what_one_frame_did_not_see_is_borrowed() -> None:
    scene = Scene(speed=(24, 0))
    _, own = rectified(scene, 0.9, 0.9, (-1, 0, 1))
    _, borrowed = rectified(scene, 0.9, 0.9, (-1, 0, 1), borrow=True)
    gained = borrowed.valid & ~own.valid
    assert gained.sum() > 200
    assert (own.pixels[~own.valid] == 0).all()
    assert off(borrowed.pixels, scene.at(0.9), gained) < 8


def test_16_bits() -> None:
    scene = Scene(dtype=np.uint16)
    _, view = rectified(scene, 0.8, 0.4)
    assert view.pixels.dtype == np.uint16
    assert off(view.pixels, scene.at(0.4), view.valid) < 1.5
    assert (view.pixels % 257 != 0).any()


# ---- do no harm ---------------------------------------------------------------------------------------------


def noisy(picture, seed, sigma=4.0):
    noise = np.random.default_rng(seed).normal(0, sigma, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def of_two(first, second, moment=0.4):
    return render_moment({0: first, 1: second}, {1: link(small(first), small(second))}, Timing(0.8, HEIGHT), moment)


def test_identical_frames() -> None:
    picture = Scene().at(0)
    view = of_two(picture, picture)
    assert view.reason is not None and view.reason.code is Code.NOTHING_MOVED
    np.testing.assert_array_equal(view.pixels, picture)


def test_a_still_camera_with_noise() -> None:
    picture = Scene().at(0)
    view = of_two(noisy(picture, 1), noisy(picture, 2))
    np.testing.assert_array_equal(view.pixels, noisy(picture, 1))


@pytest.mark.parametrize("sigma", [0, 6])
def test_night_without_texture(sigma) -> None:
    dark = np.full((HEIGHT, WIDTH, 3), 12, np.uint8)
    try:
        view = of_two(noisy(dark, 1, sigma), noisy(dark, 2, sigma))
    except UnshutterError as error:
        assert "too little in common" in str(error)
    else:
        np.testing.assert_array_equal(view.pixels, noisy(dark, 1, sigma))


def test_what_moves_before_a_still_camera_leaves_the_rest_alone() -> None:
    scene = Scene(speed=(0, 0), board_speed=(8, 0))
    taken, view = rectified(scene, 0.8, 0.4)
    away = np.ones((HEIGHT, WIDTH), bool)
    away[15:135, 55:185] = False
    assert off(view.pixels, taken, away) < 0.5


def test_a_cut_is_refused() -> None:
    scene = Scene()
    other = scene.wall[::-1, ::-1][:HEIGHT, :WIDTH].copy()
    with pytest.raises(UnshutterError, match="too little in common"):
        of_two(scene.at(0), other)
