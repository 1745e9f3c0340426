"""Cameras in drawn hands, against what is known of hands."""

import numpy as np
import pytest
from scipy.signal import welch

from unshutter_lab.synthesis.handheld import draw_camera, draw_hand, draw_pan


def cameras(count: int = 4000):
    rng = np.random.default_rng(0)
    return [draw_camera(rng, 300, 400) for _ in range(count)]


def test_most_cameras_are_held_nearly_level_and_some_look_up() -> None:
    drawn = cameras()
    roll, tilt = (np.array([getattr(each, name) for each in drawn]) for name in ("roll", "tilt"))
    assert 0.4 < np.median(np.abs(roll)) < 0.8 and np.abs(roll).max() < 25
    assert 0.14 < (tilt > 10).mean() < 0.22 and tilt.max() < 41 and tilt.min() > -20
    view = np.degrees(2 * np.arctan(200 / np.array([each.focal_px for each in drawn])))
    assert 45 <= view.min() < 46 and 74 < view.max() <= 75
    yaw = np.array([each.yaw for each in drawn])
    assert np.abs(np.histogram(yaw, 6, (0, 360))[0] / len(yaw) - 1 / 6).max() < 0.02


def test_a_camera_is_the_same_for_every_size() -> None:
    upright, level = (draw_camera(np.random.default_rng(3), *size) for size in ((400, 300), (300, 400)))
    assert (upright.yaw, upright.tilt, upright.roll, upright.focal_px) == (
        level.yaw, level.tilt, level.roll, level.focal_px,
    )  # fmt: skip


def test_the_acceleration_of_hands_is_white_between_their_frequencies() -> None:
    rng = np.random.default_rng(1)
    densities = []
    for _ in range(60):
        log = draw_hand(rng, 20.0)
        rates = np.stack([log.yaw_rad_s, log.roll_rad_s, log.pitch_rad_s])
        frequency, power = welch(rates, fs=200, nperseg=1000)
        densities.append(power / 2 * (2 * np.pi * frequency) ** 2)  # two-sided, of the acceleration
    within = [(frequency > low) & (frequency < high) for low, high in ((1, 2), (2, 4), (4, 7), (12, 40))]
    slow, middle, fast, none = (np.median(np.mean(np.array(densities)[..., band], -1)) for band in within)
    assert slow == pytest.approx(0.5, rel=0.25)
    assert middle == pytest.approx(slow, rel=0.2) and fast == pytest.approx(slow, rel=0.2)
    assert none < 0.05 * slow


def test_axes_are_alike_and_people_differ() -> None:
    rng = np.random.default_rng(2)
    logs = [draw_hand(rng, 3.0) for _ in range(300)]
    spread = np.array([[rate.std() for rate in (log.yaw_rad_s, log.roll_rad_s, log.pitch_rad_s)] for log in logs])
    by_axis = np.median(spread, 0)
    assert by_axis.max() / by_axis.min() < 1.2
    assert np.log(spread.mean(1)).std() > 0.4


def test_pans_are_even_and_go_both_ways() -> None:
    rng = np.random.default_rng(3)
    speeds = np.degrees([draw_pan(rng, 5.0).yaw_rad_s.mean() for _ in range(200)])
    assert 0.35 < (speeds > 0).mean() < 0.65
    assert 30 < np.median(np.abs(speeds)) < 50
    log = draw_pan(rng, 1.0)
    assert log.t_s[0] <= 0 and log.t_s[-1] >= 1.0
