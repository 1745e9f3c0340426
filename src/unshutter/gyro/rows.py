"""Computes the turn of every row from a gyro log, and removes it from tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from unshutter.frames.camera import ROWS
from unshutter.frames.tracks import Tracks
from unshutter.geometry.rotations import rotation_vector
from unshutter.gyro.alignment import Alignment
from unshutter.gyro.log import GyroLog

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64


@dataclass(frozen=True, eq=False)
class GyroTurns:
    """Turns of a clip's camera from its gyro log (``KnownTurns`` for frames/sequence.py).

    Attributes:
        log: the log.
        alignment: alignment of the log with the clip.
    """

    log: GyroLog
    alignment: Alignment

    def focal_px(self, height: int) -> float:
        """Returns the focal length for frames with this number of rows [px]."""
        return self.alignment.focal_px * height / ROWS

    def within_frame(self, begin_s: float, rows: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3"]:
        """Returns rotation vectors of a frame's rows since the first of them [rad] (geometry/rotations.py).

        Args:
            begin_s: time of the frame on the clip's clock [s].
            rows: rows as fractions of the height.
        """
        return self.between((np.full(1, begin_s), rows[:1]), (np.full(len(rows), begin_s), rows))[1]

    def from_frame(self, begin_s: float, end_s: float, row: float) -> Float64[np.ndarray, "3"]:
        """Returns the rotation vector [rad] of a row from one frame to another.

        Args:
            begin_s, end_s: times of the two frames on the clip's clock [s].
            row: row as a fraction of the height.
        """
        at = np.array([row])
        return self.between((np.array([begin_s]), at), (np.array([end_s]), at))[1][0]

    def without(self, tracks: Tracks, begin_s: float, end_s: float) -> Tracks:
        """Returns tracks as seen by a camera that did not turn between the two frames.

        Args:
            tracks: tracks from one frame to a later one.
            begin_s, end_s: times of the two frames on the clip's clock [s].
        """
        if not len(tracks):
            return tracks
        unit, focal_px = ROWS / tracks.height, self.alignment.focal_px
        middle = np.array([tracks.width, tracks.height]) / 2 - 0.5
        rows = [np.clip((at[:, 1] + 0.5) / tracks.height, 0, 1) for at in (tracks.start, tracks.end)]
        turned, _ = self.between((np.full(len(tracks), begin_s), rows[0]), (np.full(len(tracks), end_s), rows[1]))
        rays = np.concatenate([(tracks.start - middle) * unit / focal_px, np.ones((len(tracks), 1))], axis=-1)
        seen = np.einsum("nij,nj->ni", turned, rays)
        predicted = seen[:, :2] / seen[:, 2:] * focal_px / unit + middle
        return replace(tracks, end=tracks.start + (tracks.end - predicted))

    def between(
        self, begin: tuple[np.ndarray, np.ndarray], end: tuple[np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Computes turns of the scene, in the camera's axes, from rows of frames to rows of other frames.

        Args:
            begin, end: times of the frames on the clip's clock [s], and rows as fractions of the height.

        Returns:
            [..., 3, 3] rotations, and [..., 3] their rotation vectors [rad].
        """
        times = [self.alignment.log_time(*each) for each in (begin, end)]
        before, after = (self.log.rotations(each) for each in times)
        turned = self.alignment.turned(after @ before.swapaxes(-1, -2), times[1] - times[0])
        return turned, rotation_vector(turned)
