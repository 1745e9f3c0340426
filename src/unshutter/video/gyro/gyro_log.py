"""Gyro logs: angular rates over time and the rotations that result, read from files, and their alignment with a clip.

Gyroflow's .gcsv and GoPro's clips are read directly, other cameras and flight controllers by telemetry-parser.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from itertools import chain, islice
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.tracks import Tracks
from unshutter.motion.rotations import rotation_matrix
from unshutter.motion.shapes import Float64
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.storage.files import check_plain
from unshutter.video.file import gpmf

_GAP = 3.0  # multiple of the usual interval: in a longer one samples are missing
_LARGEST = 1e12  # s, rad/s, m/s^2: larger numbers are damage
_MIN_HZ = 20.0  # samples per second: fewer do not show how a camera turned
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True, eq=False)
class GyroLog:
    """Angular rates about the three axes of a device, right-handed, in any orientation relative to the camera.

    Raises:
        UnshutterError: there are too few samples, the times do not increase, or the rates are impossible.
    """

    t_s: np.ndarray  # [N] times [s], increasing; on the log's own clock
    rates: np.ndarray  # [N, 3] angular rate about the device's axes [rad/s]
    origin: str  # source of the log, for messages
    # [M, 4] time [s] and acceleration along the same axes [m/s^2], which points up at rest; may be empty
    force: np.ndarray
    readout_time: ReadoutTime | None = None  # as stated in the log; None: not stated
    on_clip_clock: bool = False  # whether its clock roughly agrees with the clip's, as in a file that contains both

    def __post_init__(self) -> None:
        times = np.asarray(self.t_s, np.float64)
        rates = np.asarray(self.rates, np.float64)
        if rates.shape != (len(times), 3):
            raise UnshutterError(f"{self.origin}: the log has {len(times)} times but rates of shape {rates.shape}")
        possible = (np.abs(times) < _LARGEST) & (np.abs(rates) < _LARGEST).all(axis=1)
        times = times[possible]
        rates = rates[possible]
        if len(times) < 16:
            raise UnshutterError(f"{self.origin}: the log has only {len(times)} gyro samples")
        if (np.diff(times) <= 0).mean() > 0.01:
            raise UnshutterError(f"{self.origin}: the times of the log do not increase")
        times, order = np.unique(times, return_index=True)
        rates = rates[order]
        if 1 / np.median(np.diff(times)) < _MIN_HZ:
            raise UnshutterError(f"{self.origin}: the log has fewer than {_MIN_HZ:g} gyro samples a second")
        if np.quantile(np.abs(rates), 0.9) > 100.0:
            raise UnshutterError(f"{self.origin}: the log's rates cannot be rates of a camera: is their unit right?")
        force = np.asarray(self.force, np.float64).reshape(-1, 4)
        force = force[(np.abs(force) < _LARGEST).all(axis=1)]
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
        rotated = np.cumsum((self.rates[:-1] + self.rates[1:]) / 2 * steps, axis=0)
        return np.concatenate([np.zeros((1, 3)), rotated])

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
        rotations = rotation_matrix(self._steps * np.diff(self.t_s)[:, None])
        return np.concatenate([np.eye(3)[None], chained(rotations)])

    def rotations(self, at_s: Float64[np.ndarray, "*times"]) -> Float64[np.ndarray, "*times 3 3"]:
        """Returns the orientation R of the scene in the device's axes: direction d at the start of the log becomes R d.

        Beyond the ends of the log, the device is assumed to continue turning as it did there.
        """
        before = np.clip(np.searchsorted(self.t_s, at_s, side="right") - 1, 0, len(self.t_s) - 2)
        since = rotation_matrix(self._steps[before] * (at_s - self.t_s[before])[..., None])
        return since @ self._whole[before]

    @property
    def stretches(self) -> list[tuple[float, float]]:
        """Periods (begin, end) [s] in which no samples are missing."""
        last = np.append(np.flatnonzero(np.diff(self.t_s) > self._longest_gap_s), len(self.t_s) - 1)
        first = np.concatenate([[0], last[:-1] + 1])
        return list(zip(self.t_s[first].tolist(), self.t_s[last].tolist(), strict=True))

    def covers(self, begin_s: float, end_s: float) -> bool:
        """Whether there are samples throughout a period."""
        inside = (self.t_s >= begin_s) & (self.t_s <= end_s)
        times = np.concatenate([[begin_s], self.t_s[inside], [end_s]])
        return bool(np.diff(times).max() <= self._longest_gap_s)

    def between(self, begin_s: float, end_s: float) -> GyroLog:
        """Returns the part of the log in a period; the whole log if that part is too short to be a log."""
        inside, pushed = ((each >= begin_s) & (each <= end_s) for each in (self.t_s, self.force[:, 0]))
        try:
            return replace(self, t_s=self.t_s[inside], rates=self.rates[inside], force=self.force[pushed])
        except UnshutterError:
            return self

    @cached_property
    def _longest_gap_s(self) -> float:
        return max(_GAP / self.rate_hz, 0.1)


def chained(rotations: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "n 3 3"]:
    """Computes the products R0, R1 R0, R2 R1 R0 ..., in blocks that are computed together and then joined."""
    block = max(1, int(np.sqrt(len(rotations))))
    padded = np.concatenate([rotations, np.broadcast_to(np.eye(3), (-len(rotations) % block, 3, 3))])
    blocks = padded.reshape(-1, block, 3, 3).copy()
    for k in range(1, block):
        blocks[:, k] = blocks[:, k] @ blocks[:, k - 1]
    for k in range(1, len(blocks)):
        blocks[k] = blocks[k] @ blocks[k - 1, -1]
    return blocks.reshape(-1, 3, 3)[: len(rotations)]


_HEADS = ("GYROFLOW IMU LOG", "CAMERA IMU LOG")  # first lines of .gcsv files


def log_of_file(path: str | os.PathLike[str]) -> GyroLog:
    """Reads a log from a file next to its clip."""
    place = Path(path)
    try:
        check_plain(place)
        if place.stat().st_size > 1 << 30:
            raise UnshutterError(f"{place} is too large for a gyro log")
        with place.open("rb") as stream:
            is_gcsv = stream.readline(200).strip().decode("utf-8", "replace").upper() in _HEADS
        if is_gcsv:
            with place.open(encoding="utf-8", errors="replace") as text:
                return _gcsv(place.name, text)
    except OSError as error:
        raise UnshutterError(f"cannot read gyro log {place}: {error.strerror}") from None
    log = log_of_camera(place)
    if log is None:
        raise UnshutterError(f"{place}: cannot read a gyro log from it; Gyroflow's .gcsv format works")
    return log


def can_parse() -> bool:
    """Whether telemetry-parser is installed, which has no wheels for some Python versions."""
    return find_spec("telemetry_parser") is not None


def log_of_camera(path: str | os.PathLike[str]) -> GyroLog | None:
    """Reads the gyro log in a clip or a logger's file; None if there is none, or a parser is missing.

    Raises:
        DamagedLogError: a GoPro's log has nothing that can be read.
    """
    with suppress(gpmf.NotPlainError, OSError):
        telemetry = gpmf.telemetry_of(os.fspath(path))
        if telemetry is not None:
            return _usable("GoPro", telemetry.rates, telemetry.force)
    return _by_parser(path)


def _usable(origin: str, rates: np.ndarray, force: np.ndarray) -> GyroLog | None:
    """Returns the log of times and rates [N, 4], on the clip's clock; None if it is unusable, e.g. too short."""
    with suppress(UnshutterError):
        return GyroLog(rates[:, 0], rates[:, 1:], origin, force, on_clip_clock=True)
    return None


