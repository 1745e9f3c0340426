"""Angular rates over time as a gyro logged them, and how far the gyro turned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.geometry.rotations import rotation_matrix

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

_GAP = 3.0  # times the usual interval: in a longer one samples are missing
_MOST_DISORDER = 0.01  # share of the samples that may come late
_FASTEST = 100.0  # rad/s; faster, and the numbers are not in the unit that they are taken to be in
_FEWEST_HZ, _FEWEST = 20.0, 16  # samples per second, and at all: fewer do not say how a camera turned
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True, eq=False)
class GyroLog:
    """Angular rates about the three axes of a device, right-handed, whatever way it lay in the camera.

    Attributes:
        t_s: [N] times [s], increasing; on a clock of the log's own.
        rates: [N, 3] angular rate about the device's axes [rad/s].
        origin: where the log is from, for messages.
        force: [M, 4] time [s] and acceleration along the same axes [m/s^2], which at rest points up; may be empty.
        readout_ms: readout time of a frame that the log states; None: it states none.
        on_clip_clock: whether its clock is about that of the clip, as in a file that holds both.

    Raises:
        UnshutterError: there are too few samples, times that do not increase, or rates that cannot be.
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
        """From the first to the last sample [s]."""
        return float(self.t_s[0]), float(self.t_s[-1])

    @property
    def rate_hz(self) -> float:
        """Samples per second, as a rule."""
        return float(1 / np.median(np.diff(self.t_s)))

    @cached_property
    def _angles(self) -> np.ndarray:
        """[N, 3] each axis' rate added up by itself [rad]."""
        steps = np.diff(self.t_s)[:, None]
        turned = np.cumsum((self.rates[:-1] + self.rates[1:]) / 2 * steps, axis=0)
        return np.concatenate([np.zeros((1, 3)), turned])

    def angles(self, at_s: Float64[np.ndarray, "*times"]) -> Float64[np.ndarray, "*times 3"]:
        """Angles since the log began, each axis by itself [rad]; good for differences over short times."""
        return np.stack([np.interp(at_s, self.t_s, angle) for angle in self._angles.T], axis=-1)

    @cached_property
    def _steps(self) -> np.ndarray:
        """[N - 1, 3] rate of the scene between samples [rad/s], constant from one to the next."""
        return -(self.rates[:-1] + self.rates[1:]) / 2

    @cached_property
    def _whole(self) -> np.ndarray:
        """[N, 3, 3] orientation of the scene at the samples."""
        turns = rotation_matrix(self._steps * np.diff(self.t_s)[:, None])
        return np.concatenate([np.eye(3)[None], chained(turns)])

    def rotations(self, at_s: Float64[np.ndarray, "*times"]) -> Float64[np.ndarray, "*times 3 3"]:
        """Orientation of the scene in the device's axes: what lay in direction d when the log began lies in R d.

        Beyond the ends of the log, the device goes on turning as it did there.
        """
        before = np.clip(np.searchsorted(self.t_s, at_s, side="right") - 1, 0, len(self.t_s) - 2)
        since = rotation_matrix(self._steps[before] * (at_s - self.t_s[before])[..., None])
        return since @ self._whole[before]

    def covers(self, begin_s: float, end_s: float) -> bool:
        """Whether there are samples all the way from one moment to another."""
        inside = (self.t_s >= begin_s) & (self.t_s <= end_s)
        times = np.concatenate([[begin_s], self.t_s[inside], [end_s]])
        return bool(np.diff(times).max() <= max(_GAP / self.rate_hz, 0.1))


def chained(turns: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "n 3 3"]:
    """The products turns[0], turns[1] turns[0], ...: in blocks side by side, which are joined afterwards."""
    block = max(1, int(np.sqrt(len(turns))))
    padded = np.concatenate([turns, np.broadcast_to(np.eye(3), (-len(turns) % block, 3, 3))])
    blocks = padded.reshape(-1, block, 3, 3).copy()
    for k in range(1, block):
        blocks[:, k] = blocks[:, k] @ blocks[:, k - 1]
    for k in range(1, len(blocks)):
        blocks[k] = blocks[k] @ blocks[k - 1, -1]
    return blocks.reshape(-1, 3, 3)[: len(turns)]
