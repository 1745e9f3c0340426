"""The clock of a sequence of frames, and the motion of one frame: within it, and since the previous frame.

Time is counted in frame intervals. The readout ratio is the readout time of one frame divided by the frame interval:
row y of frame k, of H rows, is exposed at k + ratio * y / H. Frames are those of the readout frame: row 0 is read
first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.camera import ROWS, Fit, rotation_between, rotation_jacobian
from unshutter.frames.self_calibration import usual_focal
from unshutter.frames.tracks import MIN_TRACKS, Tracks
from unshutter.motion import RotationMotion, RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.lens import Lens
from unshutter.motion.motion import row_index
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.motion.shapes import Float64
from unshutter.options import Reference, check_ratio
from unshutter.orientation import ScanDirection
from unshutter.reasons import Code, MotionSource, Reason

READOUT_FRACTION = {"first": 0.0, "middle": 0.5, "last": 1.0}


@dataclass(frozen=True)
class Timing:
    """The clock of a sequence of frames.

    Raises:
        UsageError: the readout ratio is out of range.
    """

    readout_ratio: float  # readout time / frame interval, above 0 and at most 1
    height: int  # rows of a frame, or of the smaller copy whose rows are counted
    # position of row 0 of that copy relative to the frame's first row, in rows of the copy; 0 for the frame itself
    first_row: float = 0.0

    def __post_init__(self) -> None:
        check_ratio(self.readout_ratio)

    @property
    def per_row(self) -> float:
        """Time from one row to the next."""
        return self.readout_ratio / self.height

    def start(self, frame: float) -> float:
        """Returns the time at which row 0 of a frame is exposed."""
        return frame + self.per_row * self.first_row

    def exposed(self, frame: float, row: np.ndarray) -> np.ndarray:
        """Returns the times at which rows of a frame are exposed."""
        return self.start(frame) + self.per_row * row

    def moment(self, reference: Reference, frame: float = 0) -> float:
        """Returns the time of a frame's first, middle or last row."""
        return frame + self.readout_ratio * READOUT_FRACTION[reference]

    def of_copy(self, height: int) -> Timing:
        """Returns the clock of a copy of the frames with this number of rows."""
        return replace(self, height=height, first_row=0.5 - 0.5 * height / self.height)


NAME = "frames-camera"
_MOST_PX = 8.0  # px of ROWS rows: most that depth may displace a place during a readout
AT_REST = (Code.STOOD_STILL, Code.HARDLY_MOVED, Code.ONLY_OTHERS_MOVED)


