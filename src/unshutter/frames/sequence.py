"""Estimates the motion of each frame of a sequence, given in the order in which the frames were taken."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Unpack

import numpy as np

from unshutter.errors import UnknownRatioError, UsageError
from unshutter.estimators.base import View
from unshutter.frames.angles import SURE_ENOUGH, PhotoSpeed, combined, ratio_from_angles, speed_of
from unshutter.frames.camera import ROWS, Fit, Problem, steady
from unshutter.frames.frame_motion import FrameMotion, KnownTurns
from unshutter.frames.self_calibration import ReadoutRatio, fewer, focal_from_motion, ratio_from_motion, usual_focal
from unshutter.frames.shots import GreyFrame, Shot
from unshutter.frames.tracks import TRACKED_SIDE
from unshutter.geometry.readout import Readout
from unshutter.motion import Motion
from unshutter.options import Camera, Clock, ClockKeywords, Reference, Undo
from unshutter.options.description import from_keywords, takes_options
from unshutter.photo import Photo
from unshutter.photo.argument import open_photo
from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    pass

_CORE, _MARGIN = 24, 6  # frames of a window whose motion is kept, and extra frames on both sides for stability
SEARCHED = 60  # frames from which the readout ratio is estimated
_PATIENCE = 240  # frames after which the search ends
_STIFFNESS_EVERY = 4  # windows
_TOO_NOISY_PX = 2.0  # px of ROWS rows: above this, no camera rotation explains the tracks
_FEW_PAIRS, _EVEN = 2, 100.0  # below this many pairs the speed is kept even, by this stiffness
_LEAST_TRACKS = 12  # fewest for a speed
_GUESSED_RATIO = 0.5  # assumed when estimating the focal length
_PATH_ONLY = (Code.HARDLY_MOVED, Code.SHOT_TOO_SHORT)  # reasons that still allow estimating the camera's path
_FRAME = str | os.PathLike[str] | bytes | np.ndarray | Photo


@dataclass(eq=False)
class CameraMotion:
    """Estimates the motion of each frame of a sequence from one camera, remembering what it learns about the camera.

    Attributes:
        ratio: readout time in frame intervals; None to estimate it from the frames.
        focal_px: focal length [px of the frames]; None to use EXIF's, or estimate it from the frames.
        readout: direction in which stored pixels were read.
        every_angle: right angles are evaluated in one of this many photos if motion does not reveal the ratio.
        fewest: shots with fewer frames are left unchanged.
        window: number of frames whose motion is found together, and of extra frames on both sides for stability.
        turns: the camera's rotation measured by a gyro, if available; the frames then give the remaining rotation.
        whole_path: whether the camera's rotation is estimated even if it is too small, or the shot too short, to be
            corrected.
    """

    ratio: ReadoutRatio | None = None
    focal_px: float | None = None
    readout: Readout = Readout.TOP_TO_BOTTOM
    every_angle: int = 6
    window: tuple[int, int] = (_CORE, _MARGIN)
    fewest: int = 2
    turns: KnownTurns | None = None
    whole_path: bool = False
    _photos: int = field(default=0, init=False)
    _focal: float | None = field(default=None, init=False)  # px of ROWS rows
    _stiffness: float | None = field(default=None, init=False)
    _windows: int = field(default=0, init=False)

    def frames(self, frames: Iterable[_FRAME]) -> Iterator[FrameMotion]:
        """Yields the motion of each frame, in order, some frames after reading it; memory use is constant."""
        return self.motions(self.look(frame) for frame in frames)

    def motions(self, frames: Iterable[GreyFrame | None]) -> Iterator[FrameMotion]:
        """Yields the motion of each frame, in order, from grey copies (:meth:`look`).

        Args:
            frames: in order; None marks missing frames, which split the sequence.
        """
        shot = Shot()
        for frame in frames:
            if frame is None:
                yield from self._ready(shot, ended=True)
                shot = Shot(number=shot.number + 1, scene=shot.scene + 1)
                continue
            if self._focal is None and self.focal_px:
                self._focal = self.focal_px * ROWS / frame.height
            if not shot.joins(frame, self.ratio):
                yield from self._ready(shot, ended=True)
                shot = shot.next_shot()
            shot.add(frame)
            yield from self._ready(shot, ended=False)
        yield from self._ready(shot, ended=True)

    def look(self, frame: _FRAME) -> GreyFrame:
        """Returns the grey copy of a frame from which its motion is estimated.

        Raises:
            UnshutterError: the frame cannot be read.
        """
        photo = open_photo(frame)
        height, width = self.readout.frame_size(photo.height, photo.width)
        if self._focal is None and self.focal_px is None and (focal_px := photo.focal_px()):
            self._focal = focal_px * ROWS / height
        for_angles = self.ratio is None and self._photos % self.every_angle == 0
        self._photos += 1
        grey = np.ascontiguousarray(self.readout.turn(photo.grey(TRACKED_SIDE)))
        return GreyFrame(height, width, grey, photo=photo if for_angles else None)

    def _ready(self, shot: Shot, ended: bool) -> Iterator[FrameMotion]:
        """Yields the motions of a shot's frames that are ready."""
        waiting = len(shot.waiting)
        if self.ratio is None and waiting and (ended or waiting in (SEARCHED, _PATIENCE)):
            self._find_ratio(shot)
        if self.ratio is None and not ended and waiting < (SEARCHED if shot.still else _PATIENCE):
            return
        core, margin = self.window
        while shot.waiting and (ended or len(shot.waiting) >= core + margin):
            many = len(shot.waiting) if len(shot.waiting) <= core + margin and ended else core
            fit, reason = self._fit(shot, many)
            start = np.floor(shot.times[0])
            for frame in shot.waiting[:many]:
                index = frame.at - start
                ratio = self.ratio.value if self.ratio else 0.0
                size, place = (frame.height, frame.width), (shot.number, shot.scene)
                known = self.turns, frame.time_s, frame.after, frame.tracks if self.whole_path else None, self._focal
                yield FrameMotion(*size, self.readout, fit, index, ratio, reason, *place, *known)
            shot.drop(many, margin)

    def _find_ratio(self, shot: Shot) -> None:
        shot.why_unknown = None
        pairs = [pair for pair in shot.pairs if len(pair)]
        if not pairs or shot.still:
            return
        by_motion = None
        try:
            focal = self._focal or focal_from_motion(pairs[: SEARCHED // 2], _GUESSED_RATIO)
            by_motion = ratio_from_motion(pairs, focal)
        except UnknownRatioError as error:
            shot.why_unknown = error.reason
        if by_motion is None or by_motion.error > SURE_ENOUGH:
            by_motion = self._with_angles(shot, by_motion)
        self.ratio = by_motion

    def _with_angles(self, shot: Shot, by_motion: ReadoutRatio | None) -> ReadoutRatio | None:
        """Combines the readout ratio from motion with that from right angles, as far as available."""
        photos = [
            PhotoSpeed(View(frame.photo, Camera(self.readout, self.focal_px)), speed_of(pair))
            for frame in shot.waiting
            if frame.photo is not None and len(pair := shot.pair_beside(frame)) > _LEAST_TRACKS
        ]
        try:
            by_angles = ratio_from_angles(photos)
        except UnknownRatioError:
            return by_motion
        return combined(by_motion, by_angles) if by_motion else by_angles

    def _fit(self, shot: Shot, many: int) -> tuple[Fit | None, Reason | None]:
        """Returns the motion around the next frames of a shot, or why there is none."""
        fit, reason = self._fit_of_pairs(shot, many)
        if (fit is None or reason is not None) and self.turns is not None and self._focal is not None:
            return fit or Fit.none(self._focal), None  # the gyro suffices, whatever the frames show
        return fit, reason

    def _fit_of_pairs(self, shot: Shot, many: int) -> tuple[Fit | None, Reason | None]:
        """Returns the motion shown by tracks, in addition to a gyro's; or why there is none."""
        pairs = [fewer(pair) for pair in shot.pairs[: shot.before + many + self.window[1] - 1]]
        if not pairs:
            return None, shot.broken_by or Reason(Code.NO_NEIGHBOUR)
        reason = self._too_little(shot)
        if reason is not None and not (self.whole_path and reason.code in _PATH_ONLY):
            return None, reason
        if self.ratio is None:
            return None, shot.why_unknown
        focal = self._focal
        if focal is None and reason is not None:
            focal = usual_focal(pairs[0])
        if focal is None:
            long_enough = len(pairs) >= _CORE // 2
            focal = focal_from_motion(pairs, self.ratio.value)
            self._focal = focal if long_enough else None
        starts = np.array(shot.times[: len(pairs) + 1]) - np.floor(shot.times[0])
        if self.turns is not None:
            moments = pairwise(shot.clock_s)
            pairs = [self.turns.without(pair, *moment) for pair, moment in zip(pairs, moments, strict=False)]
        fit = steady(Problem(pairs, focal, starts), self.ratio.value, self._stiffness_for(len(pairs)))
        if reason is None:
            self._stiffness, self._windows = fit.stiffness, self._windows + 1
        if fit.noise_px > _TOO_NOISY_PX:
            return None, Reason(Code.NO_COMMON_MOTION)
        return fit, reason

    def _too_little(self, shot: Shot) -> Reason | None:
        """Returns why a shot needs no correction, or None if it does."""
        if shot.before + len(shot.waiting) < self.fewest:
            return Reason(Code.SHOT_TOO_SHORT)
        if shot.still:
            still = Code.STOOD_STILL if shot.at_rest else Code.HARDLY_MOVED
            return Reason(Code.ONLY_OTHERS_MOVED if shot.passed else still)
        return None

    def _stiffness_for(self, pairs: int) -> float | None:
        """Returns a known stiffness, or None to search for it, which is slow and so done once in a few windows."""
        if pairs < _FEW_PAIRS:
            return _EVEN
        return None if self._windows % _STIFFNESS_EVERY == 0 else self._stiffness


# ---- for users ---------------------------------------------------------------------------------------------------


class FramesOptions(ClockKeywords, total=False):
    """Keywords of :func:`estimate_frames`."""

    readout_ms: float | None
    focal_px: float | None
    readout: str
    reference: Reference | None


@takes_options(FramesOptions, Clock, Camera, Undo)
def estimate_frames(frames: Iterable[_FRAME], **options: Unpack[FramesOptions]) -> Iterator[Motion]:
    """Estimates the camera's motion during the readout of each frame of a sequence, from its neighbouring frames.

    Exact where a single photo is not: a scene moving by v from frame to frame is sheared by ratio * v over a frame's
    height. Cuts and changes of frame size start a new sequence.

    Args:
        frames: anything that :func:`rectify` accepts, in the order in which they were taken, at even intervals. They
            are read one by one and not kept.
        readout_ratio: readout time of a frame, in frame intervals (above 0, at most 1). Without it, and without
            ``readout_ms`` and ``fps``, it is estimated from how smoothly the camera moved, which fails if the camera
            stood still, moved evenly or shook.
        focal_px: focal length [px of the frames]; by default EXIF's, otherwise it is estimated too.
        **options: other ways to state the readout ratio, and the reference row of the motions.

    Yields:
        The motion of each frame, up to some 60 frames (240 while the ratio is estimated) after reading it. It is zero,
        with a ``reason``, if the frames are inconclusive.

    Raises:
        UsageError: the ratio or another option is invalid.
        UnshutterError: a frame cannot be read.

    Examples:
        >>> motions = unshutter.estimate_frames(["a.jpg", "b.jpg", "c.jpg"], readout_ratio=0.7)
        >>> [motion.height for motion in motions]
        [360, 360, 360]
    """
    ratio = known_ratio(options.get("readout_ratio"), options.get("readout_ms"), options.get("fps"))
    camera, undo = from_keywords(Camera, options), from_keywords(Undo, options)
    finder = CameraMotion(ratio, camera.focal_px, camera.direction)
    return (frame.motion(undo.reference or "first") for frame in finder.frames(frames))


def known_ratio(
    readout_ratio: float | None = None, readout_ms: float | None = None, fps: float | None = None
) -> ReadoutRatio | None:
    """Returns the readout ratio that the user states, or None if they state none.

    Raises:
        UsageError: the ratio is not above 0 and at most 1, or only part of it is stated.
    """
    clock = Clock(readout_ratio, fps, readout_ms)
    if (readout_ms is None) != (fps is None):
        raise UsageError("readout_ms and fps go together: what counts is their product")
    return ReadoutRatio(clock.ratio, 0.0, "what was given") if clock.is_known else None
