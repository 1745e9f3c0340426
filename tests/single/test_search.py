"""Streets whose motion is known, and what the search finds of it."""

import math
from functools import partial

import numpy as np
import pytest

from unshutter import RowMotion
from unshutter.motion import geometry
from unshutter.single.likelihood import ManhattanLikelihood
from unshutter.single.prior import CAMERA, NORMAL, UNKNOWNS, KnownCamera, MotionKind, NetworkObservation, PriorParams
from unshutter.single.search import descend, explore
from unshutter_lab.evaluation.metrics import motion_error

ROWS = 512
QUADRATIC = [MotionKind("quadratic", np.diag([0.06, 0.08, 0.01, 0.07, 0.06, 0.01]) ** 2, NORMAL, 1.0)]
DRAWN = PriorParams(independent_share=1.0)  # no drawn segment repeats another's error
quadratic_likelihood = partial(ManhattanLikelihood, kinds=QUADRATIC)
STARTS = [np.eye(6)[k] * size for k, size in ((0, 0.1), (0, -0.1), (3, 0.07), (3, -0.07))]
MOTION = np.array([0.09, -0.14, 0.0, 0.06, 0.03, 0.0])


def street(roll=0.0, tilt=0.0, yaw=0.5, focal=1.6, clutter=30, seed=0, turned=0) -> np.ndarray:
    """[N, 4] undistorted segments of a street: points in space, projected one by one; ``turned`` quarter turns."""
    rng = np.random.default_rng(seed)
    start = np.stack([rng.uniform(-4, 4, 240), rng.uniform(-3, 3, 240), rng.uniform(4, 9, 240)], 1)
    streets = np.array([[math.cos(yaw), 0, math.sin(yaw)], [-math.sin(yaw), 0, math.cos(yaw)], [0, 1, 0]])
    up_down = np.array([[1, 0, 0], [0, math.cos(tilt), math.sin(tilt)], [0, -math.sin(tilt), math.cos(tilt)]])
    angle = roll + turned * math.pi / 2
    about = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
    if abs(tilt) > 1:
        start = start @ (about @ up_down)  # before the camera, wherever it looks
    end = start + streets[rng.integers(0, 3, 240)] * rng.uniform(0.3, 1.2, (240, 1))
    seen = [points @ (about @ up_down).T for points in (start, end)]
    ends = np.concatenate([focal * p[:, :2] / p[:, 2:] for p in seen], 1)
    somewhere = rng.uniform(-0.45, 0.45, (clutter, 2))
    off = rng.normal(0, 0.04, (clutter, 2))
    segments = np.concatenate([ends, np.concatenate([somewhere - off, somewhere + off], 1)])
    segments = segments + rng.normal(0, 0.2 / ROWS, segments.shape)
    return segments[(np.abs(segments) < 0.5).all(1)]