def _by_parser(path: str | os.PathLike[str]) -> GyroLog | None:
    try:
        telemetry_parser = import_module("telemetry_parser")
    except ImportError:
        return None
    try:
        parser = telemetry_parser.Parser(os.fspath(path))
        samples = parser.normalized_imu()
        maker = parser.camera or ""
        model = parser.model or ""
        name = model if model.startswith(maker) else f"{maker} {model}".strip()
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # panics of its Rust code are not Exceptions
        return None
    rates = [(sample["timestamp_ms"], *sample["gyro"]) for sample in samples if sample.get("gyro")]
    forces = [(sample["timestamp_ms"], *sample["accl"]) for sample in samples if sample.get("accl")]
    if not rates:
        return None
    rate = np.array(rates, np.float64)
    force = np.array(forces, np.float64).reshape(-1, 4)
    rate[:, 0] /= 1000
    force[:, 0] /= 1000
    rate[:, 1:] = np.radians(rate[:, 1:])
    return _usable(name, rate, force)


def _gcsv(name: str, lines: Iterable[str]) -> GyroLog:
    """Parses a log in Gyroflow's format: lines ``key,value``, a line that names the columns, and the samples."""
    reported: dict[str, str] = {}
    columns = []
    lines = iter(lines)
    for line in lines:
        words = [word.strip() for word in line.split(",")]
        if {"t", "gx", "gy", "gz"} <= {word.lower() for word in words}:
            columns = [word.lower() for word in words]
            break
        if len(words) > 1:
            reported[words[0].lower()] = words[1]
        if len(reported) > 100:
            break
    if not columns:
        raise UnshutterError(f"{name}: no line names the log's columns (t,gx,gy,gz,...)")
    rows = (line for line in lines if line.count(",") == len(columns) - 1)  # the last line may be truncated
    try:
        scale = {key: float(reported.get(key, usual)) for key, usual in (("tscale", 1), ("gscale", 1), ("ascale", 1))}
        first = list(islice(rows, 1)) or [",".join(["nan"] * len(columns))]  # NumPy warns if there is none
        values = np.loadtxt(chain(first, rows), delimiter=",", comments=None, ndmin=2)
        readout_ms = abs(float(reported.get("frame_readout_time", 0)))
    except ValueError:
        raise UnshutterError(f"{name}: the log has values that are not numbers") from None
    with np.errstate(over="ignore", invalid="ignore"):  # values without meaning are left out of the log
        times = values[:, columns.index("t")] * scale["tscale"]
        rates = values[:, [columns.index(key) for key in ("gx", "gy", "gz")]] * scale["gscale"]
        force = np.zeros((0, 4))
        if {"ax", "ay", "az"} <= set(columns):
            along = values[:, [columns.index(key) for key in ("ax", "ay", "az")]] * scale["ascale"] * GRAVITY
            force = np.concatenate([times[:, None], along], axis=1)
    stated = ReadoutTime.of_ms(readout_ms, ReadoutSource.GYRO_LOG, name) if 0 < readout_ms < math.inf else None
    return GyroLog(times, rates, name, force, stated)


