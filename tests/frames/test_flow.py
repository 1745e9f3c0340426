import cv2
import numpy as np

from support.frame_pairs import Scene
from unshutter.frames.flow import flow_between, looked_up, pixel_grid


def grey(picture):
    return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)


def test_two_things_that_move_differently() -> None:
    scene = Scene(speed=(12, 2), board_speed=(4, 1))
    flow = flow_between(grey(scene.at(0)), grey(scene.at(1)))
    board = flow.forward[45:105, 92:135]  # well inside it at both moments
    wall = flow.forward[20:140, 170:220]
    np.testing.assert_allclose(np.median(board, axis=(0, 1)), [4, 1], atol=0.2)
    np.testing.assert_allclose(np.median(wall, axis=(0, 1)), [12, 2], atol=0.15)
    back = flow.backward[20:140, 180:220]
    np.testing.assert_allclose(np.median(back, axis=(0, 1)), [-12, -2], atol=0.15)
    assert flow.consistent > 0.8


def test_what_left_the_picture_moves_like_the_rest() -> None:
    scene = Scene(speed=(30, 0))
    flow = flow_between(grey(scene.at(0)), grey(scene.at(1)))
    np.testing.assert_allclose(flow.forward[:, -25:], np.broadcast_to([30.0, 0.0], (160, 25, 2)), atol=0.5)


def test_strangers_have_little_in_common() -> None:
    scene = Scene()
    other = scene.wall[::-1, ::-1][: scene.at(0).shape[0], : scene.at(0).shape[1]].copy()
    assert flow_between(grey(scene.at(0)), grey(other)).consistent < 0.3


def test_look_up_between_pixels_and_beyond_the_border() -> None:
    field = pixel_grid(4, 5)
    at = np.array([[[1.25, 2.5], [9.0, -3.0]]], np.float32)
    np.testing.assert_allclose(looked_up(field, at), [[[1.25, 2.5], [4.0, 0.0]]], atol=0.02)
