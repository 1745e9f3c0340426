"""Smooth paths: those that the equations say, within the room that frames leave."""

import numpy as np
import pytest

from unshutter.frames.smoothing import Smoothing, stiffness_for

RNG = np.random.default_rng(0)


def smoothing(frames, period=30.0, weight=1.0):
    return Smoothing(np.arange(frames, dtype=float), stiffness_for(period), np.full((frames, 3), weight))


def cost(path, c, period=30.0):
    return stiffness_for(period) * (np.diff(path - c, 2, axis=0) ** 2).sum() + (c**2).sum()


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 32, 33, 34, 65, 200])
def test_blocks_solve_what_one_matrix_would(frames):
    path = np.cumsum(RNG.normal(0, 5, (frames, 3)), axis=0)
    bend = np.diff(np.eye(frames), 2, axis=0) if frames > 2 else np.zeros((0, frames))
    form = stiffness_for(30) * bend.T @ bend
    expected = np.linalg.solve(form + np.eye(frames), form @ path)
    assert smoothing(frames).corrections(path, np.zeros_like(path)) == pytest.approx(expected, abs=1e-8)


def test_an_even_pan_is_left_and_a_shake_goes():
    times = np.arange(300.0)
    pan = times[:, None] * [3.0, -1.0, 0.2]
    assert np.abs(smoothing(300).corrections(pan, np.zeros_like(pan))).max() < 1e-6
    shake = np.sin(2 * np.pi * times / 8)[:, None] * [4.0, 0.0, 1.0]
    left = pan + shake - smoothing(300).corrections(pan + shake, np.zeros_like(pan)) - pan
    assert np.abs(left[40:-40]).max() < 0.02 * 4


def test_a_period_is_halved():
    times = np.arange(1200.0)
    wave = np.sin(2 * np.pi * times / 30)[:, None] * np.ones(3)
    left = wave - smoothing(1200).corrections(wave, np.zeros_like(wave))
    assert np.abs(left[300:900]).max() == pytest.approx(0.5, abs=0.01)


def test_frames_that_come_unevenly_count_by_their_times():
    times = np.cumsum(RNG.choice([1.0, 1.0, 2.0], 200))
    pan = times[:, None] * [3.0, -1.0, 0.2]
    c = Smoothing(times, stiffness_for(30), np.ones((200, 3))).corrections(pan, np.zeros_like(pan))
    assert np.abs(c).max() < 1e-6


def test_corrections_stay_within_their_room_and_no_better_ones_are_there():
    path = np.cumsum(RNG.normal(0, 5, (200, 3)), axis=0)
    sides = np.broadcast_to(np.concatenate([np.eye(3), -np.eye(3)]), (200, 6, 3))
    free = smoothing(200).corrections(path, np.zeros_like(path))
    limit = np.abs(free).max() / 2
    c = smoothing(200).corrections(path, np.zeros_like(path), (sides, np.full((200, 6), limit)))
    assert np.abs(c).max() <= limit * (1 + 1e-6)
    best = cost(path, c)
    for _ in range(200):
        bump = np.convolve(RNG.normal(0, 1, 200), np.ones(15) / 15, "same")[:, None] * RNG.normal(0, 0.05, 3)
        assert cost(path, np.clip(c + bump, -limit, limit)) > best * (1 - 1e-6)


def test_frames_without_any_room_are_left_alone():
    path = np.cumsum(RNG.normal(0, 5, (60, 3)), axis=0)
    sides = np.broadcast_to(np.concatenate([np.eye(3), -np.eye(3)]), (60, 6, 3))
    room = np.full((60, 6), 10.0)
    room[30] = -2.0
    c = smoothing(60).corrections(path, np.zeros_like(path), (sides, room))
    assert np.abs(c[30]).max() < 0.01 and np.isfinite(c).all() and np.abs(c).max() > 1
