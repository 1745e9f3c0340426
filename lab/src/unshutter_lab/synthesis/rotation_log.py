"""Recorded camera rotation: reads gyro and pose logs, and integrates them to angles."""

from __future__ import annotations

import os
import zipfile
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from unshutter.errors import UnshutterError
from unshutter.motion.rotations import rotation_matrix
from unshutter.motion.shapes import Float64
from unshutter.storage.files import check_plain

_GAP = 3.0  # times the usual interval: in longer ones samples are missing
_MOST_DISORDER = 0.01  # tolerated share of late samples
_JITTER_S = 0.03  # smoothing of logs of motion capture

_X, _Y, _Z = np.eye(3)
# (axis that points up in the picture, axis that points from the scene to the camera)
_GYRO_AXES = (_X, _Z)
_POSE_AXES = (_Z, _Y)


@dataclass(frozen=True)
class RotationLog:
    """Angular rate of a camera over time, about the three axes of the picture.

    The picture is the readout frame: its top is the line read first. Two of the log's own right-handed axes are named:
    the one pointing **up** in the picture, and the one pointing **back**, from the scene to the camera; the third then
    points to the right. A positive angle about ``up`` turns the camera left, so the scene moves right, t_x > 0; about
    ``back`` it turns the camera counter-clockwise, so the scene turns clockwise, r_z > 0; about ``right`` it turns the
    camera up, so the scene moves down.

    * Gyro logs are assumed to be a phone's: x to the right edge, y to the top edge, z out of the screen, the sensor's
      lines along the long side (so up is x, back is z). The sensor turns with the phone, so this holds for
      landscape and portrait alike.
    * Pose logs are assumed to have z up and to look along -y (so up is z, back is y), as in TUM-VI.
    """

    t_s: np.ndarray  # [N] times [s], increasing
    yaw_rad_s: np.ndarray  # [N] rate about ``up``
    roll_rad_s: np.ndarray  # [N] rate about ``back``
    pitch_rad_s: np.ndarray  # [N] rate about ``right``
    from_poses: bool = False  # whether rates are derived from orientations (motion capture) rather than a gyro

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> RotationLog:
        """Reads an NPZ file with ``t_s`` [N] (s) and either ``gyro_rad_s`` [N, 3] or ``quaternion_wxyz`` [N, 4].

        Rates are about the device's axes, orientations from device to world (``position_m`` is not used).
        """
        check_plain(Path(path))
        try:
            with open(path, "rb") as stream:
                file = np.load(stream, allow_pickle=False)
                data = {key: np.asarray(file[key], dtype=np.float64) for key in file.files if key in _SHAPES}
        except OSError as error:
            raise UnshutterError(f"cannot read trajectory {path}: {error.strerror or 'not an NPZ file'}") from None
        except (ValueError, AttributeError, EOFError, zipfile.BadZipFile):
            raise UnshutterError(f"cannot read trajectory {path}: not an NPZ file of numbers") from None
        try:
            return cls._from_samples(data)
        except UnshutterError as error:
            raise type(error)(f"trajectory {path}: {error}") from None

    @classmethod
    def load_steady(cls, path: str | os.PathLike[str]) -> RotationLog:
        """Reads a log; of motion capture, which has more jitter between samples than a hand, smoothed by 30 ms."""
        log = cls.load(path)
        return log.smoothed(_JITTER_S) if log.from_poses else log

    @classmethod
    def _from_samples(cls, data: dict[str, np.ndarray]) -> RotationLog:
        kind = next((key for key in ("gyro_rad_s", "quaternion_wxyz") if key in data), None)
        if "t_s" not in data or kind is None:
            raise UnshutterError("needs t_s and gyro_rad_s, or t_s and quaternion_wxyz")
        times, samples = data["t_s"], data[kind]
        if times.ndim != 1 or len(times) < 2 or samples.shape != (len(times), _SHAPES[kind]):
            raise UnshutterError(f"t_s has shape {times.shape} but {kind} has {samples.shape}")
        if not (np.isfinite(times).all() and np.isfinite(samples).all()):
            raise UnshutterError("contains values that are not finite numbers")
        times, samples = _in_order(times, samples)
        up, back = _GYRO_AXES
        if kind == "quaternion_wxyz":
            times, samples = _rates(times, samples)
            up, back = _POSE_AXES
        rates = (samples @ axis for axis in (up, back, np.cross(up, back)))
        return cls(times, *rates, from_poses=kind == "quaternion_wxyz")

    def draw_start(self, rng: np.random.Generator, duration_s: float) -> float:
        """Returns a random time after which the log has no gap for the duration; all such times are equally likely."""
        gaps = np.flatnonzero(np.diff(self.t_s) > _GAP * np.median(np.diff(self.t_s)))
        first = self.t_s[np.concatenate([[0], gaps + 1])]
        last = self.t_s[np.concatenate([gaps, [len(self.t_s) - 1]])]
        room = np.maximum(last - first - duration_s, 0.0)  # [stretches]
        if not room.any():
            raise UnshutterError(
                f"the trajectory is too short: {duration_s:.3g} s are needed, "
                f"its longest stretch without a gap has {(last - first).max():.3g} s"
            )
        ends = np.cumsum(room)
        at = rng.uniform(0, ends[-1])
        stretch = min(int(np.searchsorted(ends, at, side="right")), len(ends) - 1)
        return float(first[stretch] + at - (ends[stretch] - room[stretch]))

    def angles(self, at_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the angles about ``up`` and ``back`` [rad] since the log's start, at times within the log.

        The rate is linear between samples and integrated exactly. Each axis is integrated separately: within a readout
        the angles are small enough to be added.
        """
        rates = np.stack([self.yaw_rad_s, self.roll_rad_s], axis=1)
        angles = make_interp_spline(self.t_s, rates, k=1).antiderivative()(at_s)
        return angles[:, 0], angles[:, 1]

    def rotations(self, at_s: Float64[np.ndarray, "times"]) -> Float64[np.ndarray, "times 3 3"]:
        """Returns the picture's rotation R since the log's start, at times within the log.

        Signs as in motion/rotations.py. Exact for any angle: rotations between samples are multiplied, not added. The
        rate is constant from one sample to the next, at their mean.
        """
        rates, whole = self._turned
        before = np.clip(np.searchsorted(self.t_s, at_s, side="right") - 1, 0, len(self.t_s) - 2)
        since = rotation_matrix(rates[before] * (at_s - self.t_s[before])[:, None])
        return since @ whole[before]

    @cached_property
    def _turned(self) -> tuple[np.ndarray, np.ndarray]:
        """Rates of the scene between samples [N - 1, 3], and R at samples [N, 3, 3]."""
        rates = np.stack([-self.pitch_rad_s, self.yaw_rad_s, self.roll_rad_s], axis=-1)
        rates = (rates[:-1] + rates[1:]) / 2
        rotations = rotation_matrix(rates * np.diff(self.t_s)[:, None])
        return rates, np.array(list(accumulate(rotations, lambda turned, turn: turn @ turned, initial=np.eye(3))))

    def smoothed(self, sigma_s: float) -> RotationLog:
        """Returns the log with its rates smoothed by a Gaussian of this standard deviation."""
        sigma = sigma_s / float(np.median(np.diff(self.t_s)))  # samples
        rates = (
            gaussian_filter1d(rate, sigma, mode="nearest", radius=max(1, round(4 * sigma)))
            for rate in (self.yaw_rad_s, self.roll_rad_s, self.pitch_rad_s)
        )
        return RotationLog(self.t_s, *rates, from_poses=self.from_poses)


_SHAPES = {"t_s": 1, "gyro_rad_s": 3, "quaternion_wxyz": 4}


def _in_order(times: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sorts samples by time: phones deliver a few late or twice. Raises if more than a few are out of order."""
    if (np.diff(times) <= 0).mean() > _MOST_DISORDER:
        raise UnshutterError("the times t_s do not increase")
    times, order = np.unique(times, return_index=True)
    return times, samples[order]


def _rates(times: np.ndarray, quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angular rates [N - 1, 3] about the device's own axes, midway between orientations [N, 4] (wxyz)."""
    if (np.linalg.norm(quaternions, axis=1) < 0.5).any():
        raise UnshutterError("quaternion_wxyz contains rows that are not rotations")
    poses = Rotation.from_quat(quaternions, scalar_first=True)
    rotations = (poses[:-1].inv() * poses[1:]).as_rotvec()  # from one sample to the next, in the device's axes
    return (times[:-1] + times[1:]) / 2, rotations / np.diff(times)[:, None]
