"""Estimates the motion of each frame of a sequence, given in the order in which the frames were taken."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from unshutter.errors import UnknownRatioError, UsageError
from unshutter.frames.camera import ROWS, Fit, Problem, steady
from unshutter.frames.frame_motion import FrameMotion, KnownRotations
from unshutter.frames.parallax import DEPTH
from unshutter.frames.self_calibration import (
    GreyFrame,
    Shot,
    fewer,
    focal_from_motion,
    ratio_from_motion,
    usual_focal,
)
from unshutter.frames.tracks import GUESSED_RATIO, TRACKED_SIDE, Tracks
from unshutter.motion.finding import Finding
from unshutter.motion.lens import Lens
from unshutter.options import Camera, Clock, Reference, Undo, check_focal
from unshutter.options.fields import for_python, from_keywords
from unshutter.orientation import ScanDirection
from unshutter.photo.photo import PhotoLike, open_photo
from unshutter.progress import Count, uncounted
from unshutter.readout_time import ReadoutRatio
from unshutter.reasons import Code, Reason

_LONG_ENOUGH = 12  # pairs of frames that tell the focal length of all
SEARCHED = 60  # frames from which the readout ratio is estimated
_PATIENCE = 240  # frames after which the search ends
_STIFFNESS_EVERY = 96  # frames
_FEW_PAIRS, _EVEN = 2, 100.0  # below this many pairs the speed is kept even, by this stiffness
_STEADY = 1.0  # stiffness of a hand's path
_PATH_ONLY = (Code.HARDLY_MOVED, Code.SHOT_TOO_SHORT)  # reasons that still allow estimating the camera's path


@dataclass(frozen=True)
class Window:
    """The number of frames whose motion is estimated together; that of the middle ones is kept.

    Few frames on both sides let the path swing at the ends of what is kept: neighbouring windows then disagree.
    """

    core: int = 24  # frames whose motion is kept
    behind: int = 16  # extra frames before them
    ahead: int = 16  # extra frames after them


@dataclass(eq=False)
class CameraMotion:
    """Estimates the motion of each frame of a sequence from one camera, remembering what it learns about the camera."""

    ratio: ReadoutRatio | None = None  # readout time in frame intervals; None to estimate it from the frames
    focal_px: float | None = None  # focal length [px of the frames]; None to use EXIF's, or estimate it from the frames
    scan_direction: ScanDirection = ScanDirection.TOP_TO_BOTTOM  # direction in which stored pixels were read
    window: Window = Window()  # frames whose motion is found together
    fewest: int = 2  # shots with fewer frames are left unchanged
    # the camera's rotation measured by a gyro, if available; the frames then give the remaining rotation
    known_rotations: KnownRotations | None = None
    # whether the camera's rotation is estimated even if it is too small, or the shot too short, to be corrected
    whole_path: bool = False
    lens: Lens | None = None  # the lens, if it bends straight lines; it tells the focal length
    # says why the next frames of a shot are left unchanged, by what was seen of it so far; None: nothing is asked
    check: Callable[[Shot], Reason | None] | None = None
    count: Count = uncounted  # called after each fit, with its number of pairs of frames
    _focal: float | None = field(default=None, init=False)  # px of ROWS rows
    _stiffness: float | None = field(default=None, init=False)
    _since_search: int = field(default=0, init=False)  # frames since the stiffness was searched for

    def frames(self, frames: Iterable[PhotoLike]) -> Iterator[FrameMotion]:
        """Yields the motion of each frame, in order, some frames after reading it; memory use is constant."""
        return self.motions(self.add_frame(frame) for frame in frames)

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
            if self.lens is not None:
                self._focal = self.lens.focal * ROWS
            elif self._focal is None and self.focal_px:
                check_focal(self.focal_px, frame.height)
                self._focal = self.focal_px * ROWS / frame.height
            if shot.repeats(frame, self.lens):
                continue
            if not shot.joins(frame, self.ratio, self.lens):
                yield from self._ready(shot, ended=True)
                shot = shot.next_shot()
            shot.add(frame)
            yield from self._ready(shot, ended=False)
        yield from self._ready(shot, ended=True)

    def add_frame(self, frame: PhotoLike) -> GreyFrame:
        """Returns the grey copy of a frame from which its motion is estimated."""
        photo = open_photo(frame)
        height, width = self.scan_direction.frame_size(photo.height, photo.width)
        if self._focal is None and self.focal_px is None and (focal_px := photo.focal_px()):
            self._focal = focal_px * ROWS / height
        grey = np.ascontiguousarray(self.scan_direction.to_scan_frame(photo.grey(TRACKED_SIDE)))
        return GreyFrame(height, width, grey)

    def _ready(self, shot: Shot, ended: bool) -> Iterator[FrameMotion]:
        """Yields the motions of a shot's frames that are ready."""
        waiting = len(shot.waiting)
        if self.ratio is None and waiting and (ended or waiting in (SEARCHED, _PATIENCE)):
            self._find_ratio(shot)
        if self.ratio is None and not ended and waiting < (SEARCHED if shot.still else _PATIENCE):
            return
        core = self.window.core
        most = self.window.core + self.window.ahead
        while shot.waiting and (ended or len(shot.waiting) >= most):
            many = len(shot.waiting) if len(shot.waiting) <= most and ended else core
            fit, reason = self._fit(shot, many)
            if (fit is None or reason is not None) and self.known_rotations is not None and self._focal is not None:
                fit, reason = fit or Fit.none(self._focal), None  # the gyro suffices, whatever the frames show
            if reason is None and self.check is not None:
                reason = self.check(shot)
            start = np.floor(shot.times[0])
            for frame in shot.waiting[:many]:
                motion = FrameMotion(
                    height=frame.height,
                    width=frame.width,
                    scan_direction=self.scan_direction,
                    fit=fit,
                    at=frame.at - start,
                    ratio=self.ratio.value if self.ratio else 0.0,
                    reason=reason,
                    shot=shot.number,
                    scene=shot.scene,
                    rotations=self.known_rotations,
                    time_s=frame.time_s,
                    after=frame.after,
                    tracks=frame.tracks if self.whole_path else None,
                    focal=self._focal,
                    lens=self.lens,
                )
                yield motion
                yield from [replace(motion, after=0.0, tracks=None)] * frame.copies
            shot.drop(many, self.window.behind)

    def _find_ratio(self, shot: Shot) -> None:
        shot.why_unknown = None
        pairs = [pair for pair in shot.pairs if len(pair)]
        if not pairs or shot.still:
            return
        try:
            focal = self._focal or focal_from_motion(pairs[: SEARCHED // 2], GUESSED_RATIO, self.count)
            self.ratio = ratio_from_motion(pairs, focal, count=self.count)
        except UnknownRatioError as error:
            shot.why_unknown = error.reason

    def _fit(self, shot: Shot, many: int) -> tuple[Fit | None, Reason | None]:
        """Returns the motion around the next frames of a shot, in addition to a gyro's; or why there is none."""
        pairs = shot.pairs[: shot.before + many + self.window.ahead - 1]
        pairs = [fewer(pair) for pair in pairs]
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
        is_found = focal is None
        if focal is None:
            focal = self._found_focal(pairs, self.ratio)
        starts = np.array(shot.times[: len(pairs) + 1]) - np.floor(shot.times[0])
        if self.known_rotations is not None:
            moments = pairwise(shot.clock_s)
            pairs = [self.known_rotations.without(pair, *moment) for pair, moment in zip(pairs, moments, strict=False)]
        # two frames alone do not tell skew that depth adds from skew that the readout adds
        problem = Problem(pairs, focal, starts, DEPTH if len(pairs) >= _FEW_PAIRS else None, self.count)
        # the search for the stiffness is slow, and so done once in a while
        known = None if self._since_search >= _STIFFNESS_EVERY else self._stiffness
        stiffness = _EVEN if len(pairs) < _FEW_PAIRS else known
        problem, likeliest = self._likeliest(problem, self.ratio, stiffness, shot.as_now(shot.fitted), is_found)
        fit = steady(likeliest, problem, self.ratio.value)
        path_before = shot.as_now(shot.taken)
        if path_before is not None:
            fit = fit.after(path_before, starts[shot.before], 8.0)  # fewer frames than are ahead
        shot.fitted = np.floor(shot.times[0]), likeliest
        shot.taken = np.floor(shot.times[0]), fit
        if reason is None:  # what one window needs to be steady is not carried over to the next
            self._since_search = many if known is None else self._since_search + many
            self._stiffness = likeliest.stiffness
        if fit.noise_px > 2.0:  # no camera rotation explains the tracks
            return None, Reason(Code.NO_COMMON_MOTION)
        return fit, reason

    def _likeliest(
        self, problem: Problem, ratio: ReadoutRatio, stiffness: float | None, near: Fit | None, is_found: bool
    ) -> tuple[Problem, Fit]:
        """Returns the most probable motion, and the problem it solves: with velocities of depth if tracks bear them.

        Args:
            stiffness: of the path, unless tracks bear depth; None to search for it.
            near: fit of some of these frames, from which to start.
            is_found: whether the focal length was found in these frames: a rotation that imitates depth needs a longer.
        """
        if len(problem.pairs) < _LONG_ENOUGH or self.known_rotations is not None:
            return problem, problem.fit(ratio.value, stiffness, near)
        had_depth = near is not None and near.parallax is not None
        fit = None if had_depth else problem.fit(ratio.value, stiffness, near)
        # a path that swings within each frame imitates depth
        stiffer = fit
        if stiffer is None or stiffer.stiffness < _STEADY:
            stiffer = problem.fit(ratio.value, _STEADY, fit or near)
        if not problem.shows_parallax(stiffer, ratio.value):
            return problem, fit or problem.fit(ratio.value, stiffness, stiffer)
        focal = problem.focal_px
        if is_found:
            focal = self._found_focal(problem.pairs, ratio, has_parallax=True, near_px=focal)
        problem = replace(problem, focal_px=focal, has_parallax=True)
        return problem, problem.fit(ratio.value, near=stiffer)

    def _found_focal(
        self, pairs: Sequence[Tracks], ratio: ReadoutRatio, has_parallax: bool = False, near_px: float | None = None
    ) -> float:
        """Returns the focal length that pairs of frames show [px of ROWS rows]; remembers that of enough pairs."""
        focal = focal_from_motion(pairs, ratio.value, self.count, has_parallax, near_px)
        self._focal = focal if len(pairs) >= _LONG_ENOUGH else None
        return focal

    def _too_little(self, shot: Shot) -> Reason | None:
        """Returns why a shot needs no correction, or None if it does."""
        if shot.before + len(shot.waiting) < self.fewest:
            return Reason(Code.SHOT_TOO_SHORT)
        if shot.still:
            still = Code.STOOD_STILL if shot.at_rest else Code.HARDLY_MOVED
            return Reason(Code.ONLY_OTHERS_MOVED if shot.passed else still)
        return None


# ---- for users ---------------------------------------------------------------------------------------------------


@for_python(Clock, Camera, Undo)
def estimate_frames(
    frames: Iterable[PhotoLike],
    *,
    readout_ratio: float | None = None,
    readout_ms: float | None = None,
    fps: float | None = None,
    focal_px: float | None = None,
    readout: str = "auto",
    reference: Reference | None = None,
) -> Iterator[Finding]:
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

    Yields:
        The motion of each frame, up to some 60 frames (240 while the ratio is estimated) after reading it. It is zero,
        with a ``reason``, if the frames are inconclusive.

    Raises:
        UsageError: the ratio or another option is invalid.
        UnshutterError: a frame cannot be read.

    Examples:
        >>> frames = unshutter.estimate_frames(["a.jpg", "b.jpg", "c.jpg"], readout_ratio=0.7)
        >>> [found.motion.height for found in frames]
        [360, 360, 360]
    """
    camera = from_keywords(Camera, {"readout": readout, "focal_px": focal_px, "readout_ms": readout_ms})
    row = from_keywords(Undo, {"reference": reference}).reference or "first"
    clock = from_keywords(Clock, {"readout_ratio": readout_ratio, "fps": fps})
    finder = CameraMotion(stated_ratio(clock, camera), camera.focal_px, camera.scan_direction)
    return (frame.finding(row) for frame in finder.frames(frames))


def stated_ratio(clock: Clock, camera: Camera) -> ReadoutRatio | None:
    """Returns the readout ratio that the keywords of a function state, or None if they state none."""
    if (camera.readout_ms is None) != (clock.fps is None):
        raise UsageError("give both readout_ms and fps, or neither")
    return replace(clock, readout_ms=camera.readout_ms).stated_ratio
