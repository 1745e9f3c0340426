"""The camera's turn over time, from tracks whose truth is known."""

import numpy as np
import pytest

from support.hand_held import FOCAL, HEIGHT, WIDTH, camera, exact_tracks, hand, pan
from unshutter.frames.camera import ROWS, Fit, Problem, rotation_between, steady
from unshutter.frames.self_calibration import focal_from_motion
from unshutter.frames.tracks import Tracks
from unshutter.motion.rotations import rotation_vector

UNIT = ROWS / HEIGHT


def error_px(fit, moving):
    """Largest error of a row's turn against its frame's first row, over all frames but the outermost [px]."""
    rows, worst = np.arange(HEIGHT), 0.0
    for k in range(2, moving.frames - 2):
        turn = fit.rotation(k + moving.readout_ratio * (rows + 0.5) / HEIGHT)
        off = (turn - turn[0]) - moving.motion(k).rotations
        worst = max(worst, float(np.abs(off).max()) * moving.focal_px)
    return worst


@pytest.mark.parametrize("ratio", [0.3, 0.9])
def test_exact_tracks_give_the_exact_motion(ratio):
    moving = camera(hand(), ratio, frames=16)
    fit = Problem(exact_tracks(moving), FOCAL * UNIT).fit(ratio)
    assert error_px(fit, moving) < 0.08
    assert fit.noise_px < 0.05


def test_noise_and_strays_hardly_matter():
    moving = camera(hand(1), 0.6, frames=16)
    fit = Problem(exact_tracks(moving, noise=0.1, strays=0.15), FOCAL * UNIT).fit(0.6)
    assert error_px(fit, moving) < 0.25
    assert fit.noise_px == pytest.approx(0.1 * UNIT, rel=0.35)


def test_a_picture_that_grows_is_not_taken_for_a_turn():
    """As of a camera that drives ahead: the middle stays, the corners move outwards."""
    rng = np.random.default_rng(0)
    start = rng.uniform((20, 20), (WIDTH - 20, HEIGHT - 20), (80, 2))
    end = start + 0.02 * (start - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    fit = Problem([Tracks(start, end, HEIGHT, WIDTH, 80)] * 8, FOCAL * UNIT).fit(0.5)
    turn = fit.rotation(np.linspace(0, 8, 30))
    assert np.abs(turn - turn[0]).max() * FOCAL < 0.05


def test_the_evidence_is_highest_at_the_true_ratio():
    moving = camera(hand(2), 0.6, frames=20)
    problem = Problem(exact_tracks(moving, noise=0.1), FOCAL * UNIT)
    heights = [problem.fit(ratio).log_evidence for ratio in (0.4, 0.6, 0.8)]
    assert heights[1] > max(heights[0], heights[2]) + 10


def test_two_frames_are_enough_for_an_even_motion():
    moving = camera(pan(15.0), 0.8, frames=2)
    fit = Problem(exact_tracks(moving), FOCAL * UNIT).fit(0.8)
    turn = fit.rotation(0.8 * np.array([0.0, 1.0]))
    assert (turn[1] - turn[0]) == pytest.approx([0, np.radians(15) * 0.8 / 30, 0], abs=2e-5)


@pytest.mark.parametrize("focal", [200.0, 500.0])
def test_the_focal_length_is_found(focal):
    moving = camera(hand(3), 0.5, frames=16, focal_px=focal)
    answer = focal_from_motion(exact_tracks(moving, noise=0.05), 0.5) / UNIT
    assert answer == pytest.approx(focal, rel=0.08)


def test_near_ground_at_the_bottom_is_not_taken_for_an_oscillation():
    rng = np.random.default_rng(0)
    pairs = []
    for _ in range(24):  # a drone that flies ahead: what is far stands still, what is near comes down
        start = rng.uniform((0, 0), (WIDTH, HEIGHT), (150, 2))
        down = 1.5 * np.clip(start[:, 1] / HEIGHT - 0.4, 0, None)
        end = start + np.stack([0.2 * down, down], axis=-1) + rng.normal(0, 0.03, start.shape)
        pairs.append(Tracks(start, end, HEIGHT, WIDTH, 150))
    problem = Problem(pairs, FOCAL * UNIT)
    for fit, most in ((problem.fit(0.6, 0.001), np.inf), (steady(problem.fit(0.6, 0.001), problem, 0.6), 0.9)):
        turns = fit.rotation(np.linspace(12, 12.6, 7)) * fit.focal_px
        reach = np.abs(turns - turns[3]).max()
        assert (reach > 1.5) if most == np.inf else (reach < most)


def test_the_turn_between_two_frames_with_strays():
    moving = camera(hand(seed=3), ratio=0.0, frames=6)
    for k, tracks in enumerate(exact_tracks(moving, noise=0.1, strays=0.3)):
        before, after = moving.rotations(np.array([float(k), k + 1.0]))
        turn = rotation_between(tracks, FOCAL * UNIT)
        off = (turn - rotation_vector(after @ before.T)) * FOCAL
        assert np.abs(off).max() < 0.15  # px


def test_the_path_of_one_window_becomes_that_of_the_next_without_a_step():
    """Both agree from frame to frame; the later one turns within all frames alike by as much as a wave adds."""
    knots = 4 * 30 + 3
    time = np.arange(knots) / 4
    shared = np.stack([np.sin(time / 3), np.cos(time / 4), 0 * time, 0 * time], axis=1)
    wave = 0.3 * np.sin(2 * np.pi * time)[:, None]
    earlier = Fit(shared[:80] + 7.0, 200.0, 0.1, 1.0, 0.0)
    later = Fit(shared + wave, 200.0, 0.1, 1.0, 0.0)
    joined = later.after(earlier, at=10.0, over=8.0)

    def lean(fit, frame):
        return fit.rotation(np.array([frame + 0.5]))[0] - fit.rotation(np.array([frame + 0.25]))[0]

    assert lean(joined, 6) == pytest.approx(lean(earlier, 6), abs=1e-9)
    assert lean(joined, 22) == pytest.approx(lean(later, 22), abs=1e-9)
    off = [float(np.linalg.norm(lean(joined, k) - lean(earlier, k))) for k in range(8, 19)]
    steps = np.diff(off)
    whole = float(np.linalg.norm(lean(later, 18) - lean(earlier, 18)))
    assert off[-1] == pytest.approx(whole, rel=0.1) and np.abs(steps).max() < 0.25 * whole
