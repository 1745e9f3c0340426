"""Self-calibration: the readout ratio and the focal length of a camera from the motion in its frames.

The readout ratio is the readout time in frame intervals.

A camera that is held by hand turns smoothly, but never evenly. Only at the true ratio do the rows of consecutive frames
fall into place on one smooth curve: at every other one the curve must bend where rows of different times are taken for
rows of the same. So the evidence of camera.py, worked out for ratios on a grid, has a sharp maximum at the true one.
It has none where the camera stands still or turns evenly, because every ratio explains that.

The width of that maximum says too little about the error: tracks err together. So parts of the sequence are also asked
one by one, and what they differ by counts.

The focal length shows in how much faster the corners of a picture move than its middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.frames.camera import ROWS, Fit, Problem
from unshutter.frames.tracks import Tracks
from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

_PART = 20  # pairs of frames that are asked together
_MOST_TRACKS = 100  # of a pair: more only take longer
_COARSE = np.arange(1, 11) / 10
_FINE = (0.05, 0.02)  # steps about the maximum, one after the other
_LARGEST = 1.03  # no readout takes longer than a frame; what is found above this is an artefact
_COMMON = 4.0  # tracks err together: a probability of n tracks is worth one of n / _COMMON
_FLOOR = 0.01  # error that is there even where all parts agree: the spline is no hand
_TOO_UNSURE = 0.08
REST_PX = 0.06  # px of ROWS rows a frame: the whole picture of a camera that stands still moves by less
STILL_PX = 0.25  # px of ROWS rows a frame: what a readout shears by less is left as it is
_FASTEST = 0.4  # cycles a frame: what is faster is hidden between the frames
_EVEN_PX = 0.1  # px of ROWS rows a frame: a speed that varies by less is even
_FEW = 10  # pairs of frames that rarely show the ratio, and never why not
_USUAL_FOCAL, _FOCAL_SPREAD = 0.85, 0.4  # of width + height, and of its logarithm: what is expected beforehand
_TRIED_FOCALS = _USUAL_FOCAL * 2.0 ** np.arange(-1.5, 4.1, 0.5)  # the longest: hardly a turn
_FOCAL_STEPS = (0.12, 0.04)  # steps of its logarithm, one after the other
_FOCAL_COMMON = 20.0  # tracks err together, and lenses distort: evidence counts for so much less


@dataclass(frozen=True)
class RatioRange:
    """The readout ratios that are plausible where the true one is not known.

    Attributes:
        lowest, highest: readout time in frame intervals, 0 ... 1.
        cameras: the cameras, and their modes, that the range is of.
    """

    lowest: float
    highest: float
    cameras: str


@dataclass(frozen=True)
class ReadoutRatio:
    """A readout ratio and how sure it is.

    Attributes:
        value: readout time in frame intervals, 0 ... 1.
        error: its standard deviation.
        source: what it was found from.
        camera: name of the camera whose time is listed, where the source is the table of cameras; else empty.
        instead_of: why the clip does not show its own ratio, where a usual one was taken; else None.
        plausible: the range of a usual ratio; None where the ratio is known.
    """

    value: float
    error: float
    source: str
    camera: str = ""
    instead_of: Reason | None = None
    plausible: RatioRange | None = None

    def as_json(self) -> dict[str, Any]:
        """All of it, for :meth:`from_json`."""
        plausible = self.plausible and [self.plausible.lowest, self.plausible.highest, self.plausible.cameras]
        reason = self.instead_of and self.instead_of.as_json()
        own = {"value": self.value, "error": self.error, "source": self.source, "camera": self.camera}
        return {**own, "instead_of": reason, "plausible": plausible}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ReadoutRatio:
        """Reads what :meth:`as_json` wrote."""
        reason, plausible = data["instead_of"], data["plausible"]
        return cls(
            data["value"],
            data["error"],
            data["source"],
            data["camera"],
            None if reason is None else Reason.from_json(reason),
            None if plausible is None else RatioRange(*plausible),
        )

    def __str__(self) -> str:
        return f"{self.value:.3f} +- {self.error:.3f} (from {self.source})"


def ratio_from_motion(pairs: Sequence[Tracks], focal_px: float, starts: Sequence[float] | None = None) -> ReadoutRatio:
    """The readout ratio of a sequence, from how smoothly its camera moved.

    Args:
        pairs: tracks of the background from each frame to the next; two seconds of them are enough as a rule.
        focal_px: focal length [px of ROWS rows].
        starts: when each frame was taken [usual frame intervals], one more than pairs; None: at even intervals.

    Raises:
        UnknownRatioError: the camera stood still, moved evenly, or shook faster than frames were taken.
    """
    taken = range(len(pairs) + 1) if starts is None else starts
    times = [taken[k] for k, pair in enumerate(pairs) if len(pair)]
    times.append(taken[-1])
    pairs = [fewer(pair) for pair in pairs if len(pair)]
    if not pairs or max(flow(pair) for pair in pairs) < STILL_PX:
        at_rest = not pairs or max(drift(pair) for pair in pairs) < REST_PX
        raise UnknownRatioError.because(Reason(Code.STOOD_STILL if at_rest else Code.HARDLY_MOVED))
    parts = []
    for k in range(0, max(len(pairs) - _PART // 2, 1), _PART):
        part, since = pairs[k : k + _PART], np.array(times[k : k + _PART + 1]) - np.floor(times[k])
        parts.append(Problem(part, focal_px, None if starts is None else since))
    profiles = [_Profile(part) for part in parts]
    coarse = np.sum([[profile.at(ratio) for ratio in _COARSE] for profile in profiles], axis=0)
    best = float(_COARSE[coarse.argmax()])
    for step in _FINE:
        at = np.clip(best, step, _LARGEST) + step * np.array([-1.0, 0.0, 1.0])
        curves = np.array([[profile.at(float(ratio)) for ratio in at] for profile in profiles])  # [parts, 3]
        best, width = _top(at, curves.sum(axis=0))
        best = float(np.clip(best, at[0], at[2]))
    if max(_cycles(profile.fit_at(best)) for profile in profiles) > _FASTEST:
        raise UnknownRatioError.because(_cause(pairs, Code.SHOOK_TOO_FAST))
    error = float(np.hypot(width * _disagreement(at, curves, best), _FLOOR))
    if error > _TOO_UNSURE or best > _LARGEST:
        raise UnknownRatioError.because(_cause(pairs, Code.TOO_EVEN))
    return ReadoutRatio(min(max(best, 0.0), 1.0), error, "motion")


def _cause(pairs: Sequence[Tracks], code: Code) -> Reason:
    """Why the frames do not show the ratio; a few frames cannot even show that."""
    return Reason(code) if len(pairs) >= _FEW else Reason.of(Code.TOO_FEW_FRAMES, frames=len(pairs) + 1)


class _Profile:
    """The evidence of a part of a sequence for each ratio that is asked for."""

    def __init__(self, problem: Problem):
        self._problem = problem
        self._fits: dict[float, Fit] = {}

    def at(self, ratio: float) -> float:
        return self.fit_at(ratio).log_evidence / _COMMON

    def fit_at(self, ratio: float) -> Fit:
        if ratio not in self._fits:
            near = min(self._fits, key=lambda other: abs(other - ratio), default=None)
            self._fits[ratio] = self._problem.fit(ratio, near=self._fits[near] if near is not None else None)
        return self._fits[ratio]


def _top(at: Float64[np.ndarray, "3"], heights: Float64[np.ndarray, "3"]) -> tuple[float, float]:
    """Where the parabola through three evenly spaced points is highest, and the standard deviation it says."""
    step, middle = at[1] - at[0], at[1]
    slope, bend = (heights[2] - heights[0]) / (2 * step), (heights[2] - 2 * heights[1] + heights[0]) / step**2
    if bend >= 0:  # no maximum here: nothing is known
        return float(at[heights.argmax()]), 1.0
    return float(middle - slope / bend), float(1 / np.sqrt(-bend))


def _disagreement(at: np.ndarray, curves: np.ndarray, best: float) -> float:
    """By how much parts of the sequence differ, as a multiple of what their own widths allow; at least 1."""
    if len(curves) < 2:
        return 2.0
    tops = [_top(at, curve) for curve in curves]
    return max(1.0, np.sqrt(sum(((top - best) / width) ** 2 for top, width in tops) / (len(tops) - 1)))


def _cycles(fit: Fit) -> float:
    """How fast the camera's speed changed, as the frequency of an oscillation that does so [cycles a frame]."""
    speed = np.diff(fit.coefficients[:, :3], axis=0) * fit.knots_per_frame  # [knots - 1, 3], px a frame
    varying = np.sqrt(((speed - speed.mean(axis=0)) ** 2).sum(axis=1).mean())
    change = np.sqrt((np.diff(speed, axis=0) ** 2).sum(axis=1).mean()) * fit.knots_per_frame
    return float(change / varying / (2 * np.pi)) if varying > _EVEN_PX else 0.0


