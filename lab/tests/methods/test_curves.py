import numpy as np
import pytest

from support.gradients import check_jacobian
from support.line_scenes import FOCAL, HEIGHT, WIDTH, seen_curves, turning
from unshutter_lab.methods.curves import (
    POINTS,
    RotatedCurves,
    cauchy,
    find_curves,
    forward_differences,
    geman_mcclure,
    link,
    minimise,
    principal_lines,
    squared,
)


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
    """With respect to the squared residual: the gradient is twice the weight times the residual."""
    r = np.array([0.0, 0.3, -1.0, 4.0])
    check_jacobian(lambda x: loss(x)[0], r, np.diag(2 * loss(r)[1] * r))


def test_forward_differences_of_bends() -> None:
    """As two methods use them: of how bent curves are left by angular velocities, of several at once."""
    curves = RotatedCurves(seen_curves(turning((1, 3, 4)), 0, count=6), HEIGHT, WIDTH, FOCAL)

    def bends(velocity: np.ndarray) -> np.ndarray:
        distances = curves.undone(lambda u: u[..., None] * velocity[..., None, None, :])[1]
        return distances.reshape(*velocity.shape[:-1], -1)

    for at in (np.array([0.02, -0.03, 0.05]), np.array([[0.0, 0.0, 0.0], [0.02, 0.05, -0.1]])):
        jacobian = forward_differences(bends, at, bends(at), np.full(3, 1e-6))
        assert jacobian.shape == (*bends(at).shape, 3)
        check_jacobian(bends, at, jacobian, rtol=1e-3, atol=0.05)
