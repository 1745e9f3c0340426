import math
from collections.abc import Callable

import numpy as np
import pytest

from support.gradients import check_jacobian
from unshutter.motion import geometry
from unshutter.single.likelihood import AngleResiduals, EndPoints, RectifiedPoints, VanishingPoints
from unshutter.single.prior import CAMERA, LOG_FOCAL, MOTION, ROLL, TILT, UNKNOWNS, YAW

RNG = np.random.default_rng(0)
HYPOTHESES = RNG.normal(0.1, 0.2, (3, UNKNOWNS))
POINTS = RNG.uniform(-0.5, 0.5, (7, 2))


def ends() -> tuple[EndPoints, EndPoints]:
    return EndPoints(POINTS), EndPoints(POINTS + RNG.uniform(-0.2, 0.2, POINTS.shape))


def test_points_are_rectified_by_the_papers_equation() -> None:
    found = EndPoints(POINTS).rectified(HYPOTHESES[:, MOTION])
    u = POINTS[:, 1] + 0.5
    powers = np.stack([u, u**2, u**3])
    for s, motion in enumerate(HYPOTHESES[:, MOTION]):
        expected = geometry.rs_to_gs(POINTS[:, 0], POINTS[:, 1], motion[:3] @ powers, motion[3:] @ powers)
        np.testing.assert_allclose((found.col[s], found.row[s]), expected, atol=1e-12)


def test_jacobians_of_rectified_points() -> None:
    at = RNG.normal(0, 0.3, (3, 7, 2))  # t_x and r_z of each point

    def rectified(x: np.ndarray) -> RectifiedPoints:
        return RectifiedPoints(POINTS[:, 0], POINTS[:, 1], x[..., 0], x[..., 1])

    found = rectified(at)
    jacobian = np.stack([np.stack(found.J_tx), np.stack(found.J_rz)], axis=-1)
    check_jacobian(lambda x: np.stack([rectified(x).col, rectified(x).row]), at, jacobian)


@pytest.mark.parametrize("turn", [0.0, math.pi / 2])
@pytest.mark.parametrize(
    ("unknown", "jacobian"),
    [
        (ROLL, lambda v: v.J_roll),
        (TILT, lambda v: v.J_tilt),
        (LOG_FOCAL, lambda v: v.J_log_focal),
        (YAW, lambda v: v.J_yaw),
    ],
)
def test_jacobians_of_vanishing_points(unknown: int, jacobian: Callable, turn: float) -> None:
    def points(x: np.ndarray) -> VanishingPoints:
        hypotheses = HYPOTHESES.copy()
        hypotheses[:, unknown] = x[:, 0]
        return VanishingPoints(hypotheses, turn)

    at = HYPOTHESES[:, [unknown]]
    check_jacobian(lambda x: np.stack(points(x).v), at, np.stack(jacobian(points(at)))[..., None])


def test_vanishing_points_of_a_level_camera() -> None:
    """That looks along a street: verticals and crossing streets stay parallel, the street ends in the middle."""
    hypothesis = np.zeros((1, UNKNOWNS))
    hypothesis[0, LOG_FOCAL], hypothesis[0, YAW] = math.log(1.5), math.pi / 2
    np.testing.assert_allclose(
        np.stack(VanishingPoints(hypothesis).v)[:, 0, :, 0].T, [[0, 1.5, 0], [0, 0, 1], [-1.5, 0, 0]], atol=1e-12
    )


@pytest.mark.parametrize("same_motion", [False, True])
def test_jacobian_of_the_residuals(same_motion: bool) -> None:
    at = HYPOTHESES.copy()
    at[:, MOTION] = at[0, MOTION] if same_motion else at[:, MOTION]
    both = ends()
    jacobian = np.moveaxis(AngleResiduals(both, at).jacobian(), 1, -1)
    check_jacobian(lambda x: AngleResiduals(both, x).sine, at, jacobian)
    camera_only = np.moveaxis(AngleResiduals(both, at).jacobian(camera_only=True), 1, -1)
    np.testing.assert_array_equal(camera_only[..., CAMERA], jacobian[..., CAMERA])
    assert not camera_only[..., MOTION].any()


def test_a_residual_is_the_sine_of_the_angle_to_the_vanishing_point() -> None:
    """A level camera, no motion: verticals are expected to be vertical; this one leans by a tenth."""
    lean = 0.1
    start = np.array([[0.2, -0.1]])
    end = start + 0.3 * np.array([[math.sin(lean), math.cos(lean)]])
    residuals = AngleResiduals((EndPoints(start), EndPoints(end)), np.zeros((1, UNKNOWNS)))
    assert residuals.sine[0, 0, 0] == pytest.approx(math.sin(lean))
    assert residuals.cosine[0, 0, 0] == pytest.approx(math.cos(lean))