def rolled(segments: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """The segments as a rolling shutter sees them, motion [6] coefficients of u, u^2, u^3."""
    tx, rz = (np.concatenate([[0.0], c]) for c in (motion[:3], motion[3:]))
    at = geometry.row_motion_from_polynomial(tx, rz, -0.5, 0.5)
    ends = [geometry.gs_to_rs(segments[:, k], segments[:, k + 1], at) for k in (0, 2)]
    return np.stack([*ends[0], *ends[1]], 1)


def error_px(found: np.ndarray, truth: np.ndarray) -> float:
    u = (np.arange(256) + 0.5) / 256
    powers = np.stack([u, u**2, u**3])
    one, other = (RowMotion(256, 256 * (c[:3] @ powers), c[3:] @ powers) for c in (found, truth))
    return motion_error(one, other).epe


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_motion_of_a_street_is_found_though_the_camera_is_askew(seed: int) -> None:
    """A roll of 0.6 degrees, taken for shear, would cost 1.3 px."""
    seen = rolled(street(roll=0.01, tilt=0.1, seed=seed), MOTION)
    posterior = explore(quadratic_likelihood(seen, ROWS, params=DRAWN), STARTS)
    assert error_px(np.zeros(6), MOTION) > 5
    assert error_px(posterior.motion, MOTION) < 1.2
    assert posterior.evidence > 20
    assert posterior.expected_error < 3 / 256


def test_a_scene_on_its_side_needs_to_know_where_up_is() -> None:
    seen = rolled(street(tilt=0.2, seed=3, turned=1), MOTION)
    found = explore(quadratic_likelihood(seen, ROWS, params=DRAWN, known=KnownCamera(up=(1, 0))), STARTS)
    assert error_px(found.motion, MOTION) < 1.5


def test_a_camera_that_stood_still_is_recognised() -> None:
    still = explore(quadratic_likelihood(street(roll=0.02, tilt=0.15, seed=4), ROWS), [])
    assert still.evidence < 0


def test_a_known_roll_and_tilt_tell_the_shear() -> None:
    """Verticals alone, seen by a camera held 3 degrees askew: without its roll they are taken for sheared."""
    about = street(roll=0.05, tilt=0.1, yaw=0.0, clutter=0, seed=8)
    upright = about[np.abs(about[:, 3] - about[:, 1]) > 3 * np.abs(about[:, 2] - about[:, 0])]
    seen = rolled(upright, MOTION)
    guessed = explore(quadratic_likelihood(seen, ROWS, params=DRAWN), STARTS)
    known = explore(quadratic_likelihood(seen, ROWS, params=DRAWN, known=KnownCamera(roll=0.05, tilt=0.1)), STARTS)
    assert error_px(known.motion, MOTION) < 0.6 * error_px(guessed.motion, MOTION)
    wrong = explore(quadratic_likelihood(seen, ROWS, params=DRAWN, known=KnownCamera(roll=-0.05, tilt=0.1)), STARTS)
    assert error_px(wrong.motion, MOTION) > 2 * error_px(known.motion, MOTION)


def test_seen_from_above_a_known_tilt_leaves_right_angles_on_the_ground() -> None:
    """A drone that looks straight down: no verticals are seen, the streets' right angle tells the shear."""
    seen = rolled(street(tilt=-math.pi / 2, yaw=0.4, clutter=0, seed=9), MOTION)
    found = explore(
        quadratic_likelihood(seen, ROWS, params=DRAWN, known=KnownCamera(roll=0.0, tilt=-math.pi / 2)), STARTS
    )
    assert error_px(found.motion, MOTION) < 1.0


def test_right_angles_overrule_an_opinion_with_a_wrong_shear() -> None:
    seen = rolled(street(roll=0.01, tilt=0.1, seed=5), MOTION)
    wrong = MOTION + np.array([0.04, 0, 0, 0, 0, 0])
    opinion = NetworkObservation(wrong, np.diag(1 / np.array([0.03, 0.03, 0.005, 0.03, 0.03, 0.005]) ** 2))
    found = explore(quadratic_likelihood(seen, ROWS, params=DRAWN, observation=opinion), [wrong])
    assert error_px(wrong, MOTION) > 4
    assert error_px(found.motion, MOTION) < 1.0


def test_without_right_angles_nothing_is_sure() -> None:
    rng = np.random.default_rng(6)
    middle, half = rng.uniform(-0.45, 0.45, (150, 2)), rng.normal(0, 0.03, (150, 2))
    posterior = explore(quadratic_likelihood(np.concatenate([middle - half, middle + half], 1), ROWS), [])
    sure = explore(quadratic_likelihood(rolled(street(), MOTION), ROWS), [])
    assert posterior.lines_gain < 0.3 < sure.lines_gain
    assert posterior.evidence < sure.evidence


def test_the_posterior_is_what_it_was() -> None:
    """Figures written down once: a change of the code that is to change no answer changes none."""
    seen = rolled(street(roll=0.01, tilt=0.1, seed=7), MOTION)
    opinion = NetworkObservation(0.8 * MOTION, np.diag(np.full(6, 1e3)))
    found = explore(quadratic_likelihood(seen, ROWS, 1.3, observation=opinion), STARTS)
    mean = (0.0741888777, -0.1214981652, -0.0041493966, 0.0715706972, 0.0297505193, -0.0005794571)
    sigma = (0.0110069974, 0.0114347408, 0.0076753139, 0.0111291198, 0.0128066265, 0.0076766859)
    np.testing.assert_allclose(found.motion, mean, rtol=1e-6)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), sigma, rtol=1e-6)
    assert found.lines_gain == pytest.approx(2.1306408264, rel=1e-7)


