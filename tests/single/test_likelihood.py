import numpy as np
import pytest

from support.gradients import check_jacobian
from unshutter.single.likelihood import ManhattanLikelihood
from unshutter.single.prior import UNKNOWNS, KnownCamera, NetworkObservation, PriorParams


@pytest.mark.parametrize("known", [KnownCamera(), KnownCamera(up=(1, 0), roll=0.1)])
def test_the_gradient_is_that_of_the_energy(known: KnownCamera) -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    opinion = NetworkObservation(rng.normal(0, 0.1, 6), root @ root.T)
    wide = PriorParams(sigma_exact=0.3, sigma_sloppy=0.5, independent_share=1.0)
    likelihood = ManhattanLikelihood(rng.uniform(-0.5, 0.5, (30, 4)), 512, 1.2, wide, known, opinion)
    at = rng.normal(0.1, 0.1, (3, UNKNOWNS))
    energy, gradient, hessian = likelihood.expanded(at)
    np.testing.assert_allclose(energy, likelihood.energy(at))
    check_jacobian(likelihood.energy, at, gradient)
    assert (np.linalg.eigvalsh(hessian) > 0).all()


def test_segments_that_point_to_vanishing_points_beat_chance() -> None:
    """Upright walls, seen straight on, against strokes in all directions."""
    rng = np.random.default_rng(1)
    middle = rng.uniform(-0.4, 0.4, (50, 2))
    upright, anywhere = np.array([0.0, 0.05]), rng.normal(0, 0.04, (50, 2))
    gains = []
    for half in (upright, anywhere):
        likelihood = ManhattanLikelihood(np.concatenate([middle - half, middle + half], axis=1), 512)
        gains.append(float(likelihood.lines_gain(likelihood.prior.mean[None])[0]))
    assert gains[0] > 1 > 0 > gains[1]
