import math

import numpy as np
import pytest

import unshutter
from unshutter import Motion, RowMotion
from unshutter.estimators.base import View
from unshutter.estimators.methods.manhattan import segments_of
from unshutter.estimators.right_angles.likelihood import UNKNOWNS, Beliefs, ManhattanLikelihood, SecondOpinion
from unshutter.estimators.right_angles.search import explore
from unshutter.evaluation.metrics import motion_error
from unshutter.geometry import rows as geometry
from unshutter.photo import Photo

ROWS = 512
DRAWN = Beliefs(independent=1.0)  # no drawn segment repeats another's error
STARTS = [np.eye(6)[k] * size for k, size in ((0, 0.1), (0, -0.1), (3, 0.07), (3, -0.07))]


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


MOTION = np.array([0.09, -0.14, 0.0, 0.06, 0.03, 0.0])


@pytest.mark.parametrize(("up", "roll"), [((0, -1), None), ((1, 0), 0.1)])
def test_derivatives_are_those_of_the_energy(up: tuple[int, int], roll: float | None) -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    opinion = SecondOpinion(rng.normal(0, 0.1, 6), root @ root.T)
    wide = Beliefs(exact=0.3, sloppy=0.5, independent=1.0)
    about = {"opinion": opinion, "roll": roll}
    likelihood = ManhattanLikelihood(rng.uniform(-0.5, 0.5, (30, 4)), ROWS, 1.2, wide, up, **about)
    at = rng.normal(0.1, 0.1, (3, UNKNOWNS))
    energy, gradient, hessian = likelihood.expanded(at)
    np.testing.assert_allclose(energy, likelihood.energy(at))
    for k in range(UNKNOWNS):
        step = 1e-6 * np.eye(UNKNOWNS)[k]
        numeric = (likelihood.energy(at + step) - likelihood.energy(at - step)) / 2e-6
        np.testing.assert_allclose(gradient[:, k], numeric, rtol=1e-5, atol=1e-6)
    assert (np.linalg.eigvalsh(hessian) > 0).all()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_motion_of_a_street_is_found_though_the_camera_is_askew(seed: int) -> None:
    """A roll of 0.6 degrees, taken for shear, would cost 1.3 px."""
    seen = rolled(street(roll=0.01, tilt=0.1, seed=seed), MOTION)
    posterior = explore(ManhattanLikelihood(seen, ROWS, beliefs=DRAWN), STARTS)
    assert error_px(np.zeros(6), MOTION) > 5
    assert error_px(posterior.mean, MOTION) < 1.2
    assert posterior.still < 0.01
    assert posterior.confidence > 0.5


def test_a_scene_on_its_side_needs_to_know_where_up_is() -> None:
    seen = rolled(street(tilt=0.2, seed=3, turned=1), MOTION)
    found = explore(ManhattanLikelihood(seen, ROWS, beliefs=DRAWN, up=(1, 0)), STARTS)
    assert error_px(found.mean, MOTION) < 1.5


def test_a_camera_that_stood_still_is_recognised() -> None:
    still = explore(ManhattanLikelihood(street(roll=0.02, tilt=0.15, seed=4), ROWS), [])
    assert still.still > 0.5
    assert error_px(still.mean, np.zeros(6)) < 0.3


def test_a_known_roll_and_tilt_tell_the_shear() -> None:
    """Verticals alone, seen by a camera held 3 degrees askew: without its roll they are taken for sheared."""
    about = street(roll=0.05, tilt=0.1, yaw=0.0, clutter=0, seed=8)
    upright = about[np.abs(about[:, 3] - about[:, 1]) > 3 * np.abs(about[:, 2] - about[:, 0])]
    seen = rolled(upright, MOTION)
    guessed = explore(ManhattanLikelihood(seen, ROWS, beliefs=DRAWN), STARTS)
    known = explore(ManhattanLikelihood(seen, ROWS, beliefs=DRAWN, roll=0.05, tilt=0.1), STARTS)
    assert error_px(known.mean, MOTION) < 0.6 * error_px(guessed.mean, MOTION)
    wrong = explore(ManhattanLikelihood(seen, ROWS, beliefs=DRAWN, roll=-0.05, tilt=0.1), STARTS)
    assert error_px(wrong.mean, MOTION) > 2 * error_px(known.mean, MOTION)


