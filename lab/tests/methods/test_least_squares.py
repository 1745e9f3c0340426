import numpy as np
import pytest

from support.gradients import check_jacobian
from support.line_scenes import FOCAL, HEIGHT, WIDTH, seen_curves, turning
from unshutter_lab.methods.curves import RotatedCurves, cauchy, forward_differences, geman_mcclure, minimise, squared


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
