import math

import numpy as np
import pytest

from support.gradients import check_jacobian
from unshutter.single.prior import (
    LOG_FOCAL,
    NORMAL,
    ROLL,
    TILT,
    UNKNOWNS,
    YAW,
    KnownCamera,
    MotionKind,
    NetworkObservation,
    Prior,
    PriorParams,
)


def opinion() -> NetworkObservation:
    root = np.random.default_rng(0).normal(size=(6, 6))
    return NetworkObservation(np.full(6, 0.05), root @ root.T)


@pytest.mark.parametrize("known", [KnownCamera(), KnownCamera(roll=0.1, log_focal=0.3), KnownCamera(tilt=-1.0)])
@pytest.mark.parametrize("second", [None, opinion()])
def test_the_gradient_is_that_of_the_energy(known: KnownCamera, second: NetworkObservation | None) -> None:
    prior = Prior(PriorParams(), known, 1.3, second)
    at = prior.mean + np.random.default_rng(1).normal(0, 0.05, (4, UNKNOWNS))
    _, gradient, hessian = prior.expanded(at)
    check_jacobian(lambda x: prior.expanded(x)[0], at, gradient, rtol=1e-4, atol=1e-4)
    assert (np.linalg.eigvalsh(hessian) > 0).all()


def test_what_is_known_is_expected_and_weighs_more() -> None:
    guessed = Prior(PriorParams(), KnownCamera(), 1.0)
    known = Prior(PriorParams(), KnownCamera(roll=0.2, tilt=-0.5, log_focal=0.1), 1.0)
    assert guessed.mean[LOG_FOCAL] == pytest.approx(math.log(1.7))
    np.testing.assert_allclose(known.mean[[ROLL, TILT, LOG_FOCAL]], (0.2, -0.5, 0.1))
    for unknown in (ROLL, TILT, LOG_FOCAL):
        step = 0.1 * np.eye(UNKNOWNS)[unknown]
        rise = [p.expanded((p.mean + step)[None])[0] - p.expanded(p.mean[None])[0] for p in (guessed, known)]
        assert rise[1] > rise[0] > 0
    far = guessed.expanded((guessed.mean + 2 * np.eye(UNKNOWNS)[YAW])[None])[0]
    assert far == pytest.approx(guessed.expanded(guessed.mean[None])[0], abs=1e-4)  # any yaw is as good


def test_an_opinion_pulls_less_the_farther_it_is() -> None:
    """Student's t: beyond some sigmas the gradient falls."""
    second = NetworkObservation(np.zeros(6), np.eye(6) * 1e8)
    prior = Prior(PriorParams(), KnownCamera(), 1.0, second, [MotionKind("any", np.eye(6) * 1e6, NORMAL, 1.0)])
    at = np.tile(prior.mean, (3, 1))
    at[:, 0] = (1e-4, 1e-3, 1e-2)
    pulls = prior.expanded(at)[1][:, 0]
    assert pulls[0] > pulls[1] > pulls[2] > 0
