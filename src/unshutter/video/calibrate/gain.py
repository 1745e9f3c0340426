"""What undoing a clip's motion gains, measured on tracks that have no part in the fit, if there are enough.

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

from unshutter.frames.camera import ROWS, padded_ends, rotation_jacobian
from unshutter.frames.frame_motion import AT_REST, FrameMotion
from unshutter.frames.parallax_grid import ParallaxGrid
from unshutter.frames.self_calibration import others, usual_focal
from unshutter.frames.tracks import Tracks
from unshutter.motion import Motion
from unshutter.motion.robust import student_weights_of_each, weighted_least_squares
from unshutter.motion.shapes import Bool, Float64
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

RUNS, RUN = 3, 40  # series of frames spread over a clip that are examined first, and frames of each
ALL = RUNS * RUN  # frames: of a clip that has no more, all are examined
_FAR = 1000.0  # frames, between series
_MIN_TRACKS = 12  # tracks of a pair of frames that counts
TALL = 1080  # px: displacements are judged in a picture whose short side has this many
_MIN_STEPS = 15  # pairs of frames, below which their steps say nothing
_MOVES_PX = 0.5  # speed of the picture [px of 1080 rows per frame], root mean square: below that, frames do not lean
_VISIBLE_PX = 0.5  # px of 1080 rows at most: a smaller displacement cannot be seen
_MOST_FRAMES = 90  # per cent of frames in which it is smaller,
_BRIEFLY_VISIBLE_PX = 2.0  # px: unless it is as large as this in one of the others
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

    @classmethod
    def of(cls, runs: Sequence[Sequence[FrameMotion]], undo: ClipUndo) -> Gain:
        """Measures the gain in some series of consecutive frames."""
        gain = cls(sum(map(len, runs)))
        pairs: list[_Pair] = []
        leans: list[tuple[int | None, Float64[np.ndarray, "2"]]] = []  # number of the pair that a frame ends; its lean
        for series, run in enumerate(runs):
            was = None
            for k, motion in enumerate(run):
                now = UndoneFrame.of(motion, undo)
                gain._count(motion, now)
                has_pair = was is not None and was.shot == motion.shot and motion.tracks is not None
                leans.append((len(pairs) if has_pair else None, now.lean))
                if was is not None and has_pair:
                    pairs.append(_Pair.of(was, now, motion, _FAR * series + k))
                was = now
        if pairs:
            gain._compare(pairs, leans)
        return gain

    def _count(self, motion: FrameMotion, undone: UndoneFrame) -> None:
        self.short_side = min(motion.height, motion.width)
        if motion.fit is not None:
            self.focal_px = motion.fit.focal_px * motion.height / ROWS
        if undone.reason is not None:
            self.reasons[undone.reason] += 1
        if undone.reason is None or undone.reason.code in AT_REST:
            self.displaced_px.append(float(np.abs(undone.grid).max()))

    def _compare(self, pairs: Sequence[_Pair], leans: Sequence[tuple[int | None, Float64[np.ndarray, "2"]]]) -> None:
        """Compares the tracks of all pairs before and after."""
        first = pairs[0].before
        self.steps.rows = min(first.height, first.width)
        before = PairMotion.of([pair.before for pair in pairs])
        after = PairMotion.of([pair.after for pair in pairs])
        for number, lean in leans:
            known = (None, None) if number is None else (before[number], after[number])
            self.steps.add(*known, lean)
        told = [pair for pair in pairs if pair.moves and len(pair.before) >= _MIN_TRACKS]
        if not told:
            return
        focals = np.array([pair.focal for pair in told])
        numbers = np.array([pair.number for pair in told]) if any(pair.has_depth for pair in told) else None
        left, used = _left([_checking(pair.before) for pair in told], focals, numbers)
        then, _ = _left([_checking(pair.after) for pair in told], focals, numbers)
        weights = student_weights_of_each((left + then) / 2, used)
        self.gains += (weights * (left - then)).sum(axis=1).tolist()
        unit = TALL / ROWS * first.height / min(first.height, first.width)
        sizes = [(_usual(a[use]), _usual(b[use])) for a, b, use in zip(left, then, used, strict=True)]
        self.wobble_px += [(unit * was, unit * now) for was, now in sizes]
        self.changes_px += [pair.change_px for pair in told]


@dataclass(frozen=True, eq=False)
class _Pair:
    """The tracks between two frames, before and after their motion is undone."""

    before: Tracks
    after: Tracks
    focal: float  # px of ROWS rows
    moves: bool  # whether the motion of either frame is undone
    change_px: tuple[float, float]  # change of the displacement, and largest displacement [px of 1080 rows]
    number: float  # of its later frame; far apart in different series
    has_depth: bool  # whether depth moves near and far apart, as in a walk

    @classmethod
    def of(cls, was: UndoneFrame, now: UndoneFrame, motion: FrameMotion, number: float) -> _Pair:
        tracks = motion.tracks
        assert tracks is not None
        undone = replace(tracks, start=was.seen(tracks.start, tracks), end=now.seen(tracks.end, tracks))
        focal = usual_focal(tracks) if motion.fit is None else motion.fit.focal_px
        largest = max(float(np.abs(each.grid).max()) for each in (was, now))
        change = float(np.abs(now.grid - was.grid).max())
        moves = was.reason is None or now.reason is None
        has_depth = motion.fit is not None and motion.fit.parallax is not None
        return cls(tracks, undone, focal, moves, (change, largest), number, has_depth)


def _checking(tracks: Tracks) -> Tracks:
    """Returns the tracks that had no part in the fit, or all if these are too few."""
    apart = others(tracks)
    return apart if len(apart) >= _MIN_TRACKS else tracks


def _usual(squared: Float64[np.ndarray, "tracks"]) -> float:
    """Returns the root mean square of 90 % of the tracks, those that fit best."""
    return float(np.sort(squared)[: max(1, int(0.9 * len(squared)))].mean()) ** 0.5


def is_tested(options: RectifyClip) -> bool:
    """Whether the gain decides on a clip, if the user does not state its readout time."""
    return options.undo.model == "camera" and 0 < options.undo.strength <= 1


def is_visible(displaced_px: Sequence[float] | Float64[np.ndarray, "frames"]) -> bool:
    """Whether anyone can see a displacement of this size [px, of at most 1080 rows]."""
    most = np.percentile(displaced_px, _MOST_FRAMES)
    return bool(most >= _VISIBLE_PX or np.max(displaced_px) >= _BRIEFLY_VISIBLE_PX)


def expected(request: ClipRequest, sampled: int, all_frames: float) -> dict[Stage, int]:
    """Returns how many items of its stages it takes to judge a clip; none if that is not done.

    Args:
        sampled: number of frames whose motion is found first.
        all_frames: number of frames of the clip, times how likely that of all of them is found afterwards.
    """
    is_judged = is_tested(request.options) and not request.options.shutter.states_time
    further = round(all_frames) if request.frames > ALL else 0
    return {Stage.JUDGE: SOLVED * sampled * is_judged, Stage.JUDGE_ALL: SOLVED * further * is_judged}


def motions_of_parts(
    request: ClipRequest,
    time: ReadoutTime,
    gyro_rotations: GyroRotations | None,
    parts: Sequence[Sequence[TrackedFrame]],
    stage: Stage = Stage.JUDGE,
) -> list[list[FrameMotion]]:
    """Returns the motions of the frames of some parts, each as it is in a clip of its own."""
    frames = sum(map(len, parts))
    window = window_for(request.clip.frame_bytes)
    request.work.expect({Stage.SURVEY: 0, stage: SOLVED * frames})
    steps = Steps(request.work, "judging", frames)
    found: list[list[FrameMotion]] = []
    done = 0
    focal_px = None
    for part in parts:
        finder = camera_motion(request, time, gyro_rotations, focal_px, stage)
        found.append([])
        for motion in finder.motions(tracked_copies(request, part)):
            found[-1].append(motion)
            done += 1
            steps.advance()
            request.work.expect_as_before(stage, done + window.core + window.ahead, frames - done)
            focal_px = focal_px if motion.fit is None else motion.fit.focal_px * motion.height / ROWS
    request.work.expect({stage: 0})
    return found


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


def _left(
    pairs: Sequence[Tracks], focals: Float64[np.ndarray, "pairs"], numbers: Float64[np.ndarray, "pairs"] | None
) -> tuple[Float64[np.ndarray, "pairs most"], Bool[np.ndarray, "pairs most"]]:
    """Returns what the camera's rotation and a change of scale leave of tracks; and which entries hold a track.

    Args:
        focals: focal length of each pair [px of ROWS rows].
        numbers: of the pairs' frames, if depth adds velocities, which do not count as wobble; None: it does not.

    Returns:
        Squared distances [px of ROWS rows, squared].
    """
    first = pairs[0]
    ends, used = padded_ends(pairs)
    ends *= ROWS / first.height
    width = first.width * ROWS / first.height
    jacobian = rotation_jacobian(ends.mean(axis=0), width, focals[:, None, None], first.lens)
    jacobian = jacobian.reshape(len(pairs), -1, 4)
    moved = ends[1] - ends[0]
    left = moved
    for _ in range(4):
        weights = np.repeat(student_weights_of_each(np.square(left).sum(axis=-1), used), 2, axis=-1)
        unknowns = weighted_least_squares(jacobian, moved.reshape(len(pairs), -1), weights)
        left = moved - (jacobian @ unknowns[..., None]).reshape(moved.shape)
    if numbers is not None:
        weights = student_weights_of_each(np.square(left).sum(axis=-1), used)
        grid = ParallaxGrid.of(ends.mean(axis=0), (ROWS, width), numbers)
        once = np.ones(used.shape)
        share = weights / np.maximum(weights.max(axis=1, keepdims=True), 1e-9)
        left = left - grid.displaced(grid.velocities(left, once, share), once)
    return np.square(left).sum(axis=-1), used
