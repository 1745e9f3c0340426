"""What undoing a clip's motion gains, measured on tracks that are held out of the fit.

A global shutter's tracks between two frames follow the camera's rotation and a change of scale; what is left is wobble.
Undoing the motion moves both ends of each track. If it moved as estimated, less is left. If it moved evenly, all frames
are sheared alike, which no two of them show.

That alone falls with any readout time, even with one of the wrong sign, since a path can imitate any motion that
depends on the row. Two things cannot be imitated. A frame leans by half the readout ratio times the camera's speed. And
what is skewed and stretched from frame to frame, apart from what depth adds, is the wobble that people see: its largest
steps must not grow, and none may appear where there were none.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from unshutter.frames.camera import ROWS, track_jacobian
from unshutter.frames.frame_motion import AT_REST, FrameMotion
from unshutter.frames.self_calibration import usual_focal
from unshutter.frames.tracks import Tracks
from unshutter.motion import Motion
from unshutter.motion.robust import student_weights, weighted_least_squares
from unshutter.motion.shapes import Float64
from unshutter.motion.verdict import undone_part
from unshutter.options.clip_options import ClipUndo, RectifyClip
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate.motion_estimation import camera_motion, small_finding, window_for
from unshutter.video.calibrate.readout_regression import PairMotion, fit_robustly
from unshutter.video.calibrate.sampled_frames import TrackedFrame, tracked_copies
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.stages import Stage, Steps
from unshutter.video.gyro.synchronisation import GyroRotations

_HELD_OUT = 4  # every fourth track
RUNS, RUN = 3, 40  # series of frames spread over a clip that are examined first, and frames of each
ALL = RUNS * RUN  # frames: of a clip that has no more, all are examined
_MIN_TRACKS = 12  # tracks of a pair of frames that counts
TALL = 1080  # px: displacements are judged in a picture whose short side has this many
_MIN_STEPS = 15  # pairs of frames, below which their steps say nothing
_MOVES_PX = 0.5  # speed of the picture [px of 1080 rows per frame], root mean square: below that, frames do not lean
SOLVED = 11  # how often a pair of frames is part of a fit, usually


@dataclass(frozen=True)
class StepSizes:
    """How much frames are skewed and stretched against the previous ones, apart from what depth adds [px]."""

    rms: float  # root mean square, at the top and bottom rows
    usual: float  # 95th percentile
    largest: float

    @classmethod
    def of(cls, shapes: Float64[np.ndarray, "pairs 2"], speeds: Float64[np.ndarray, "pairs 2"]) -> StepSizes:
        """Returns the sizes for skew and stretch of each pair of frames, and the picture's speed."""
        own = np.concatenate([np.ones((len(speeds), 1)), speeds], axis=1)
        left = np.stack([fit_robustly(shape, own)[2] for shape in shapes.T], axis=1)
        sizes = np.hypot(*left.T)
        return cls(float(np.sqrt(2 * np.mean(left**2))), float(np.percentile(sizes, 95)), float(sizes.max()))

    @property
    def figures(self) -> tuple[float, float, float]:
        """All sizes, in the order in which people see them."""
        return self.rms, self.largest, self.usual


@dataclass(eq=False)
class FrameSteps:
    """Consecutive frames, before and after their motion is undone."""

    rows: int = 1080  # of the copies in which tracks were found; pixels are theirs
    _pairs: list[tuple[PairMotion, PairMotion] | None] = field(default_factory=list)  # before and after
    _leans: list[Float64[np.ndarray, "2"]] = field(default_factory=list)

    def add(self, before: PairMotion | None, after: PairMotion | None, lean: Float64[np.ndarray, "2"]) -> None:
        """Adds a frame.

        Args:
            before: motion of the picture since the previous frame; None if it is unknown, or there is none.
            after: the same, with the motion undone.
            lean: displacement of the frame's last row against its middle (across, down) that is undone [heights of
                the frame].
        """
        self._pairs.append(None if before is None or after is None else (before, after))
        self._leans.append(lean)

    @property
    def sizes(self) -> tuple[StepSizes, StepSizes] | None:
        """Sizes of the steps before and after; None if there are too few."""
        known = [pair for pair in self._pairs if pair is not None]
        if len(known) < _MIN_STEPS:
            return None
        speeds = np.array([before.shift for before, _ in known])
        before, after = (StepSizes.of(np.array([pair[k].shape for pair in known]), speeds) for k in range(2))
        return before, after

    @property
    def follow(self) -> float:
        """Correlation of the frames' lean with the picture's speed, about their means' size; NaN if nothing moved."""
        leans = []
        speeds = []
        for k in range(len(self._pairs) - 1):
            here = self._pairs[k]
            following = self._pairs[k + 1]
            if here is not None and following is not None:
                leans.append(self._leans[k])
                speeds.append((here[0].shift + following[0].shift) / 2)
        if len(leans) < _MIN_STEPS:
            return np.nan
        lean = np.array(leans)
        speed = np.array(speeds)
        size = float(np.sqrt((lean**2).sum() * (speed**2).sum()))
        moves = float(np.sqrt((speed**2).sum(axis=1).mean())) > _MOVES_PX * self.rows / 1080
        return float((lean * speed).sum()) / size if size > 0 and moves else np.nan


