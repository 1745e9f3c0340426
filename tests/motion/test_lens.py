"""Lenses that bend straight lines: positions and directions, and motion seen through them."""

import numpy as np
import pytest

from unshutter.errors import UnshutterError
from unshutter.frames.camera import ROWS, rotation_jacobian
from unshutter.motion import Motion, RotationMotion
from unshutter.motion.lens import Lens
from unshutter.motion.rotations import rotation_matrix

LENS = Lens(0.8, (0.04, 0.01, -0.006, 0.002), (0.02, -0.01))
X, Y = (each.ravel() for each in np.meshgrid(np.linspace(-1.1, 1.1, 7), np.linspace(-0.6, 0.6, 5)))


def test_position_inverts_direction():
    rays = np.stack(LENS.direction(X, Y))
    np.testing.assert_allclose(np.linalg.norm(rays, axis=0), 1, atol=1e-12)
    np.testing.assert_allclose(LENS.position(*rays), [X, Y], atol=1e-9)


def test_slopes_are_the_differences_of_positions():
    rays, slopes = np.stack(LENS.direction(X, Y)), np.array(LENS.slopes(*LENS.direction(X, Y)))
    for axis, step in enumerate(1e-6 * np.eye(3)):
        ends = [np.stack(LENS.position(*(rays + sign * step[:, None]))) for sign in (1, -1)]
        np.testing.assert_allclose(slopes[:, axis], (ends[0] - ends[1]) / 2e-6, atol=1e-6)


def test_of_radial_follows_the_radial_model():
    lens, angles = Lens.of_radial(1.0, (-0.1, 0.02), reach=1.0), np.linspace(0.01, 0.7, 50)
    tan = np.tan(angles)
    np.testing.assert_allclose(lens.distance(angles), tan * (1 - 0.1 * tan**2 + 0.02 * tan**4), atol=1e-4)


def test_a_lens_that_folds_is_refused():
    with pytest.raises(UnshutterError, match="folds"):
        Lens(1.0, (-1000.0, 0.0, 0.0, 0.0))


def test_motion_through_a_lens_goes_there_and_back():
    rotations = np.linspace([0, 0, 0], [0.02, 0.05, 0.03], 360)
    motion = RotationMotion(640, rotations=rotations, focal_px=288.0, lens=LENS)
    col, row = (each.ravel() for each in np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 359, 7)))
    seen = motion.gs_to_rs(col, row)
    assert np.abs(seen[0] - col).max() > 3
    np.testing.assert_allclose(motion.rs_to_gs(*seen), [col, row], atol=1e-3)
    motion.check_unfolded()
    again = Motion.from_json(motion.to_json())
    np.testing.assert_allclose(again.gs_to_rs(col, row), seen, atol=1e-9)
    straight = RotationMotion(640, rotations=rotations, focal_px=288.0).gs_to_rs(col, row)
    assert np.abs(straight[0] - seen[0]).max() > 1


def test_jacobian_predicts_small_turns():
    at, focal = np.array([[30.0, 20.0], [400.0, 200.0], [228.0, 128.0]]), 0.8 * ROWS
    jacobian = rotation_jacobian(at, 455.0, focal, LENS)
    rays = np.stack(LENS.direction(*((at - [227.5, ROWS / 2]) / focal).T), axis=-1)
    for axis in range(3):
        turned = rays @ rotation_matrix(1e-5 * np.eye(3)[axis]).T
        moved = np.stack(LENS.position(*turned.T), axis=-1) * focal + [227.5, ROWS / 2] - at
        np.testing.assert_allclose(jacobian[..., axis], moved / 1e-5 / focal, atol=1e-3)
