import numpy as np
import pytest
import skimage.metrics as skimage

from support.drawn_photos import textured
from unshutter import RowMotion
from unshutter_lab.evaluation.metrics import motion_error, psnr, ssim
from unshutter_lab.methods.row_map import RowMapMotion


def test_the_truth_has_no_error() -> None:
    motion = RowMotion.from_polynomials([0, 20, -30], [0, 0.1], 128, 200)
    error = motion_error(motion, motion)
    assert error.epe == pytest.approx(0, abs=1e-9)
    assert error.curvature_epe == pytest.approx(0, abs=1e-9)


def test_a_known_shear_by_hand() -> None:
    """T = 12 u px on a picture of 512 rows, estimated as nothing: the mean error is the mean of 12 u over what is
    seen, in px at 256 rows about 12 / 2 * 256 / 512 = 3; with the shear known nothing is left.
    """
    truth = RowMotion.from_polynomials([0, 12], [0], 512, 512)
    error = motion_error(RowMotion.zero(512, 512), truth)
    assert error.epe == pytest.approx(3, rel=0.02)
    assert error.curvature_epe == pytest.approx(0, abs=1e-3)
    u = np.arange(512) / 511
    assert error.tx_rmse == pytest.approx(np.sqrt(np.mean((6 * u) ** 2)), rel=1e-6)
    assert error.rz_rmse == 0


def test_only_pixels_that_the_photo_saw_count() -> None:
    """Up to half of a row moves out of sight: those pixels must not count."""
    height, width = 100, 100
    tx = np.linspace(0, 50, height)
    truth = RowMotion(width, tx, np.zeros(height))
    error = motion_error(RowMotion.zero(height, width), truth, points=100)
    rows = np.arange(100)
    seen = np.array([(np.arange(width) + t <= width - 1).sum() for t in tx[rows]])
    assert error.epe == pytest.approx((seen * tx).sum() / seen.sum() * 2.56, rel=1e-6)


def test_curvature_error_is_what_the_best_shear_leaves() -> None:
    truth = RowMotion.from_polynomials([0, 30, 16], [0], 256, 256)
    error = motion_error(RowMotion.zero(256, 256), truth, points=256)
    u = np.arange(256) / 255
    # over rows only, with equal weights: least mean |16 u^2 - k u|
    brute = min(np.abs(16 * u**2 - k * u).mean() for k in np.linspace(5, 20, 1501))
    assert error.curvature_epe == pytest.approx(brute, rel=0.05)


def test_references_do_not_matter() -> None:
    truth = RowMotion.from_polynomials([0, 20, -30], [0, 0.1], 128, 128)
    estimate = RowMotion.from_polynomials([0, 12], [0, 0.05], 128, 128)
    plain = motion_error(estimate, truth)
    moved = motion_error(estimate.rereferenced("last"), truth.rereferenced("middle"))
    assert moved.epe == pytest.approx(plain.epe, abs=1e-9)


def test_errors_are_in_pixels_at_256_rows_whatever_the_size() -> None:
    small = [RowMotion.from_polynomials([0, k], [0], 256, 256) for k in (10, 4)]
    large = [RowMotion.from_polynomials([0, 4 * k], [0], 1024, 1024) for k in (10, 4)]
    assert motion_error(*large).epe == pytest.approx(motion_error(*small).epe, rel=0.01)


def test_an_estimate_that_runs_away_counts_as_far_off_not_as_nothing() -> None:
    truth = RowMotion.zero(64, 64)
    folding = RowMotion(64, np.zeros(64), np.where(np.arange(64) % 2, 1.5, 0.0))  # turns faster than rows are read
    assert 1 < motion_error(folding, truth).epe <= np.hypot(64, 64) * 4
    lost = RowMotion.from_polynomials([0, 9e5], [0], 64, 64)
    assert motion_error(lost, truth).epe <= np.hypot(64, 64) * 4


def test_any_kind_of_motion_is_judged_by_where_it_looks() -> None:
    """A row map that sends every pixel four rows too far down a shear of 0.5 px per row: two columns off."""
    truth = RowMotion.from_polynomials([0, 0.5 * 255], [0], 256, 256)
    off = RowMapMotion(256, truth.tx_px, truth.rz_rad, np.full((2, 2), 4.0), (0, 0), (256, 256))
    error = motion_error(off, truth)
    assert error.epe == pytest.approx(2, rel=0.02)  # the last four rows have nothing below them
    assert error.tx_rmse == 0


# ---- pictures -----------------------------------------------------------------------------------------------


@pytest.fixture(params=[(61, 83), (61, 83, 3)])
def two_pictures(request: pytest.FixtureRequest) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(1)
    truth = textured(61, 83, bands=3)[..., 0] if len(request.param) == 2 else textured(61, 83)
    noisy = truth + random.normal(0, 12, truth.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8), truth


def everything(picture: np.ndarray) -> np.ndarray:
    return np.ones(picture.shape[:2], bool)


def of_scikit_image(picture: np.ndarray, truth: np.ndarray) -> tuple[float, np.ndarray]:
    """(SSIM, SSIM at each pixel) by scikit-image, with the settings of Wang et al."""
    channels = None if picture.ndim == 2 else -1
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 255}
    mean, each = skimage.structural_similarity(picture, truth, full=True, channel_axis=channels, **options)
    return float(mean), each


def test_psnr_and_ssim_equal_those_of_scikit_image(two_pictures: tuple[np.ndarray, np.ndarray]) -> None:
    picture, truth = two_pictures
    whole = everything(truth)
    assert psnr(picture, truth, whole) == pytest.approx(skimage.peak_signal_noise_ratio(truth, picture), rel=1e-12)
    assert ssim(picture, truth, whole) == pytest.approx(of_scikit_image(picture, truth)[0], rel=1e-9)


def test_only_the_mask_counts(two_pictures: tuple[np.ndarray, np.ndarray]) -> None:
    picture, truth = two_pictures
    mask = np.zeros(truth.shape[:2], bool)
    mask[10:50, 20:70] = True
    spoilt = picture.copy()
    spoilt[~mask] = 0
    inner = (slice(10, 50), slice(20, 70))
    by_others = skimage.peak_signal_noise_ratio(truth[inner], picture[inner])
    assert psnr(spoilt, truth, mask) == pytest.approx(by_others, rel=1e-12)
    each = of_scikit_image(picture, truth)[1]
    assert ssim(spoilt, truth, mask) == pytest.approx(each[15:45, 25:65].mean(), rel=1e-9)


def test_psnr_and_ssim_by_hand() -> None:
    black, grey = np.zeros((40, 40), np.uint8), np.full((40, 40), 51, np.uint8)
    assert psnr(grey, black, everything(black)) == pytest.approx(10 * np.log10(25))  # (255 / 51)^2
    assert psnr(black, black, everything(black)) == np.inf
    c1 = (0.01 * 255) ** 2  # flat pictures: only the means differ
    assert ssim(grey, black, everything(black)) == pytest.approx(c1 / (51**2 + c1))
    assert ssim(grey, grey, everything(grey)) == pytest.approx(1)


def test_pictures_cannot_be_compared_where_nothing_was_seen() -> None:
    picture = np.zeros((40, 40), np.uint8)
    nothing = np.zeros((40, 40), bool)
    assert np.isnan(psnr(picture, picture, nothing)) and np.isnan(ssim(picture, picture, nothing))
    thin = nothing.copy()
    thin[:10] = True  # no window of 11 px fits
    assert np.isnan(ssim(picture, picture, thin))
