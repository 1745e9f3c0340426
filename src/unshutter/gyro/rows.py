"""The turn of every row as the gyro tells it, and what is left for the pictures to tell."""

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
    """Turns of a clip's camera by its gyro log (frames/sequence.py asks for them as ``KnownTurns``).

    Attributes:
        log: the log.
        alignment: how it belongs to the clip.
    """

    log: GyroLog
    alignment: Alignment

    def focal_px(self, height: int) -> float:
        """Focal length of a frame with so many rows [px]."""
        return self.alignment.focal_px * height / ROWS

    def within_frame(self, begin_s: float, rows: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3"]:
        """Rotation vectors of a frame's rows since the first of them [rad] (geometry/rotations.py).

        Args:
            begin_s: time of the frame on the clip's clock [s].
            rows: which rows, as shares of the height.
        """
        return self.between((np.full(1, begin_s), rows[:1]), (np.full(len(rows), begin_s), rows))[1]

    def from_frame(self, begin_s: float, end_s: float, row: float) -> Float64[np.ndarray, "3"]:
        """Rotation vector [rad] of a row from one frame to another.

        Args:
            begin_s, end_s: times of the two frames on the clip's clock [s].
            row: which row, as a share of the height.
        """
        at = np.array([row])
        return self.between((np.array([begin_s]), at), (np.array([end_s]), at))[1][0]

    def without(self, tracks: Tracks, begin_s: float, end_s: float) -> Tracks:
        """Tracks from one frame to a later one as a camera would have seen them that did not turn.

        Args:
            tracks: as they are.
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
        """Turns of the scene, in the camera's axes, from rows of frames to rows of others.

        Args:
            begin, end: times of the frames on the clip's clock [s], and which rows, as shares of the height.

        Returns:
            [..., 3, 3] rotations, and [..., 3] their rotation vectors [rad].
        """
        times = [self.alignment.log_time(*each) for each in (begin, end)]
        before, after = (self.log.rotations(each) for each in times)
        turned = self.alignment.turned(after @ before.swapaxes(-1, -2), times[1] - times[0])
        return turned, rotation_vector(turned)