def test_seen_from_above_a_known_tilt_leaves_right_angles_on_the_ground() -> None:
    """A drone that looks straight down: no verticals are seen, the streets' right angle tells the shear."""
    seen = rolled(street(tilt=-math.pi / 2, yaw=0.4, clutter=0, seed=9), MOTION)
    found = explore(ManhattanLikelihood(seen, ROWS, beliefs=DRAWN, roll=0.0, tilt=-math.pi / 2), STARTS)
    assert error_px(found.mean, MOTION) < 1.0


def test_right_angles_overrule_an_opinion_with_a_wrong_shear() -> None:
    seen = rolled(street(roll=0.01, tilt=0.1, seed=5), MOTION)
    wrong = MOTION + np.array([0.04, 0, 0, 0, 0, 0])
    opinion = SecondOpinion(wrong, np.diag(1 / np.array([0.03, 0.03, 0.005, 0.03, 0.03, 0.005]) ** 2))
    found = explore(ManhattanLikelihood(seen, ROWS, beliefs=DRAWN, opinion=opinion), [wrong])
    assert error_px(wrong, MOTION) > 4
    assert error_px(found.mean, MOTION) < 1.0


def test_without_right_angles_nothing_is_sure() -> None:
    rng = np.random.default_rng(6)
    middle, half = rng.uniform(-0.45, 0.45, (150, 2)), rng.normal(0, 0.03, (150, 2))
    posterior = explore(ManhattanLikelihood(np.concatenate([middle - half, middle + half], 1), ROWS), [])
    sure = explore(ManhattanLikelihood(rolled(street(), MOTION), ROWS), [])
    assert posterior.lines_gain < 0.3 < sure.lines_gain
    assert error_px(posterior.mean, np.zeros(6)) < 3


def test_a_photo_smaller_than_wanted_is_enlarged_without_a_shift(facade: np.ndarray) -> None:
    """The same straight picture in two sizes: verticals stay vertical, and where they are."""
    segments, size = segments_of(View(Photo.from_array(facade)))
    assert size == (768, 1024)
    longest = segments[np.argsort(-np.abs(segments[:, 3] - segments[:, 1]))][:8]
    np.testing.assert_allclose(longest[:, 0], longest[:, 2], atol=1 / 420)
    left = segments[:, 0] < 0
    mirrored, _ = segments_of(View(Photo.from_array(facade[:, ::-1].copy())))
    assert left.sum() == pytest.approx((mirrored[:, 0] > 0).sum(), abs=10)


@pytest.mark.parametrize("name", ["manhattan", "segment-manhattan"])
def test_a_photo_is_rectified(name: str, basilica: tuple[np.ndarray, Motion]) -> None:
    picture, truth = basilica
    found = unshutter.estimate(picture, estimator=name)
    nothing = motion_error(RowMotion.zero(truth.height, truth.width), truth).epe
    assert motion_error(found, truth).epe < 0.4 * nothing
    assert found.confidence is not None
    assert 0 < found.confidence < 1
    assert found.tx_px[0] == found.rz_rad[0] == 0


@pytest.mark.parametrize("name", ["manhattan", "segment-manhattan"])
def test_an_undistorted_facade_is_left_alone(name: str, facade: np.ndarray) -> None:
    found = unshutter.estimate(facade, estimator=name)
    assert np.abs(found.tx_px).max() * 256 / found.height < 1


def test_what_cannot_be_used_is_declined() -> None:
    estimator = unshutter.load("manhattan")
    blank = estimator.estimate(View(Photo.from_array(np.full((200, 300), 128, np.uint8))))
    assert blank.is_zero
    assert "0 straight segments" in blank.reason
    wide = estimator.estimate(View(Photo.from_array(np.zeros((100, 400), np.uint8))))
    assert "2.5 times" in wide.reason