@dataclass(frozen=True, eq=False)
class Pair:
    """Tracks from one frame to a later one, and the times of both frames."""

    tracks: Tracks  # tracks of the background
    begin_s: float  # time of the first frame on the clip's clock [s]
    end_s: float  # time of the second [s]


@dataclass(frozen=True, eq=False)
class Alignment:
    """Alignment of a log with a clip."""

    axes: np.ndarray  # [3, 3] rotation from the device's axes to the camera's (right, down, forward)
    # time of the log minus that of the clip, at ``at_s`` of the clip, for the middle row of a frame [s]
    offset_s: float
    drift: float  # rate at which the offset grows [s per s]
    at_s: float  # middle of the compared part of the clip [s]
    bias: np.ndarray  # [3] rate that the log shows at rest, in the camera's axes [rad/s]
    focal_px: float  # focal length [px of ROWS rows]
    ratio: float  # readout time in frame intervals
    interval_s: float  # usual time from one frame to the next [s]

    def log_time(self, frame_s: Float64[np.ndarray, "*at"], row: Float64[np.ndarray, "*at"]) -> np.ndarray:
        """Returns the times at which rows were exposed, on the log's clock [s].

        Args:
            row: row as a fraction of the height: 0 is the top edge of the first one, 1 the bottom edge of the last one.
        """
        since = frame_s - self.at_s
        return frame_s + self.offset_s + self.drift * since + self.ratio * self.interval_s * (row - 0.5)

    def to_camera_axes(
        self, device: Float64[np.ndarray, "*at 3 3"], lasted_s: Float64[np.ndarray, "*at"]
    ) -> Float64[np.ndarray, "*at 3 3"]:
        """Converts rotations in the device's axes to those in the camera's axes, without the log's bias."""
        rest = rotation_matrix(self.bias * np.asarray(lasted_s)[..., None])
        return rest @ (self.axes @ device @ self.axes.T)