@dataclass(eq=False)
class Gain:
    """What undoing the motion changes in the examined frames."""

    frames: int = 0  # number of examined frames
    short_side: int = TALL  # of the frames [px]
    # largest displacement in each frame whose motion is known, 0 if the camera stood still [px, of 1080 rows at most]
    displaced_px: list[float] = field(default_factory=list)
    reasons: Counter[Reason] = field(default_factory=Counter)  # why frames have no motion to undo, with counts
    # [pairs] of frames whose motion is undone: by how much the sum of squares that is left of the tracks falls, in
    # units of their variance
    gains: list[float] = field(default_factory=list)
    # [pairs] what the camera's rotation and a change of scale leave, before and after: RMS of 90 % of the tracks [px of
    # 1080 rows]
    wobble_px: list[tuple[float, float]] = field(default_factory=list)
    steps: FrameSteps = field(default_factory=FrameSteps)  # how the frames follow each other
    focal_px: float | None = None  # focal length that was found [px of the frames]
    # [pairs] change of the displacement between the two frames, and largest displacement [px of 1080 rows]
    changes_px: list[tuple[float, float]] = field(default_factory=list)

    @property
    def gain(self) -> tuple[float, float]:
        """Median gain of the pairs, and its standard deviation, from their scatter."""
        middle = float(np.median(self.gains))
        scatter = 1.4826 * float(np.median(np.abs(np.array(self.gains) - middle)))
        return middle, 1.2533 * scatter / len(self.gains) ** 0.5

    def add(self, was: UndoneFrame | None, motion: FrameMotion, undo: ClipUndo) -> UndoneFrame:
        """Adds a frame, and the pair of frames that it forms with the previous one; returns it, for the next call."""
        now = UndoneFrame.of(motion, undo)
        self.frames += 1
        self.short_side = min(motion.height, motion.width)
        if now.reason is not None:
            self.reasons[now.reason] += 1
        if now.reason is None or now.reason.code in AT_REST:
            self.displaced_px.append(float(np.abs(now.grid).max()))
        if was is None or was.shot != motion.shot or motion.tracks is None:
            self.steps.add(None, None, now.lean)
            return now
        tracks = motion.tracks
        undone = replace(tracks, start=was.seen(tracks.start, tracks), end=now.seen(tracks.end, tracks))
        self.steps.rows = min(tracks.height, tracks.width)
        wobbling, steady = PairMotion.of([tracks, undone])
        self.steps.add(wobbling, steady, now.lean)
        tracks, undone = (each.split(_HELD_OUT)[1] for each in (tracks, undone))
        if len(tracks) < _MIN_TRACKS or (now.reason and was.reason):
            return now
        focal = usual_focal(tracks) if motion.fit is None else motion.fit.focal_px
        left, after = (np.square(_left(each, focal)).sum(axis=1) for each in (tracks, undone))
        self.gains.append(float(_weights((left + after) / 2) @ (left - after)))
        unit = TALL / ROWS * tracks.height / min(tracks.height, tracks.width)
        self.wobble_px.append((unit * _usual(left), unit * _usual(after)))
        largest = max(float(np.abs(each.grid).max()) for each in (was, now))
        self.changes_px.append((float(np.abs(now.grid - was.grid).max()), largest))
        return now


def _usual(squared: Float64[np.ndarray, "tracks"]) -> float:
    """Returns the root mean square of 90 % of the tracks, those that fit best."""
    return float(np.sort(squared)[: max(1, int(0.9 * len(squared)))].mean()) ** 0.5


def is_tested(options: RectifyClip) -> bool:
    """Whether the gain decides on a clip, if the user does not state its readout time."""
    return options.undo.model == "camera" and 0 < options.undo.strength <= 1


