"""The line-based rivals: scenes whose motion is known, pictures through the detector, and what they decline."""

import json
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.line_scenes import FOCAL, HEIGHT, WIDTH, drawn_picture, manhattan_segments, seen_curves, turning
from unshutter import UsageError
from unshutter.cli import main
from unshutter.estimators.base import View
from unshutter.estimators.lines.curves import POINTS, RotatedCurves, find_curves, link, principal_lines
from unshutter.estimators.lines.least_squares import cauchy, geman_mcclure, minimise, squared
from unshutter.estimators.methods.lao2018 import fit_velocity
from unshutter.estimators.methods.purkait2017 import fit_rate, line_polynomials, solve_four
from unshutter.estimators.methods.rengarajan2016 import fit_rotations, polynomial_rotations
from unshutter.evaluation.metrics import motion_error
from unshutter.motion import Motion, RotationMotion
from unshutter.options import Camera
from unshutter.photo import Photo

U = (np.arange(HEIGHT) + 0.5) / HEIGHT
QUADRATIC = ((1, 4, 3), (-2, 2, 2))  # degrees about x, y, z
NAMES = ("rengarajan2016", "purkait2017", "lao2018")


def motion_of(rotations: np.ndarray) -> RotationMotion:
    return RotationMotion(width=WIDTH, rotations=rotations, focal_px=FOCAL).rereferenced("first")


def bow_motion(curves: np.ndarray) -> RotationMotion:
    found = fit_rotations(curves, HEIGHT, WIDTH, FOCAL)
    assert found is not None
    return motion_of(polynomial_rotations(found, U))


def uniform_motion(curves: np.ndarray) -> RotationMotion:
    found = fit_velocity(curves, HEIGHT, WIDTH, FOCAL)
    assert found is not None
    return motion_of(U[:, None] * found)


def share_left(found: Motion, truth: Motion) -> float:
    """EPE as a share of that of doing nothing."""
    return motion_error(found, truth).epe / motion_error(truth.scaled(0), truth).epe


def check_exact(found: RotationMotion, truth: RotationMotion) -> None:
    """Within 0.1 degrees about each axis and half a pixel everywhere."""
    assert np.degrees(np.abs(found.rotations - truth.rotations)).max() < 0.1
    col, row = np.meshgrid(np.linspace(0, WIDTH - 1, 20), np.linspace(0, HEIGHT - 1, 20))
    apart = np.hypot(*(np.stack(found.gs_to_rs(col, row)) - truth.gs_to_rs(col, row)))
    assert apart.max() < 0.5


# ---- least squares --------------------------------------------------------------------------------------------


def test_least_squares_agrees_with_scipy() -> None:
    from scipy.optimize import least_squares

    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, 60)
    seen = 2 * np.exp(-3 * t) + rng.normal(0, 0.01, 60)
    seen[::7] += 1.0

    def residuals(x: np.ndarray) -> np.ndarray:
        return (x[0] * np.exp(x[1] * t) - seen) / 0.05

    for ours, theirs in ((squared, "linear"), (cauchy, "cauchy")):
        found, cost = minimise(residuals, np.array([1.0, -1.0]), ours)
        wanted = least_squares(residuals, [1.0, -1.0], loss=theirs, xtol=1e-12, ftol=1e-12)
        np.testing.assert_allclose(found, wanted.x, atol=1e-4)
        assert cost == pytest.approx(2 * wanted.cost)
    robust, _ = minimise(residuals, found, geman_mcclure)
    np.testing.assert_allclose(robust, (2, -3), atol=0.03)


def test_least_squares_refuses_steps_to_nowhere() -> None:
    """Not finite beyond 1: the answer stays on this side."""
    found, _ = minimise(lambda x: np.where(x > 1, np.nan, x - 3), np.zeros(1))
    assert 0 <= found[0] <= 1


@pytest.mark.parametrize("loss", [squared, cauchy, geman_mcclure])
def test_weights_are_the_slope_of_the_cost(loss) -> None:
    r = np.array([0.0, 0.3, -1.0, 4.0])
    h = 1e-6
    slope = (loss(np.sqrt(r**2 + h))[0] - loss(r)[0]) / h
    np.testing.assert_allclose(loss(r)[1], slope, rtol=1e-4)


# ---- curves ---------------------------------------------------------------------------------------------------


def test_segments_end_to_end_are_one_curve() -> None:
    chain = np.array([[10, 10, 50, 12], [52, 12.2, 90, 17], [91, 17, 130, 26]], dtype=float)
    other_side = chain[1, [2, 3, 0, 1]]  # bright on the other side
    beside = chain[0] + [0, 6, 0, 6]
    turned = np.array([132, 27, 140, 60], dtype=float)
    segments = np.stack([chain[2], beside, chain[0], other_side, chain[1], turned])
    assert sorted(link(segments)) == [[1], [2, 4, 0], [3], [5]]
    assert link(np.zeros((0, 4))) == []