def flow(pair: Tracks) -> float:
    """By how much tracks move, their median [px of ROWS rows]."""
    return float(np.median(np.hypot(*(pair.end - pair.start).T))) * ROWS / pair.height


def drift(pair: Tracks) -> float:
    """By how much the picture moves as a whole, without the errors of single tracks [px of ROWS rows]."""
    return float(np.hypot(*np.median(pair.end - pair.start, axis=0))) * ROWS / pair.height


def fewer(pair: Tracks, most: int = _MOST_TRACKS) -> Tracks:
    """Enough of the tracks of a pair, strong corners and weak ones: more only take longer."""
    if len(pair) <= most:
        return pair
    chosen = np.zeros(len(pair), bool)
    chosen[np.linspace(0, len(pair) - 1, most).astype(int)] = True
    return pair.only(chosen)


# ---- the focal length ------------------------------------------------------------------------------------


def usual_focal(pair: Tracks) -> float:
    """The focal length to expect of a picture [px of ROWS rows]."""
    return _USUAL_FOCAL * (pair.width + pair.height) * ROWS / pair.height


def focal_from_motion(pairs: Sequence[Tracks], ratio: float) -> float:
    """The focal length that explains tracks best [px of ROWS rows].

    The expectation beforehand decides where the camera turned too little to say. Cameras that move rather than turn
    come out with a very long one, as which they are described best.

    Args:
        pairs: tracks of the background from each frame to the next.
        ratio: readout time in frame intervals; a guess will do.
    """
    unit = usual_focal(pairs[0]) / _USUAL_FOCAL
    near = Problem(pairs, _USUAL_FOCAL * unit).fit(ratio)

    def height(share: float) -> float:
        fit = Problem(pairs, float(share * unit)).fit(ratio, near.stiffness, near)
        return fit.log_evidence / _FOCAL_COMMON - 0.5 * (np.log(share / _USUAL_FOCAL) / _FOCAL_SPREAD) ** 2

    best = _vertex(np.log(_TRIED_FOCALS), np.array([height(share) for share in _TRIED_FOCALS]))
    near = Problem(pairs, float(np.exp(best) * unit)).fit(ratio, near=near)  # the stiffness may be another there
    for step in _FOCAL_STEPS:
        at = best + step * np.array([-1.0, 0.0, 1.0])
        best = _vertex(at, np.array([height(share) for share in np.exp(at)]))
    return float(np.exp(best) * unit)


def _vertex(at: np.ndarray, heights: np.ndarray) -> float:
    """Where the parabola through the highest of evenly spaced points and its neighbours is highest."""
    k = int(np.clip(heights.argmax(), 1, len(at) - 2))
    before, here, after = heights[k - 1 : k + 2]
    bend = before - 2 * here + after
    if bend >= 0:
        return float(at[heights.argmax()])
    return float(np.clip(at[k] + (before - after) / (2 * bend) * (at[1] - at[0]), at[k - 1], at[k + 1]))
