"""Finds the upward direction from the accelerometer of a gyro log, averaging samples after undoing the gyro's turns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from unshutter.gyro.rows import GyroTurns

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

_SPREAD_S = 2.0  # standard deviation of the average: longer than steps and swings, shorter than the gyro's drift
_RATE_HZ = 20.0  # rate of the averaged samples
_FEWEST = 16  # number of samples


def has_gravity(turns: GyroTurns) -> bool:
    """Whether the log contains acceleration that shows which way is up."""
    return len(turns.log.force) >= _FEWEST


def up_directions(
    turns: GyroTurns, frame_s: Float64[np.ndarray, "frames"], row: float
) -> Float64[np.ndarray, "frames 3"]:
    """Returns unit vectors pointing up, in the camera's axes (right, down, forward), when a row of a frame was exposed.

    Args:
        turns: turns of the camera from a log that :func:`has_gravity`.
        frame_s: times of the frames on the clip's clock [s].
        row: row as a fraction of the height.
    """
    log, alignment = turns.log, turns.alignment
    times, force = log.force[:, 0], log.force[:, 1:]
    still = np.einsum("nji,nj->ni", log.rotations(times), force)  # as if the device had not turned
    grid = np.arange(times[0], times[-1] + 1 / _RATE_HZ, 1 / _RATE_HZ)
    even = np.stack([np.interp(grid, times, axis) for axis in still.T], axis=-1)
    reach = round(3 * _SPREAD_S * _RATE_HZ)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (_SPREAD_S * _RATE_HZ)) ** 2)
    total = np.convolve(np.ones(len(grid)), kernel)[reach:-reach]
    mean = np.stack([np.convolve(axis, kernel)[reach:-reach] / total for axis in even.T], axis=-1)
    at_s = alignment.log_time(frame_s, np.full(len(frame_s), row))
    up = np.stack([np.interp(at_s, grid, axis) for axis in mean.T], axis=-1)
    up = np.einsum("ij,njk,nk->ni", alignment.axes, log.rotations(at_s), up)
    return up / np.linalg.norm(up, axis=1, keepdims=True).clip(1e-9)
