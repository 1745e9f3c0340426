"""Self-calibration: estimates a camera's readout ratio and focal length from the motion in its frames.

The readout ratio is the readout time in frame intervals.

A hand-held camera turns smoothly but never evenly. Only at the true ratio do the rows of consecutive frames fall on one
smooth curve; at any other ratio the curve must bend where rows of different times are taken for simultaneous ones. The
evidence of camera.py, computed for a grid of ratios, therefore has a sharp maximum at the true ratio. It has none if
the camera stands still or turns evenly, because every ratio explains that.

The width of that maximum understates the error, because the errors of tracks are correlated. So parts of the sequence
are also evaluated separately, and their scatter counts.

The focal length shows in how much faster the corners of a picture move than its centre.

Shots, consecutive frames that show one scene, collect the tracks for this.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.frames.camera import COARSE, ROWS, Fit, Problem
from unshutter.frames.parallax import DEPTH
from unshutter.frames.tracks import Background, Tracks, background, follow
from unshutter.motion.lens import Lens
from unshutter.motion.robust import CORRELATED
from unshutter.motion.shapes import Bool, Float64, UInt8
from unshutter.options import USUAL_FOCAL
from unshutter.progress import Count, uncounted
from unshutter.readout_time import ReadoutRatio, ReadoutSource
from unshutter.reasons import Code, Reason

REST_PX = 0.06  # px of ROWS rows per frame: the picture of a camera at rest moves by less
STILL_PX = 0.25  # px of ROWS rows per frame: smaller shears are left unchanged
_COARSE = np.arange(1, 11) / 10
_TRIED_FOCALS = USUAL_FOCAL * 2.0 ** np.array([-1.5, 4.0])  # least and most; the longest act like translations


@dataclass(frozen=True)
class CalibrationParams:
    """Parameters of estimating the readout ratio and focal length, and of splitting shots (docs/research/frames.md)."""

    part: int = 30  # pairs of frames per part
    most_tracks: int = 100  # per pair: more only take longer
    fine: tuple[float, ...] = (0.05, 0.02)  # successive step sizes around the maximum
    largest: float = 1.03  # no readout takes longer than a frame; larger estimates are artefacts
    floor: float = 0.01  # least error, even if all parts agree: the spline only approximates a hand's motion
    too_unsure: float = 0.08
    far: float = 3.0  # errors: ratios that are farther away than so many
    fall: float = 2.0  # must be less likely by so much evidence
    fastest: float = 0.4  # cycles per frame: faster oscillations are hidden, unless parts of the sequence agree
    agree: float = 0.05  # standard deviation of the ratios of parts that agree
    even_px: float = 0.1  # px of ROWS rows per frame: a speed that varies by less is even
    few: int = 10  # fewer pairs of frames rarely reveal the ratio, and never why not

    # ---- the focal length
    focal_spread: float = 0.4  # prior: standard deviation of its logarithm
    focal_steps: tuple[float, ...] = (0.35, 0.12, 0.04)  # successive step sizes of its logarithm
    focal_common: float = 20.0  # divisor of the evidence: errors of tracks are correlated, and lenses distort

    # ---- shots
    copies: int = 2  # of a frame, at most
    copy_px: float = 0.005  # the tracks of a copy move by less
    least_corners: int = 24  # fewest corners of a usable picture
    clear: float = 0.7  # share of a pair's tracks that make it a clear one
    clear_before: int = 8  # clear pairs in a row, after which one that is not may be bridged
    chance: int = 2  # pairs of frames in which apparent motion may be a mistake


_FRAMES = CalibrationParams()


def ratio_from_motion(
    pairs: Sequence[Tracks],
    focal_px: float,
    starts: Sequence[float] | None = None,
    is_checked: bool = False,
    count: Count = uncounted,
) -> ReadoutRatio:
    """Estimates the readout ratio of a sequence from how smoothly its camera moved.

    Args:
        pairs: tracks of the background from each frame to the next; two seconds of them usually suffice.
        starts: times of the frames [usual frame intervals], one more than pairs; None if intervals are even.
        is_checked: whether something else contradicts a wrong ratio. Then that of a camera that shakes fast is accepted
            if parts of the sequence agree, which they also do for some cameras without a rolling shutter.
        count: called after each fit, with its number of pairs.
    """
    taken = range(len(pairs) + 1) if starts is None else starts
    times = [taken[k] for k, pair in enumerate(pairs) if len(pair)]
    times.append(taken[-1])
    pairs = [fewer(pair) for pair in pairs if len(pair)]
    if not pairs or max(flow(pair) for pair in pairs) < STILL_PX:
        at_rest = not pairs or max(drift(pair) for pair in pairs) < REST_PX
        raise UnknownRatioError.because(Reason(Code.STOOD_STILL if at_rest else Code.HARDLY_MOVED))
    parts = []
    for k in range(0, max(len(pairs) - _FRAMES.part // 2, 1), _FRAMES.part):
        part = pairs[k : k + _FRAMES.part]
        since = np.array(times[k : k + _FRAMES.part + 1]) - np.floor(times[k])
        depth = DEPTH if is_checked else None
        moments = None if starts is None else since
        parts.append(Problem(part, focal_px, moments, depth, count, COARSE, is_compared=True))
    profiles = [_Profile(part) for part in parts]
    coarse = _curves(profiles, _COARSE)
    best = float(_COARSE[coarse.sum(axis=0).argmax()])
    for step in _FRAMES.fine:
        at = np.clip(best, step, _FRAMES.largest) + step * np.array([-1.0, 0.0, 1.0])
        curves = _curves(profiles, at)
        best, width = _top(at, curves.sum(axis=0))
        best = float(np.clip(best, at[0], at[2]))
    agree = len(parts) > 1 and np.std([_vertex(_COARSE, curve) for curve in coarse]) < _FRAMES.agree
    if not (is_checked and agree) and max(_cycles(profile.fit_at(best)) for profile in profiles) > _FRAMES.fastest:
        raise UnknownRatioError.because(_cause(pairs, Code.SHOOK_TOO_FAST))
    height = curves.sum(axis=0).max()
    error = float(np.hypot(width * _disagreement(at, curves, best), _FRAMES.floor))
    rivals = coarse.sum(axis=0)[np.abs(_COARSE - best) > _FRAMES.far * error] > height - _FRAMES.fall
    if error > _FRAMES.too_unsure or best > _FRAMES.largest or rivals.any():
        raise UnknownRatioError.because(_cause(pairs, Code.TOO_EVEN))
    upwards = [_Profile(replace(part, pairs=[pair.rotated() for pair in part.pairs])) for part in parts]
    if _curves(upwards, _COARSE[1::2]).sum(axis=0).max() > height:
        raise UnknownRatioError.because(_cause(pairs, Code.TOO_EVEN))
    return ReadoutRatio(min(max(best, 0.0), 1.0), error, ReadoutSource.FRAMES)


def _cause(pairs: Sequence[Tracks], code: Code) -> Reason:
    """Returns why the frames do not reveal the ratio; with few frames, only that there are too few."""
    return Reason(code) if len(pairs) >= _FRAMES.few else Reason.of(Code.TOO_FEW_FRAMES, frames=len(pairs) + 1)


class _Profile:
    """The evidence of one part of a sequence as a function of the ratio, cached."""

    def __init__(self, problem: Problem):
        self._problem = problem
        self._fits: dict[float, Fit] = {}

    def at(self, ratio: float) -> float:
        return self.fit_at(ratio).log_evidence / CORRELATED

    def fit_at(self, ratio: float) -> Fit:
        if ratio not in self._fits:
            near = min(self._fits, key=lambda other: abs(other - ratio), default=None)
            self._fits[ratio] = self._problem.fit(ratio, near=self._fits[near] if near is not None else None)
        return self._fits[ratio]


def _curves(profiles: Sequence[_Profile], ratios: Float64[np.ndarray, "ratios"]) -> Float64[np.ndarray, "parts ratios"]:
    """Returns the evidence of each part for some ratios."""
    return np.array([[profile.at(float(ratio)) for ratio in ratios] for profile in profiles])


def _top(at: Float64[np.ndarray, "3"], heights: Float64[np.ndarray, "3"]) -> tuple[float, float]:
    """Returns the maximum of the parabola through three evenly spaced points, and its implied standard deviation."""
    step = at[1] - at[0]
    middle = at[1]
    slope = (heights[2] - heights[0]) / (2 * step)
    bend = (heights[2] - 2 * heights[1] + heights[0]) / step**2
    if bend >= 0:  # no maximum here: undetermined
        return float(at[heights.argmax()]), 1.0
    return float(middle - slope / bend), float(1 / np.sqrt(-bend))


def _disagreement(at: np.ndarray, curves: np.ndarray, best: float) -> float:
    """Returns the scatter of the parts' estimates, as a multiple of their own widths; at least 1."""
    if len(curves) < 2:
        return 2.0
    tops = [_top(at, curve) for curve in curves]
    return max(1.0, np.sqrt(sum(((top - best) / width) ** 2 for top, width in tops) / (len(tops) - 1)))


