"""A rotation whose picture depth displaces besides: there and back, at other sizes and strengths, and in files."""

import numpy as np
import pytest

from unshutter import Motion, RotationMotion, UnshutterError

HEIGHT, WIDTH = 240, 320


@pytest.fixture
def walk():
    rng = np.random.default_rng(0)
    rotations = np.linspace([0, 0, 0], [0.004, -0.006, 0.003], HEIGHT)
    near = np.repeat(np.linspace(0.5, 4.0, 7), 9)  # rows further down are nearer
    parallax = np.stack([near, 0.2 * near], axis=-1) + rng.normal(0, 0.1, (63, 2))
    return RotationMotion(WIDTH, rotations, 260.0, parallax=parallax)


def test_positions_there_and_back(walk):
    col, row = np.meshgrid(np.linspace(0, WIDTH - 1, 9), np.linspace(0, HEIGHT - 1, 7))
    for motion in (walk, walk.rereferenced("middle")):
        there = motion.gs_to_rs(col, row)
        assert np.abs(np.array(motion.rs_to_gs(*there)) - (col, row)).max() < 1e-3
    rotated = RotationMotion(WIDTH, walk.rotations, walk.focal_px)
    across = walk.gs_to_rs(col, row)[0] - rotated.gs_to_rs(col, row)[0]
    assert across[-1].mean() == pytest.approx(4.0, abs=0.3)  # the last row, near the camera, when all of it was read
    assert np.abs(across[0]).max() < 0.05  # nothing had moved by then


def test_it_scales_with_the_picture_and_with_the_strength(walk):
    half = walk.resized(HEIGHT // 2, WIDTH // 2)
    col, row = np.array([40.0, 200.0, 310.0]), np.array([20.0, 130.0, 235.0])
    small = half.rs_to_gs((col + 0.5) / 2 - 0.5, (row + 0.5) / 2 - 0.5)
    assert np.array(small) * 2 + 0.5 == pytest.approx(np.array(walk.rs_to_gs(col, row)), abs=0.05)
    moved = [np.array(motion.rs_to_gs(col, row)) - (col, row) for motion in (walk, walk.scaled(0.5))]
    assert moved[1] == pytest.approx(moved[0] / 2, abs=0.05)


def test_files_hold_it(walk):
    assert Motion.from_json(walk.to_json()) == walk


@pytest.mark.parametrize("parallax", [np.zeros((5, 2)), np.full((63, 2), np.nan), np.full((63, 2), 99.0)])
def test_what_no_camera_shows_is_refused(parallax):
    with pytest.raises(UnshutterError, match="parallax"):
        RotationMotion(WIDTH, np.zeros((HEIGHT, 3)), 260.0, parallax=parallax)
