import numpy as np
import pytest

from unshutter import Motion
from unshutter.metrics import motion_error


def test_the_truth_has_no_error() -> None:
    motion = Motion.from_polynomials([0, 20, -30], [0, 0.1], 128, 200)
    error = motion_error(motion, motion)
    assert error.epe == pytest.approx(0, abs=1e-9)
    assert error.curvature_epe == pytest.approx(0, abs=1e-9)


def test_a_known_shear_by_hand() -> None:
    """t = 12 u px on a picture of 512 rows, estimated as nothing: the mean error is the mean of 12 u over what is
    seen, in px at 256 rows about 12 / 2 * 256 / 512 = 3; with the shear known nothing is left."""
    truth = Motion.from_polynomials([0, 12], [0], 512, 512)
    error = motion_error(Motion.zero(512, 512), truth)
    assert error.epe == pytest.approx(3, rel=0.02)
    assert error.curvature_epe == pytest.approx(0, abs=1e-3)
    u = np.arange(512) / 511
    assert error.tx_rmse == pytest.approx(np.sqrt(np.mean((6 * u) ** 2)), rel=1e-6)
    assert error.rz_rmse == 0


def test_only_pixels_that_the_photo_saw_count() -> None:
    """Up to half of a row moves out of sight: those pixels must not count."""
    height, width = 100, 100
    tx = np.linspace(0, 50, height)
    truth = Motion(width, tx, np.zeros(height))
    error = motion_error(Motion.zero(height, width), truth, points=100)
    rows = np.arange(100)
    seen = np.array([(np.arange(width) + t <= width - 1).sum() for t in tx[rows]])
    assert error.epe == pytest.approx((seen * tx).sum() / seen.sum() * 2.56, rel=1e-6)


def test_curvature_error_is_what_the_best_shear_leaves() -> None:
    truth = Motion.from_polynomials([0, 30, 16], [0], 256, 256)
    error = motion_error(Motion.zero(256, 256), truth, points=256)
    u = np.arange(256) / 255
    # over rows only, with equal weights: least mean |16 u^2 - k u|
    brute = min(np.abs(16 * u**2 - k * u).mean() for k in np.linspace(5, 20, 1501))
    assert error.curvature_epe == pytest.approx(brute, rel=0.05)


def test_references_do_not_matter() -> None:
    truth = Motion.from_polynomials([0, 20, -30], [0, 0.1], 128, 128)
    estimate = Motion.from_polynomials([0, 12], [0, 0.05], 128, 128)
    plain = motion_error(estimate, truth)
    moved = motion_error(estimate.rereferenced("last"), truth.rereferenced("middle"))
    assert moved.epe == pytest.approx(plain.epe, abs=1e-9)


def test_errors_are_in_pixels_at_256_rows_whatever_the_size() -> None:
    small = [Motion.from_polynomials([0, k], [0], 256, 256) for k in (10, 4)]
    large = [Motion.from_polynomials([0, 4 * k], [0], 1024, 1024) for k in (10, 4)]
    assert motion_error(*large).epe == pytest.approx(motion_error(*small).epe, rel=0.01)