def kinds(*widths: tuple[str, float, float]) -> list[MotionKind]:
    """Kinds of motion by name, width of the even part of t_x [rows], and width of all else."""
    share = 1 / len(widths)
    return [MotionKind(name, np.diag([even, *[rest] * 5]) ** 2, NORMAL, share) for name, even, rest in widths]


@pytest.mark.parametrize(
    ("motion", "kind"), [(np.array([0.08, 0, 0, 0, 0, 0]), "pan"), (np.array([0.03, -0.12, 0, 0.05, 0.03, 0]), "any")]
)
def test_the_kind_of_motion_is_found_with_it(motion: np.ndarray, kind: str) -> None:
    seen = rolled(street(roll=0.01, tilt=0.1, seed=1), motion)
    both = kinds(("any", 0.06, 0.06), ("pan", 0.06, 0.002))
    found = explore(ManhattanLikelihood(seen, ROWS, params=DRAWN, kinds=both), STARTS)
    assert max(found.kinds, key=found.kinds.__getitem__) == kind
    assert sum(found.kinds.values()) == pytest.approx(1)
    assert found.kinds[kind] > 0.8
    assert error_px(found.motion, motion) < 1.5


def test_two_kinds_that_are_the_same_change_nothing() -> None:
    seen = rolled(street(roll=0.01, tilt=0.1, seed=2), MOTION)
    one, two = kinds(("a", 0.06, 0.05)), kinds(("a", 0.06, 0.05), ("b", 0.06, 0.05))
    alone, both = (explore(ManhattanLikelihood(seen, ROWS, kinds=each), STARTS) for each in (one, two))
    np.testing.assert_allclose(both.motion, alone.motion, atol=1e-6)
    assert both.evidence == pytest.approx(alone.evidence, abs=1e-3)
    assert both.kinds == pytest.approx({"a": 0.5, "b": 0.5}, abs=1e-3)


def test_heavy_tails_believe_in_large_motions_and_still_hold_small_ones_likely() -> None:
    """Student's t and a normal distribution of the same scale: the same density at its peak but for a constant."""
    scale = np.diag([0.01] * 6) ** 2
    wide, narrow = (MotionKind("", scale, freedom, 1.0) for freedom in (3.0, NORMAL))
    assert narrow.log_peak == pytest.approx(0, abs=1e-5)
    draws = np.random.default_rng(0).normal(size=(100_000, 6)) * 0.02  # importance sampling of Student's t integral
    log_normal = -0.5 * (draws**2).sum(1) / 0.02**2 - 6 * math.log(0.02 * math.sqrt(2 * math.pi))
    log_t = (
        -4.5 * np.log1p((draws**2).sum(1) / 0.01**2 / 3) + wide.log_peak - 6 * math.log(0.01 * math.sqrt(2 * math.pi))
    )
    assert np.exp(log_t - log_normal).mean() == pytest.approx(1, rel=0.25)


def test_hypotheses_that_may_move_do_not_disturb_those_at_rest() -> None:
    likelihood = quadratic_likelihood(rolled(street(roll=0.01, tilt=0.1), MOTION), ROWS)
    begin = np.zeros((3, UNKNOWNS)) + likelihood.prior.mean
    begin[:, CAMERA] += np.array([[0.02, 0.1, 0.1, 0.6], [0.0, 0.0, -0.2, 0.4], [0.0, 0.1, 0.0, 0.5]])
    free = np.ones(begin.shape, bool)
    free[:2, : CAMERA.start] = False
    together, energy, _ = descend(likelihood, begin, free)
    alone, energy_alone, _ = descend(likelihood, begin[:2], CAMERA)
    np.testing.assert_allclose(together[:2], alone, atol=1e-9)
    np.testing.assert_allclose(energy[:2], energy_alone, rtol=1e-12)
    assert not together[:2, : CAMERA.start].any() and together[2, : CAMERA.start].all()