def test_a_ring_of_segments_is_opened() -> None:
    """Forty chords of a circle: each continues the one before, none is the first."""
    a = np.linspace(0, 2 * np.pi, 41)
    points = 100 + 80 * np.stack([np.cos(a), np.sin(a)], axis=1)
    (chain,) = link(np.concatenate([points[:-1], points[1:]], axis=1))
    assert sorted(chain) == list(range(40))


def test_a_drawn_arc_is_found_with_its_bend() -> None:
    row, col = np.mgrid[0:900, 0:900] / 3 - 1 / 3
    big = np.where(np.hypot(col + 800, row - 150) < 960, 220.0, 40.0)  # edge near column 160, sagitta about 9 px
    grey = big.reshape(300, 3, 300, 3).mean(axis=(1, 3)).astype(np.uint8)
    curves = find_curves(grey, 200)
    assert curves.shape == (1, POINTS, 2)
    np.testing.assert_allclose(np.hypot(curves[..., 0] + 800, curves[..., 1] - 150), 960, atol=0.25)
    assert find_curves(np.full((100, 100), 128, np.uint8), 5).shape == (0, POINTS, 2)


def test_bends_are_measured_in_the_picture_as_it_is() -> None:
    """Squeezing the rectified picture makes distances no smaller: noise is no reason for a motion."""
    curves = seen_curves(turning((0, 0, 0)), 0, noise=0.5)
    still = RotatedCurves(curves, HEIGHT, WIDTH, FOCAL)
    bends = still.undone(lambda u: np.zeros((*u.shape, 3)))[1]
    np.testing.assert_allclose(bends, principal_lines(curves)[0], rtol=1e-6, atol=1e-9)
    squeezed = still.undone(lambda u: np.stack([0.3 * u, 0 * u, 0 * u], axis=-1))[1]
    assert np.sqrt((squeezed**2).mean()) > 0.95 * np.sqrt((bends**2).mean())


# ---- from bows to arrows --------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [((0, 5, 0),), QUADRATIC, ((-1, -3, 2), (1, 6, -4), (1, -2, 2))])
@pytest.mark.parametrize("seed", [0, 1])
def test_bows_are_straightened_exactly(degrees, seed: int) -> None:
    truth = turning(*degrees)
    check_exact(bow_motion(seen_curves(truth, seed)), truth)


@pytest.mark.parametrize(("noise", "clutter", "left"), [(0.3, 0.0, 0.15), (0.3, 0.4, 0.2), (1.0, 0.4, 0.35)])
def test_bows_with_noise_and_clutter(noise: float, clutter: float, left: float) -> None:
    truth = turning(*QUADRATIC)
    for seed in range(3):
        assert share_left(bow_motion(seen_curves(truth, seed, noise=noise, clutter=clutter)), truth) < left


def test_bows_leave_still_scenes_still() -> None:
    found = bow_motion(seen_curves(turning((0, 0, 0)), 0, noise=0.3, clutter=0.4))
    assert motion_error(found, found.scaled(0)).epe < 1


# ---- uniform angular velocity -----------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [(2, 5, 6), (-3, -4, 4), (0, 0, -8)])
@pytest.mark.parametrize("clutter", [0.0, 0.4])
def test_the_velocity_is_found_exactly(degrees: tuple[float, float, float], clutter: float) -> None:
    truth = turning(degrees)
    check_exact(uniform_motion(seen_curves(truth, 0, clutter=clutter)), truth)


def test_four_curves_are_enough_for_the_velocity() -> None:
    truth = turning((1, 2, 5))
    check_exact(uniform_motion(seen_curves(truth, 3, count=4)), truth)


def test_the_velocity_with_noise_and_clutter() -> None:
    """What lines show well (z) stays right; what they hardly show (x, y) is held back, not made up."""
    for seed in range(3):
        truth = turning((1, 2, 6))
        found = uniform_motion(seen_curves(truth, seed, noise=0.3, clutter=0.4))
        assert abs(np.degrees(found.rotations - truth.rotations)[-1, 2]) < 1
        assert share_left(found, truth) < 1


# ---- Manhattan world ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [0.0, 0.05, -0.3, 0.8])
def test_four_segments_give_the_rate_to_the_last_digits(rate: float) -> None:
    """Samples whose segments belong to the vanishing points as the solver supposes: two, one, one; or two, two."""
    hits = 0
    for seed in range(20):
        segments = manhattan_segments(rate, seed, count=60)
        polynomials = line_polynomials(segments)
        rng = np.random.default_rng(seed)
        samples = np.stack([rng.permutation(60)[:4] for _ in range(30)])
        rates, frames = solve_four(polynomials[samples])
        np.testing.assert_allclose(frames @ frames.swapaxes(1, 2), np.broadcast_to(np.eye(3), frames.shape), atol=1e-6)
        hits += (np.abs(rates - rate) < 1e-6).any()
    assert hits == 20


