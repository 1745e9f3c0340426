"""Draws the attitude of hand-held cameras, their shake and their pans.

A hand's angular acceleration is white from 0.2 to 8 Hz, and alike about all three axes. Its two-sided density differs
from person to person: between 1 and 4 Hz, a log of a phone has 0.3 to 0.8 rad^2/s^4/Hz, those of TUM-VI 0.5 to 5.9.
"""

from __future__ import annotations

import numpy as np

from unshutter_lab.synthesis.panorama import Camera
from unshutter_lab.synthesis.rotation_log import RotationLog

_DENSITY, _SPREAD = 0.5, 1.0  # median of the density [rad^2/s^4/Hz], and standard deviation of its logarithm
_SLOWEST, _FASTEST = 0.2, 8.0  # Hz
_STEP_HZ = 0.1  # from one drawn frequency to the next
_SAMPLES_S = 0.005  # interval of the samples of a log
_MARGIN_S = 0.1  # before and after the time that is asked for
_PAN = (20.0, 60.0)  # degrees per second

_VIEW = (45.0, 75.0)  # degrees that a photo shows along its longer side
_ROLL, _ASKEW = 0.8, 0.12  # degrees: most cameras are held nearly level, this share has five times the spread
_TILT, _LOOKING_UP, _STEEPEST = 4.0, 0.2, 40.0  # degrees; this share looks up by as much as the last, as at towers


def draw_camera(rng: np.random.Generator, height: int, width: int) -> Camera:
    """Draws a camera as people hold theirs; its angles never depend on its size."""
    yaw, view = rng.uniform([0, _VIEW[0]], [360, _VIEW[1]]).tolist()
    roll = rng.normal(0, _ROLL) * (5 if rng.random() < _ASKEW else 1)
    level, steep = rng.normal(0, _TILT), rng.uniform(0, _STEEPEST)
    tilt = steep if rng.random() < _LOOKING_UP else level
    return Camera.of_view(height, width, view, yaw=yaw, tilt=tilt, roll=roll)


def draw_hand(rng: np.random.Generator, seconds: float) -> RotationLog:
    """Draws the shake of a hand for a time that begins at 0."""
    times = np.arange(-_MARGIN_S, seconds + _MARGIN_S, _SAMPLES_S)
    frequency = np.arange(_SLOWEST + _STEP_HZ / 2, _FASTEST, _STEP_HZ)
    frequency = frequency + rng.uniform(-0.5, 0.5, frequency.shape) * _STEP_HZ
    density = _DENSITY * np.exp(rng.normal(0, _SPREAD))
    # of the rate: the variance of a band is both sides of the density, integrated once
    deviation = np.sqrt(2 * density * _STEP_HZ) / (2 * np.pi * frequency)
    waves = rng.normal(0, deviation, (2, 3, len(frequency)))
    phase = 2 * np.pi * frequency[:, None] * times
    yaw, roll, pitch = waves[0] @ np.cos(phase) + waves[1] @ np.sin(phase)
    return RotationLog(times, yaw, roll, pitch)


def draw_pan(rng: np.random.Generator, seconds: float) -> RotationLog:
    """Draws a hand that pans the camera evenly to the left or right."""
    speed = np.radians(rng.uniform(*_PAN)) * rng.choice([-1, 1])
    hand = draw_hand(rng, seconds)
    return RotationLog(hand.t_s, hand.yaw_rad_s + speed, hand.roll_rad_s, hand.pitch_rad_s)
