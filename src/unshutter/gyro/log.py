"""Angular rates over time as logged by a gyro, and the rotations that result from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.geometry.rotations import rotation_matrix

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

_GAP = 3.0  # multiple of the usual interval: in a longer one samples are missing
_MOST_DISORDER = 0.01  # maximum share of samples out of order
_FASTEST = 100.0  # rad/s; faster rates must be in another unit
_FEWEST_HZ, _FEWEST = 20.0, 16  # samples per second, and in total: fewer do not show how a camera turned
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True, eq=False)
class GyroLog:
    """Angular rates about the three axes of a device, right-handed, in any orientation relative to the camera.

    Attributes:
        t_s: [N] times [s], increasing; on the log's own clock.
        rates: [N, 3] angular rate about the device's axes [rad/s].
        origin: source of the log, for messages.
        force: [M, 4] time [s] and acceleration along the same axes [m/s^2], which points up at rest; may be empty.
        readout_ms: readout time of a frame stated in the log; None: not stated.
        on_clip_clock: whether its clock roughly agrees with the clip's, as in a file that contains both.

    Raises:
        UnshutterError: there are too few samples, the times do not increase, or the rates are impossible.
    """

    t_s: np.ndarray
    rates: np.ndarray
    origin: str
    force: np.ndarray
    readout_ms: float | None = None
    on_clip_clock: bool = False

    def __post_init__(self) -> None:
        times, rates = np.asarray(self.t_s, np.float64), np.asarray(self.rates, np.float64)
        if rates.shape != (len(times), 3):
            raise UnshutterError(f"{self.origin}: the log has {len(times)} times but rates of shape {rates.shape}")
        finite = np.isfinite(times) & np.isfinite(rates).all(axis=1)
        times, rates = times[finite], rates[finite]
        if len(times) < _FEWEST:
            raise UnshutterError(f"{self.origin}: the log has only {len(times)} gyro samples")
        if (np.diff(times) <= 0).mean() > _MOST_DISORDER:
            raise UnshutterError(f"{self.origin}: the times of the log do not increase")
        times, order = np.unique(times, return_index=True)
        rates = rates[order]
        if 1 / np.median(np.diff(times)) < _FEWEST_HZ:
            raise UnshutterError(f"{self.origin}: the log has fewer than {_FEWEST_HZ:g} gyro samples a second")
        if np.quantile(np.abs(rates), 0.9) > _FASTEST:
            raise UnshutterError(f"{self.origin}: the log's rates cannot be rates of a camera: is their unit right?")
        force = np.asarray(self.force, np.float64).reshape(-1, 4)
        force = force[np.isfinite(force).all(axis=1)]
        for name, value in (("t_s", times), ("rates", rates), ("force", force[np.argsort(force[:, 0])])):
            object.__setattr__(self, name, value)

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last sample [s]."""
        return float(self.t_s[0]), float(self.t_s[-1])

    @property
    def rate_hz(self) -> float:
        """Usual number of samples per second."""
        return float(1 / np.median(np.diff(self.t_s)))

    @cached_property
    def _angles(self) -> np.ndarray:
        """Integral of the rate about each axis separately [N, 3] [rad]."""
        steps = np.diff(self.t_s)[:, None]
        turned = np.cumsum((self.rates[:-1] + self.rates[1:]) / 2 * steps, axis=0)
        return np.concatenate([np.zeros((1, 3)), turned])

    def angles(self, at_s: Float64[np.ndarray, "*times"]) -> Float64[np.ndarray, "*times 3"]:
        """Returns angles since the start of the log, axis by axis [rad]; for differences over short times."""
        return np.stack([np.interp(at_s, self.t_s, angle) for angle in self._angles.T], axis=-1)

    @cached_property
    def _steps(self) -> np.ndarray:
        """Rate of the scene between samples [N - 1, 3] [rad/s], constant in each interval."""
        return -(self.rates[:-1] + self.rates[1:]) / 2

    @cached_property
    def _whole(self) -> np.ndarray:
        """Orientation of the scene at the samples [N, 3, 3]."""
        turns = rotation_matrix(self._steps * np.diff(self.t_s)[:, None])
        return np.concatenate([np.eye(3)[None], chained(turns)])

    def rotations(self, at_s: Float64[np.ndarray, "*times"]) -> Float64[np.ndarray, "*times 3 3"]:
        """Returns the orientation R of the scene in the device's axes: direction d at the start of the log becomes R d.

        Beyond the ends of the log, the device is assumed to continue turning as it did there.
        """
        before = np.clip(np.searchsorted(self.t_s, at_s, side="right") - 1, 0, len(self.t_s) - 2)
        since = rotation_matrix(self._steps[before] * (at_s - self.t_s[before])[..., None])
        return since @ self._whole[before]

    def covers(self, begin_s: float, end_s: float) -> bool:
        """Whether there are samples throughout a period."""
        inside = (self.t_s >= begin_s) & (self.t_s <= end_s)
        times = np.concatenate([[begin_s], self.t_s[inside], [end_s]])
        return bool(np.diff(times).max() <= max(_GAP / self.rate_hz, 0.1))


def chained(turns: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "n 3 3"]:
    """Computes the products turns[0], turns[1] turns[0], ..., in parallel blocks that are joined afterwards."""
    block = max(1, int(np.sqrt(len(turns))))
    padded = np.concatenate([turns, np.broadcast_to(np.eye(3), (-len(turns) % block, 3, 3))])
    blocks = padded.reshape(-1, block, 3, 3).copy()
    for k in range(1, block):
        blocks[:, k] = blocks[:, k] @ blocks[:, k - 1]
    for k in range(1, len(blocks)):
        blocks[k] = blocks[k] @ blocks[k - 1, -1]
    return blocks.reshape(-1, 3, 3)[: len(turns)]