@pytest.mark.parametrize("rate", [0.0, 0.1, -0.3])
def test_the_rate_of_a_manhattan_world(rate: float) -> None:
    found, share = fit_rate(manhattan_segments(rate, 0))
    assert found == pytest.approx(rate, abs=1e-6)
    assert share == 1
    noisy, share = fit_rate(manhattan_segments(rate, 1, noise=0.001))
    assert noisy == pytest.approx(rate, abs=0.02)
    assert share > 0.95
    cluttered, share = fit_rate(manhattan_segments(rate, 2, noise=0.001, clutter=0.4))
    assert cluttered == pytest.approx(rate, abs=0.03)
    assert share < 0.85  # so that the estimator declines, or nearly


@pytest.mark.parametrize("degrees", [3, 6, -8])
def test_a_true_rotation_is_found_although_the_model_is_of_first_order(degrees: float) -> None:
    truth = turning((0, 0, degrees))
    curves = seen_curves(truth, 0, count=150)
    ends = np.stack(truth.rs_to_gs(*np.moveaxis(curves[:, [0, -1]], -1, 0)), axis=-1)
    upright = np.abs(ends[:, 1] - ends[:, 0]).min(axis=-1) < 1e-3  # verticals and horizontals of the scene
    center = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    rate, share = fit_rate(((curves[upright][:, [0, -1]] - center) / FOCAL).reshape(-1, 4))
    assert share == 1
    check_exact(motion_of(np.stack([0 * U, 0 * U, -rate * U * HEIGHT / FOCAL], axis=1)), truth)


# ---- through the detector ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "degrees", "left"),
    [
        ("rengarajan2016", QUADRATIC, 0.15),
        ("rengarajan2016", ((0, -4, -3),), 0.15),
        ("purkait2017", ((0, 0, 7),), 0.1),
        ("purkait2017", ((0, 0, -5),), 0.1),
        ("lao2018", ((0, 0, 7),), 0.15),
        ("lao2018", ((0, 0, -5),), 0.15),
    ],
)
def test_a_drawn_picture_goes_through_the_detector(name: str, degrees, left: float) -> None:
    truth = turning(*degrees)
    picture = drawn_picture(truth)
    found = unshutter.estimate(picture, estimator=name, focal_px=FOCAL)
    assert isinstance(found, RotationMotion)
    assert (found.focal_px, found.estimator, found.height, found.width) == (FOCAL, name, HEIGHT, WIDTH)
    assert not found.rotations[0].any()
    assert share_left(found, truth) < left
    again = unshutter.estimate(picture, estimator=name, focal_px=FOCAL)
    np.testing.assert_array_equal(again.tx_px, found.tx_px)  # seeded


@pytest.mark.parametrize("name", NAMES)
def test_without_lines_nothing_is_done_and_said_why(name: str) -> None:
    motion = unshutter.estimate(np.full((200, 300), 128, np.uint8), estimator=name)
    assert motion.is_zero
    assert "only 0" in motion.reason


def test_a_world_without_three_directions_is_declined() -> None:
    """Strokes in all directions: fewer than 75 % fit."""
    import cv2

    grey = np.full((400, 500), 200, np.uint8)
    rng = np.random.default_rng(0)
    for _ in range(150):
        at, along = rng.uniform(0, 400, 2), rng.uniform(-60, 60, 2)
        cv2.line(grey, *(tuple(map(int, p)) for p in (at, at + along)), color=60, thickness=2, lineType=cv2.LINE_AA)
    motion = unshutter.estimate(grey, estimator="purkait2017")
    assert motion.is_zero
    assert "fit a Manhattan world" in motion.reason


# ---- focal length -----------------------------------------------------------------------------------------------


def test_the_focal_length_is_the_given_one_or_a_guess() -> None:
    photo = Photo.from_array(np.zeros((100, 200), np.uint8))
    assert View(photo).focal_px() == pytest.approx(0.85 * 300)
    assert View(photo, Camera(focal_px=123.0)).focal_px() == 123
    with pytest.raises(UsageError, match="focal length"):
        View(photo, Camera(focal_px=0.0))


def test_the_focal_length_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo, out = tmp_path / "p.png", tmp_path / "m.json"
    Photo.from_array(drawn_picture(turning((0, 0, 5)))).save(photo)
    options = ["--estimator", "purkait2017", "--focal-px", "450"]
    assert main(["estimate", str(photo), *options, "-o", str(out)]) == 0
    assert json.loads(out.read_text())["focal_px"] == 450
    saved = tmp_path / "saved.json"
    assert main(["rectify", str(photo), *options, "-o", str(tmp_path / "r.png"), "--save-motion", str(saved)]) == 0
    np.testing.assert_array_equal(Motion.load(saved).rz_rad, Motion.load(out).rz_rad)
    again = tmp_path / "again.png"  # the saved motion gives the same picture
    assert main(["rectify", str(photo), "--motion", str(saved), "-o", str(again)]) == 0
    assert Photo.open(again).to_array().tobytes() == Photo.open(tmp_path / "r.png").to_array().tobytes()
    capsys.readouterr()
    assert main(["estimate", str(photo), "--focal-px", "-1"]) == 2
    assert "focal length must be positive" in capsys.readouterr().err