class KnownRotations(Protocol):
    """The camera's rotation known from a source other than the frames: a gyro. Times are on the clip's clock."""

    def within_frame(self, begin_s: float, rows: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3"]:
        """Rotation vectors [rad] of a frame's rows, given as shares of its height, relative to its first row."""
        ...

    def without(self, tracks: Tracks, begin_s: float, end_s: float) -> Tracks:
        """Returns the tracks between two frames as seen by a camera that did not rotate."""
        ...

    def from_frame(self, begin_s: float, end_s: float, row: float) -> Float64[np.ndarray, "3"]:
        """Rotation vector [rad] of a row, given as a share of the height, from one frame to another."""
        ...


@dataclass(frozen=True, eq=False)
class Step:
    """The camera's rotation from one frame to the next, between their middle rows."""

    rotation: Float64[np.ndarray, "3"]  # [3] rotation vector [rad] (motion/rotations.py)
    focal_heights: float  # focal length used, in heights of the readout frame; NaN if the camera stood still


@dataclass(frozen=True)
class FrameMotion:
    """The motion of one frame, or the reason why it has none; rows are computed only on request."""

    height: int
    width: int
    scan_direction: ScanDirection  # direction in which its stored pixels were read
    fit: Fit | None = None  # the camera's motion around that time; None if unknown
    at: float = 0.0  # time of the frame in that fit [frame intervals]
    ratio: float = 0.0  # readout time in frame intervals
    reason: Reason | None = None  # why there is no motion to undo; None if there is one
    shot: int = 0  # number of its shot, a series of frames connected by motion
    scene: int = 0  # number of the scene that it shows
    # the camera's rotation measured by a gyro, if available; ``fit`` is then the remaining rotation
    rotations: KnownRotations | None = None
    time_s: float = 0.0  # time of the frame on the clip's clock [s]
    after: float = 1.0  # time since the previous frame [frame intervals]; 0 for a copy of it
    tracks: Tracks | None = None  # from the previous frame, if the whole path is requested; otherwise None
    focal: float | None = None  # focal length [px of ROWS rows], if known without a fit
    lens: Lens | None = None  # the camera's lens, if it bends straight lines

    @property
    def stood_still(self) -> bool:
        """Whether the camera stood still, or nearly so, and nothing moved in front of it."""
        return self.reason is not None and self.reason.code in (Code.STOOD_STILL, Code.HARDLY_MOVED)

    @property
    def ratio_unknown(self) -> bool:
        """Whether there is no motion because the readout ratio is unknown."""
        return self.reason is not None and self.reason.code is Code.RATIO_UNKNOWN

    def finding(self, reference: Reference = "first") -> Finding:
        """Returns the frame's motion; zero, with the reason, if none was found."""
        if self.fit is None or self.reason is not None:
            return self._none(self.reason)
        rows = (np.arange(self.height) + 0.5) / self.height
        rotation = self.fit.rotation(self.at + self.ratio * rows)
        rotations = rotation - rotation[0]
        if self.rotations is not None:  # within a frame, both are small enough to be added
            rotations = rotations + self.rotations.within_frame(self.time_s, rows)
        reach = np.abs(rotations).max(axis=0) * [self.fit.focal_px, self.fit.focal_px, ROWS / 2]
        if reach.max() < 0.1:  # px of ROWS rows
            return self._none(Reason(Code.HARDLY_MOVED))
        focal = self.fit.focal_px * self.height / ROWS
        parallax = None
        if self.fit.parallax is not None:
            moved = self.ratio * self.fit.parallax.at(self.at)
            parallax = np.clip(moved, -_MOST_PX, _MOST_PX) * self.height / ROWS
        try:
            motion = RotationMotion(
                self.width, rotations, focal, self.lens, parallax, scan_direction=self.scan_direction
            )
            motion.check_unfolded()
        except UnshutterError as error:
            return self._none(Reason.of(Code.IMPOSSIBLE_MOTION, detail=str(error)))
        return Finding(motion.rereferenced(reference), estimator=NAME, source=MotionSource.NEIGHBOURS)

    def as_seen_from(self, neighbour: int, reference: Reference) -> RotationMotion:
        """Returns the motion that takes a neighbour's rows to the moment of a row of this frame; needs a fit.

        Args:
            neighbour: -1 for the frame before, 1 for the frame after.

        Raises:
            UnshutterError: the camera turned too far, or too fast.
        """
        assert self.fit is not None
        rows = (np.arange(self.height) + 0.5) / self.height
        interval = self.after or 1.0 if neighbour < 0 else 1.0
        first, moment = self.rotation_between(self.ratio * rows[[0, row_index(reference, self.height)]])
        rotation = rotation_matrix(self.rotation_between(neighbour * interval + self.ratio * rows) - first)
        rotations = rotation_vector(rotation @ rotation_matrix(moment - first).T)
        focal = self.fit.focal_px * self.height / ROWS
        return RotationMotion(
            self.width, rotations, focal, self.lens, scan_direction=self.scan_direction, reference=reference
        )

    def rotation_between(self, after: Float64[np.ndarray, "*times"]) -> Float64[np.ndarray, "*times 3"]:
        """Returns the camera's rotation [rad] at times after the frame's first row [frame intervals]; needs a fit."""
        assert self.fit is not None
        return self.fit.rotation(self.at + after)

    def step_from(self, before: FrameMotion | None) -> Step | None:
        """Returns the camera's rotation since the previous frame; None if it is unknown."""
        if before is None or before.scene != self.scene:
            return None
        joined = before.shot == self.shot
        if joined and self.after == 0:
            return Step(np.zeros(3), np.nan)
        if self.rotations is None and (not joined or self.fit is None):
            if joined and self.reason is not None and self.reason.code in AT_REST:
                return Step(np.zeros(3), np.nan)
            if self.tracks is None or len(self.tracks) < MIN_TRACKS:
                return None
            focal = self.focal or usual_focal(self.tracks)  # ignores the readout time
            return Step(rotation_between(self.tracks, focal), focal / ROWS)
        if self.fit is None:
            return None
        rotation = np.zeros(3)
        if joined:
            at = self.at + self.ratio / 2
            earlier, later = self.fit.rotation(np.array([at - self.after, at]))
            rotation = later - earlier
        if self.rotations is None and self.tracks is not None and len(self.tracks) >= MIN_TRACKS:
            rotation = rotation + rotation_between(self._left_of(self.tracks, self.fit), self.fit.focal_px)
        if self.rotations is not None:
            rotation = rotation + self.rotations.from_frame(before.time_s, self.time_s, 0.5)
        return Step(rotation, self.fit.focal_px / ROWS)

    def _left_of(self, tracks: Tracks, fit: Fit) -> Tracks:
        """Returns the tracks from the previous frame minus the fit, which is smooth in time and may miss a jerk."""
        unit = ROWS / tracks.height
        begin, end = (np.clip((at[:, 1] + 0.5) / tracks.height, 0, 1) for at in (tracks.start, tracks.end))
        rotated = fit.rotation(self.at + self.ratio * end) - fit.rotation(self.at - self.after + self.ratio * begin)
        middles = ((tracks.start + tracks.end) / 2 + 0.5) * unit
        jacobian = rotation_jacobian(middles, tracks.width * unit, fit.focal_px, self.lens)[..., :3]
        moved = np.einsum("nij,nj->ni", jacobian, rotated * fit.focal_px) / unit
        return replace(tracks, end=tracks.end - moved)

    def _none(self, reason: Reason | None) -> Finding:
        motion = RowMotion.zero(self.height, self.width, scan_direction=self.scan_direction)
        return Finding(motion, estimator=NAME, source=MotionSource.NEIGHBOURS, reason=reason)