def _cycles(fit: Fit) -> float:
    """Returns the frequency of an oscillation whose speed varies as the camera's does [cycles per frame]."""
    speed = np.diff(fit.coefficients[:, :3], axis=0) * fit.per_frame  # [knots - 1, 3], px per frame
    varying = np.sqrt(((speed - speed.mean(axis=0)) ** 2).sum(axis=1).mean())
    change = np.sqrt((np.diff(speed, axis=0) ** 2).sum(axis=1).mean()) * fit.per_frame
    return float(change / varying / (2 * np.pi)) if varying > _FRAMES.even_px else 0.0


def flow(pair: Tracks) -> float:
    """Returns the median displacement of the tracks [px of ROWS rows]."""
    return float(np.median(np.hypot(*(pair.end - pair.start).T))) * ROWS / pair.height


def is_copy(pair: Tracks, before: Tracks | None, copies: int) -> bool:
    """Whether a frame is a copy of the previous one, as programs put them where frames are missing.

    Args:
        pair: all tracks from the previous frame.
        before: tracks to that one; None: there are none. A camera at rest takes frames that only look like copies.
        copies: number of copies since then.
    """
    if before is None or not len(before) or not len(pair) or copies >= _FRAMES.copies or flow(before) < STILL_PX:
        return False
    return float(np.median(np.hypot(*(pair.end - pair.start).T))) < _FRAMES.copy_px


