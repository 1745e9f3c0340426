import cv2
import numpy as np
import pytest

from support.drawn_photos import textured
from support.frame_pairs import Scene
from unshutter.frames.flow import _plane_at_moment, bilinear, flow_between, move_points, pixel_grid, plane_between
from unshutter.frames.frame_motion import Timing

WIDE = cv2.cvtColor(textured(300, 400), cv2.COLOR_RGB2GRAY)


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
    np.testing.assert_allclose(bilinear(field, at), [[[1.25, 2.5], [4.0, 0.0]]], atol=0.02)


def crop(picture, left, top):
    return picture[top : top + 200, left : left + 280].copy()


@pytest.mark.parametrize(("across", "down"), [(0, 0), (3, -2), (-45, 8)])
def test_homography_of_a_shift_even_of_a_sixth_of_the_width(across, down) -> None:
    plane = plane_between(crop(WIDE, 60, 50), crop(WIDE, 60 - across, 50 - down))
    points = np.array([[[20.0, 30.0], [250.0, 180.0]]], np.float32)
    np.testing.assert_allclose(move_points(plane, points) - points, [[[across, down], [across, down]]], atol=0.1)


def test_homography_of_a_perspective() -> None:
    truth = np.array([[1.02, 0.03, -5.0], [-0.02, 0.99, 4.0], [1e-4, -5e-5, 1.0]])
    first = crop(WIDE, 60, 50)
    second = cv2.warpPerspective(first, truth, (280, 200), flags=cv2.INTER_CUBIC)
    points = np.array([[[40.0, 40.0], [240.0, 160.0]]], np.float32)
    np.testing.assert_allclose(move_points(plane_between(first, second), points), move_points(truth, points), atol=0.3)


def test_homography_of_nothing_to_follow_is_the_identity() -> None:
    blank = np.full((200, 280), 20, np.uint8)
    np.testing.assert_array_equal(plane_between(blank, blank), np.eye(3))


def test_a_planes_velocities_at_a_moment_are_those_of_the_place() -> None:
    plane = np.array([[1.02, 0.01, 1.0], [0.0, 1.02, -2.0], [1e-4, 0.0, 1.0]])
    grid = pixel_grid(120, 160)
    velocities = _plane_at_moment(plane, Timing(1e-3, 120), 0.0, 120, 160)
    assert np.abs(velocities - (move_points(plane, grid) - grid)).max() < 0.02
