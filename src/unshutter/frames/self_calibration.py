"""Self-calibration: estimates a camera's readout ratio and focal length from the motion in its frames.

The readout ratio is the readout time in frame intervals.

A hand-held camera turns smoothly but never evenly. Only at the true ratio do the rows of consecutive frames fall on one
smooth curve; at any other ratio the curve must bend where rows of different times are taken for simultaneous ones. The
evidence of camera.py, computed for a grid of ratios, therefore has a sharp maximum at the true ratio. It has none if
the camera stands still or turns evenly, because every ratio explains that.

The width of that maximum understates the error, because the errors of tracks are correlated. So parts of the sequence
are also evaluated separately, and their scatter counts.

The focal length shows in how much faster the corners of a picture move than its centre.
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

_PART = 20  # pairs of frames per part
_MOST_TRACKS = 100  # per pair: more only take longer
_COARSE = np.arange(1, 11) / 10
_FINE = (0.05, 0.02)  # successive step sizes around the maximum
_LARGEST = 1.03  # no readout takes longer than a frame; larger estimates are artefacts
_COMMON = 4.0  # errors of tracks are correlated: n of them count as n / _COMMON
_FLOOR = 0.01  # least error, even if all parts agree: the spline only approximates a hand's motion
_TOO_UNSURE = 0.08
REST_PX = 0.06  # px of ROWS rows per frame: the picture of a camera at rest moves by less
STILL_PX = 0.25  # px of ROWS rows per frame: smaller shears are left unchanged
_FASTEST = 0.4  # cycles per frame: faster oscillations are hidden between the frames
_EVEN_PX = 0.1  # px of ROWS rows per frame: a speed that varies by less is even
_FEW = 10  # fewer pairs of frames rarely reveal the ratio, and never why not
_USUAL_FOCAL, _FOCAL_SPREAD = 0.85, 0.4  # prior: share of width + height, and standard deviation of its logarithm
_TRIED_FOCALS = _USUAL_FOCAL * 2.0 ** np.arange(-1.5, 4.1, 0.5)  # the longest act like translations
_FOCAL_STEPS = (0.12, 0.04)  # successive step sizes of its logarithm
_FOCAL_COMMON = 20.0  # divisor of the evidence: errors of tracks are correlated, and lenses distort


@dataclass(frozen=True)
class RatioRange:
    """The plausible readout ratios if the true one is unknown.

    Attributes:
        lowest, highest: readout time in frame intervals, 0 ... 1.
        cameras: the cameras, and their modes, that the range covers.
    """

    lowest: float
    highest: float
    cameras: str


@dataclass(frozen=True)
class ReadoutRatio:
    """A readout ratio and its uncertainty.

    Attributes:
        value: readout time in frame intervals, 0 ... 1.
        error: its standard deviation.
        source: the evidence it was derived from.
        camera: name of the camera if the source is the table of cameras; otherwise empty.
        instead_of: why the clip does not reveal its own ratio, if a usual one was used; otherwise None.
        plausible: the range around a usual ratio; None if the ratio is known.
    """

    value: float
    error: float
    source: str
    camera: str = ""
    instead_of: Reason | None = None
    plausible: RatioRange | None = None

    def as_json(self) -> dict[str, Any]:
        """Returns all attributes, ready for JSON, as read by :meth:`from_json`."""
        plausible = self.plausible and [self.plausible.lowest, self.plausible.highest, self.plausible.cameras]
        reason = self.instead_of and self.instead_of.as_json()
        own = {"value": self.value, "error": self.error, "source": self.source, "camera": self.camera}
        return {**own, "instead_of": reason, "plausible": plausible}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ReadoutRatio:
        """Reads the data written by :meth:`as_json`."""
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
    """Estimates the readout ratio of a sequence from how smoothly its camera moved.

    Args:
        pairs: tracks of the background from each frame to the next; two seconds of them usually suffice.
        focal_px: focal length [px of ROWS rows].
        starts: times of the frames [usual frame intervals], one more than pairs; None if intervals are even.

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
    """Returns why the frames do not reveal the ratio; with few frames, only that there are too few."""
    return Reason(code) if len(pairs) >= _FEW else Reason.of(Code.TOO_FEW_FRAMES, frames=len(pairs) + 1)


class _Profile:
    """The evidence of one part of a sequence as a function of the ratio, cached."""

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
    """Returns the maximum of the parabola through three evenly spaced points, and its implied standard deviation."""
    step, middle = at[1] - at[0], at[1]
    slope, bend = (heights[2] - heights[0]) / (2 * step), (heights[2] - 2 * heights[1] + heights[0]) / step**2
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
    speed = np.diff(fit.coefficients[:, :3], axis=0) * fit.knots_per_frame  # [knots - 1, 3], px per frame
    varying = np.sqrt(((speed - speed.mean(axis=0)) ** 2).sum(axis=1).mean())
    change = np.sqrt((np.diff(speed, axis=0) ** 2).sum(axis=1).mean()) * fit.knots_per_frame
    return float(change / varying / (2 * np.pi)) if varying > _EVEN_PX else 0.0


def flow(pair: Tracks) -> float:
    """Returns the median displacement of the tracks [px of ROWS rows]."""
    return float(np.median(np.hypot(*(pair.end - pair.start).T))) * ROWS / pair.height


def drift(pair: Tracks) -> float:
    """Returns the displacement of the picture as a whole, from the median vector of its tracks [px of ROWS rows]."""
    return float(np.hypot(*np.median(pair.end - pair.start, axis=0))) * ROWS / pair.height


def fewer(pair: Tracks, most: int = _MOST_TRACKS) -> Tracks:
    """Returns an even selection of a pair's tracks, with strong and weak corners; more would only take longer."""
    if len(pair) <= most:
        return pair
    chosen = np.zeros(len(pair), bool)
    chosen[np.linspace(0, len(pair) - 1, most).astype(int)] = True
    return pair.only(chosen)


# ---- the focal length ------------------------------------------------------------------------------------


def usual_focal(pair: Tracks) -> float:
    """Returns the focal length to expect for a picture [px of ROWS rows]."""
    return _USUAL_FOCAL * (pair.width + pair.height) * ROWS / pair.height


def focal_from_motion(pairs: Sequence[Tracks], ratio: float) -> float:
    """Estimates the focal length that best explains the tracks [px of ROWS rows].

    The prior decides if the camera rotated too little. Cameras that translate rather than rotate yield a very long
    focal length, which describes them best.

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
    near = Problem(pairs, float(np.exp(best) * unit)).fit(ratio, near=near)  # the best stiffness may differ there
    for step in _FOCAL_STEPS:
        at = best + step * np.array([-1.0, 0.0, 1.0])
        best = _vertex(at, np.array([height(share) for share in np.exp(at)]))
    return float(np.exp(best) * unit)


def _vertex(at: np.ndarray, heights: np.ndarray) -> float:
    """Returns the maximum of the parabola through the highest of evenly spaced points and its neighbours."""
    k = int(np.clip(heights.argmax(), 1, len(at) - 2))
    before, here, after = heights[k - 1 : k + 2]
    bend = before - 2 * here + after
    if bend >= 0:
        return float(at[heights.argmax()])
    return float(np.clip(at[k] + (before - after) / (2 * bend) * (at[1] - at[0]), at[k - 1], at[k + 1]))