def drift(pair: Tracks) -> float:
    """Returns the displacement of the picture as a whole, from the median vector of its tracks [px of ROWS rows]."""
    return float(np.hypot(*np.median(pair.end - pair.start, axis=0))) * ROWS / pair.height


def fewer(pair: Tracks, most: int = _FRAMES.most_tracks) -> Tracks:
    """Returns an even selection of a pair's tracks, of strong and weak corners; more would only cost time."""
    return pair if len(pair) <= most else pair.only(_evenly(len(pair), most))


def others(pair: Tracks, most: int = _FRAMES.most_tracks) -> Tracks:
    """Returns the tracks that :func:`fewer` leaves out: they have no part in a fit, and can check it."""
    return pair.only(~_evenly(len(pair), min(most, len(pair))))


def _evenly(count: int, most: int) -> Bool[np.ndarray, "count"]:
    chosen = np.zeros(count, bool)
    chosen[np.linspace(0, count - 1, most).astype(int)] = True
    return chosen


# ---- the focal length ------------------------------------------------------------------------------------


def usual_focal(pair: Tracks) -> float:
    """Returns the focal length to expect for a picture [px of ROWS rows]."""
    return USUAL_FOCAL * (pair.width + pair.height) * ROWS / pair.height


def focal_from_motion(
    pairs: Sequence[Tracks],
    ratio: float,
    count: Count = uncounted,
    has_parallax: bool = False,
    near_px: float | None = None,
) -> float:
    """Estimates the focal length that best explains the tracks [px of ROWS rows].

    The prior decides if the camera rotated too little. Cameras that translate rather than rotate yield a very long
    focal length, which describes them best, unless depth may add velocities (``has_parallax``).

    Args:
        count: called after each fit, with its number of pairs.
        near_px: focal length from which to start [px of ROWS rows]; by default the usual one.
    """
    unit = usual_focal(pairs[0]) / USUAL_FOCAL

    def problem(share: float) -> Problem:
        given = {"per_frame": COARSE, "has_parallax": has_parallax, "is_compared": True}
        return Problem(pairs, float(share * unit), count=count, **given)

    best = np.log(np.clip((near_px or USUAL_FOCAL * unit) / unit, *_TRIED_FOCALS))
    near = problem(np.exp(best)).fit(ratio)

    def height(logarithm: float) -> float:
        fit = problem(np.exp(logarithm)).fit(ratio, near.stiffness, near)
        prior = (logarithm - np.log(USUAL_FOCAL)) / _FRAMES.focal_spread
        return fit.log_evidence / _FRAMES.focal_common - 0.5 * prior**2

    best = _climbed(height, best, _FRAMES.focal_steps[0])
    near = problem(np.exp(best)).fit(ratio, near=near)  # the best stiffness may differ there
    for step in _FRAMES.focal_steps[1:]:
        best = _climbed(height, best, step)
    return float(np.exp(best) * unit)


