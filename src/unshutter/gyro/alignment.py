"""Alignment of a gyro log with a clip: the axes of the sensor, its clock, the focal length and the readout ratio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unshutter.frames.tracks import Tracks
from unshutter.geometry.rotations import rotation_matrix

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64


@dataclass(frozen=True, eq=False)
class Pair:
    """Tracks from one frame to a later one, and the times of both frames.

    Attributes:
        tracks: tracks of the background.
        begin_s, end_s: times of the two frames on the clip's clock [s].
    """

    tracks: Tracks
    begin_s: float
    end_s: float


@dataclass(frozen=True, eq=False)
class Alignment:
    """Alignment of a log with a clip.

    Attributes:
        axes: [3, 3] rotation from the device's axes to the camera's (right, down, forward).
        offset_s: time of the log minus that of the clip, at ``at_s`` of the clip, for the middle row of a frame [s].
        drift: rate at which the offset grows [s per s].
        at_s: middle of the compared part of the clip [s].
        bias: [3] rate that the log shows at rest, in the camera's axes [rad/s].
        focal_px: focal length [px of ROWS rows].
        ratio: readout time in frame intervals.
        interval_s: usual time from one frame to the next [s].
    """

    axes: np.ndarray
    offset_s: float
    drift: float
    at_s: float
    bias: np.ndarray
    focal_px: float
    ratio: float
    interval_s: float

    def log_time(self, frame_s: Float64[np.ndarray, "*at"], row: Float64[np.ndarray, "*at"]) -> np.ndarray:
        """Returns the times at which rows were exposed, on the log's clock [s].

        Args:
            frame_s: times of frames on the clip's clock [s].
            row: row as a fraction of the height: 0 is the top edge of the first one, 1 the bottom edge of the last one.
        """
        since = frame_s - self.at_s
        return frame_s + self.offset_s + self.drift * since + self.ratio * self.interval_s * (row - 0.5)

    def turned(self, device: Float64[np.ndarray, "*at 3 3"], lasted_s: Float64[np.ndarray, "*at"]) -> np.ndarray:
        """Converts turns in the device's axes to turns [..., 3, 3] in the camera's axes, without the log's bias.

        Args:
            device: turns of the scene in the device's axes.
            lasted_s: their durations [s].
        """
        rest = rotation_matrix(self.bias * np.asarray(lasted_s)[..., None])
        return rest @ (self.axes @ device @ self.axes.T)