def expected(request: ClipRequest, sampled: int, all_frames: float) -> dict[Stage, int]:
    """Returns how many items of its stages it takes to judge a clip; none if that is not done.

    Args:
        sampled: number of frames that are judged first, unless they are more than enough.
        all_frames: number of frames of the clip, times how likely all of them are asked.
    """
    is_judged = is_tested(request.options) and not request.options.shutter.states_time
    first = min(sampled, ALL) if is_judged else 0
    further = round(all_frames) if is_judged and request.frames > ALL else 0
    return {Stage.JUDGE: SOLVED * first, Stage.JUDGE_ALL: SOLVED * further}


def gain_of_parts(
    request: ClipRequest,
    time: ReadoutTime,
    gyro_rotations: GyroRotations | None,
    parts: Sequence[Sequence[TrackedFrame]],
    stage: Stage = Stage.JUDGE,
) -> Gain:
    """Measures what undoing the motion gains in parts of a clip, each of which is estimated as a clip of its own is."""
    gain = Gain()
    frames = sum(map(len, parts))
    window = window_for(request.clip.frame_bytes)
    request.work.expect({Stage.SURVEY: 0, stage: SOLVED * frames})
    steps = Steps(request.work, "judging", frames)
    for part in parts:
        before = None
        finder = camera_motion(request, time, gyro_rotations, _HELD_OUT, gain.focal_px, stage)
        for motion in finder.motions(tracked_copies(request, part)):
            before = gain.add(before, motion, request.options.undo)
            steps.advance()
            request.work.expect_as_before(stage, gain.frames + window.core + window.ahead, frames - gain.frames)
            if motion.fit is not None:
                gain.focal_px = motion.fit.focal_px * motion.height / ROWS
    request.work.expect({stage: 0})
    return gain


@dataclass(frozen=True, eq=False)
class UndoneFrame:
    """A frame whose motion is undone."""

    motion: Motion  # of a small picture: the part that is undone
    reason: Reason | None  # why there is no motion to undo; None if there is
    grid: Float64[np.ndarray, "points 2"]  # displacements of points spread over the frame [px, of 1080 rows at most]
    shot: int = 0  # number of the shot to which it belongs

    @classmethod
    def of(cls, motion: FrameMotion, undo: ClipUndo) -> UndoneFrame:
        """Undoes the motion of a frame."""
        found = small_finding(motion)
        size = (motion.height, motion.width)
        small = found.motion
        undone = undone_part(small, undo)
        ends = small.width - 1, small.height - 1
        col, row = (each.ravel() for each in np.meshgrid(*(np.linspace(0, end, 5) for end in ends)))
        seen = (col, row) if small.is_zero else undone.rs_to_gs(col, row)
        grid = np.stack(seen, axis=-1) - np.stack([col, row], axis=-1)
        reason = (found.reason or Reason(Code.NO_MOTION)) if small.is_zero else None
        return cls(undone, reason, np.nan_to_num(grid) * min(TALL, *size) / min(small.height, small.width), motion.shot)

    @property
    def lean(self) -> Float64[np.ndarray, "2"]:
        """How far the last row was displaced against the first, half of it (across, down) [heights of the frame]."""
        if self.reason is not None:
            return np.zeros(2)
        middle = (self.motion.width - 1) / 2
        ends = np.array([[middle, 0.0], [middle, self.motion.height - 1.0]])
        moved = np.stack(self.motion.rs_to_gs(*ends.T), axis=-1) - ends
        return (moved[0] - moved[1]) / 2 / self.motion.height

    def seen(self, points: Float64[np.ndarray, "tracks 2"], tracks: Tracks) -> Float64[np.ndarray, "tracks 2"]:
        """Returns where points of the tracked copy lie once the motion is undone."""
        if self.reason is not None:
            return points
        scale = np.array([self.motion.width / tracks.width, self.motion.height / tracks.height])
        return (np.stack(self.motion.rs_to_gs(*((points + 0.5) * scale - 0.5).T), axis=-1) + 0.5) / scale - 0.5


def _left(tracks: Tracks, focal_px: float) -> Float64[np.ndarray, "tracks 2"]:
    """Returns what the camera's rotation and a change of scale leave of the tracks [px of ROWS rows]."""
    jacobian, moved = track_jacobian(tracks, focal_px)
    left = moved
    for _ in range(4):
        weights = np.repeat(_weights(np.square(left).sum(axis=1)), 2)
        left = moved - jacobian @ weighted_least_squares(jacobian.reshape(-1, 4), moved.ravel(), weights)
    return left


def _weights(squared: Float64[np.ndarray, "tracks"]) -> Float64[np.ndarray, "tracks"]:
    return student_weights(squared[None], np.ones((1, len(squared)), bool), np.nan)[0][0]