def _climbed(height: Callable[[float], float], start: float, step: float) -> float:
    """Returns the maximum of the evidence over the focal length's logarithm, which has a single one."""
    heights: dict[int, float] = {}
    at = 0
    least, most = (round((np.log(limit) - start) / step) for limit in _TRIED_FOCALS)
    while True:
        for k in (at - 1, at, at + 1):
            if k not in heights:
                heights[k] = height(start + step * k)
        highest = int(np.clip(max(heights, key=lambda k: heights[k]), min(least, at), max(most, at)))
        if highest == at:
            beside = np.array([at - 1, at, at + 1])
            return _vertex(start + step * beside, np.array([heights[k] for k in beside]))
        at = highest


def _vertex(at: np.ndarray, heights: np.ndarray) -> float:
    """Returns the maximum of the parabola through the highest of evenly spaced points and its neighbours."""
    k = int(np.clip(heights.argmax(), 1, len(at) - 2))
    before, here, after = heights[k - 1 : k + 2]
    bend = before - 2 * here + after
    if bend >= 0:
        return float(at[heights.argmax()])
    return float(np.clip(at[k] + (before - after) / (2 * bend) * (at[1] - at[0]), at[k - 1], at[k + 1]))


@dataclass(eq=False)
class GreyFrame:
    """A frame as used for estimating motion.

    It holds the full size, a small grey copy, and the time since the previous frame.
    """

    height: int
    width: int
    grey: UInt8[np.ndarray, "rows columns"]  # empty if corners were tracked before
    after: float = 1.0  # time since the previous frame [usual frame intervals]; 0: it is known to repeat that
    at: float = 0.0  # time since the shot began [usual frame intervals]
    time_s: float = 0.0  # time on the clip's clock [s], if there is one
    followed: Tracks | None = None  # all tracks from the previous frame, if corners were tracked before
    background: Background | None = None  # those that move with the camera, if they were found before
    tracks: Tracks | None = None  # those that move with the camera, or all if none do
    copies: int = 0  # number of copies of it that follow


@dataclass(eq=False)
class Shot:
    """Frames that show one scene: those awaiting their motion and a few before them."""

    broken_by: Reason | None = None  # why the shot began here; None for the first one, and after a gap
    number: int = 0  # number of the shot in its sequence
    scene: int = 0  # number of the scene it shows; several shots may show the same one
    pairs: list[Tracks] = field(default_factory=list)  # tracks of the background from each kept frame to the next
    # times of the frames of ``pairs``, one more than those [frame intervals]
    times: list[float] = field(default_factory=list)
    clock_s: list[float] = field(default_factory=list)  # times of those frames on the clip's clock [s]
    waiting: list[GreyFrame] = field(default_factory=list)  # frames awaiting their motion
    before: int = 0  # number of kept frames that are no longer waiting
    # why the readout ratio could not be estimated; None if it was, or was not attempted
    why_unknown: Reason | None = None
    # likeliest fit of the frames before those waiting, and the path that was taken for their motion; with the time from
    # which their times are counted [frame intervals]
    fitted: tuple[float, Fit] | None = None
    taken: tuple[float, Fit] | None = None
    _last: GreyFrame | None = None
    _gap: float = 0.0  # time that its copies take [frame intervals]
    _next: Background | None = None
    _clear: int = 0  # number of pairs in a row, the last ones, whose tracks nearly all move with the camera
    _moving: list[bool] = field(default_factory=list)
    _passing: list[bool] = field(default_factory=list)

    @property
    def still(self) -> bool:
        """Whether there is no sign that the camera moved."""
        return not any(self._moving)

    @property
    def at_rest(self) -> bool:
        """Whether the camera was at rest, without even the slight motion that is too small to count."""
        return all(drift(pair) < REST_PX for pair in self.pairs if len(pair))

    @property
    def passed(self) -> bool:
        """Whether something moved in front of the camera."""
        return sum(self._passing) > _FRAMES.chance

    def repeats(self, frame: GreyFrame, lens: Lens | None = None) -> bool:
        """Whether a frame, taken through this lens, is a copy of the previous one; then it is counted with that."""
        last = self._last
        if last is None or (frame.height, frame.width) != (last.height, last.width):
            return False
        if frame.after > 0:
            if frame.followed is None:  # no track at all is known, too
                frame.followed = follow(last.grey, frame.grey, lens)
            before = self.pairs[-1] if self.pairs else None
            if not is_copy(frame.followed, before, last.copies):
                return False
        last.copies += 1
        self._gap += frame.after
        return True

    def joins(self, frame: GreyFrame, ratio: ReadoutRatio | None, lens: Lens | None = None) -> bool:
        """Whether a frame, taken through this lens, shows the same scene as the previous one."""
        before = self._next
        self._next = None
        if self._last is None:
            return True
        if (frame.height, frame.width) != (self._last.height, self._last.width):
            self.broken_by = Reason(Code.OTHER_SIZE)
            return False
        tracks = follow(self._last.grey, frame.grey, lens) if frame.followed is None else frame.followed
        self._next = frame.background or background(tracks, ratio.value if ratio else None, before)
        frame.tracks = self._next.tracks if self._next.joined else tracks
        if not self._next.joined:
            few = tracks.looked_for < _FRAMES.least_corners
            near_and_far = Code.SCENES_DIFFER if self._next.cut else Code.NO_COMMON_MOTION
            self.broken_by = Reason(Code.TOO_LITTLE_TO_FOLLOW if few else near_and_far)
            if self._clear >= _FRAMES.clear_before and not self._next.cut:  # the path is bridged
                self._next = Background(tracks.only(np.zeros(len(tracks), bool)), joined=True)
        self._clear = self._clear + 1 if len(self._next.tracks) > _FRAMES.clear * len(tracks) else 0
        return self._next.joined

    def next_shot(self) -> Shot:
        """Returns the shot that begins with a frame that does not join this one."""
        cut = self.broken_by is not None and self.broken_by.code in (Code.SCENES_DIFFER, Code.OTHER_SIZE)
        return Shot(broken_by=self.broken_by, number=self.number + 1, scene=self.scene + cut)

    def add(self, frame: GreyFrame) -> None:
        """Adds the next frame, after :meth:`joins`."""
        if self._last is not None and self._next is not None:
            self.pairs.append(self._next.tracks)
            moves = len(self._next.tracks) > 0 and flow(self._next.tracks) > STILL_PX
            self._moving.append(not self._next.still and moves)
            self._passing.append(self._next.passing)
            frame.after += self._gap
            frame.at = self._last.at + frame.after
            self._last.grey = frame.grey[:0]  # no longer needed
        self.times.append(frame.at)
        self.clock_s.append(frame.time_s)
        self.waiting.append(frame)
        self._last = frame
        self._gap = 0.0

    def as_now(self, known: tuple[float, Fit] | None) -> Fit | None:
        """Returns the earlier fit on the clock of the next frames; None if none overlaps them."""
        if known is None:
            return None
        since, fit = known
        frames = int(np.floor(self.times[0]) - since)
        return fit.later(frames) if len(fit.coefficients) > fit.per_frame * frames + 1 else None

    def drop(self, many: int, margin: int) -> None:
        """Removes frames from the waiting list, keeping a few of them."""
        del self.waiting[:many]
        self.before += many
        surplus = max(self.before - margin, 0)
        del self.pairs[:surplus], self._moving[:surplus], self._passing[:surplus]
        del self.times[:surplus], self.clock_s[:surplus]
        self.before -= surplus
