"""Estimates a photo's motion, or that it had none, from its film; stabilised films are rejected."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from unshutter.errors import UnknownRatioError
from unshutter.estimators.base import View
from unshutter.frames.camera import ROWS, Problem, steady
from unshutter.frames.self_calibration import ReadoutRatio, fewer, ratio_from_motion
from unshutter.frames.tracks import TRACKED_SIDE, Tracks, background, follow
from unshutter.geometry.readout import Readout
from unshutter.motion import Motion
from unshutter.motion_photo.film import Film, decoded
from unshutter.motion_photo.registration import Matches, Placement, matches, placement
from unshutter.motion_photo.still_fit import Frames, StillFit, fit_still
from unshutter.reasons import Code, MotionSource, Reason

if TYPE_CHECKING:
    from unshutter.geometry.shapes import UInt8

NAME = MotionSource.FILM.value
_AROUND, _FEWEST = 30, 6  # frames used on each side of the photo; fewest frames of a usable film
_MATCHED = 2  # frames on each side that the photo is compared with
_USUAL_RATIO = ReadoutRatio(0.6, 0.2, "what is usual")  # typical of phones' films
_LEAST_RATIO = 0.12  # frames with a shorter readout were rectified by the phone
_LEAST_PX = 0.25  # px of ROWS rows, mean over the photo: less counts as no motion
_OFF_PX = 1.5  # px of ROWS rows: largest distance of the photo from the path of an unstabilised film
_AGAINST_PX, _AGAINST_SHARE = 0.8, 0.1  # tolerated difference between its rate and the path's, and share of it
_RATIOS = (0.05, 2.0)  # readout times of photos [frame intervals]
_STEP = 0.05  # frame intervals
_SYSTEMATIC_PX = 0.08  # px of ROWS rows: lens corrections and other effects that are not motion
_RIGHT_PX, _RIGHT_SHARE = 1.0, 0.1  # tolerance of a correct motion: px of ROWS rows, or share of it


@dataclass(frozen=True)
class FilmEvidence:
    """The evidence of a photo's film about the photo's motion.

    Attributes:
        motion: the photo's motion, zero with a reason if the camera stood still; None if the film is inconclusive.
        reason: why the film is inconclusive; otherwise None.
    """

    motion: Motion | None = None
    reason: Reason | None = None


def film_motion(view: View) -> FilmEvidence | None:
    """Returns the evidence of a photo's film about its motion, or None if the photo has no readable film.

    Raises:
        UnshutterError: the photo is damaged or gone.
    """
    place = view.photo.film()
    film = None if place is None else decoded(place)
    if film is None:
        return None
    try:
        return motion_by(film, view)
    except (cv2.error, np.linalg.LinAlgError):  # blank or noisy frames
        return FilmEvidence(reason=Reason(Code.FILM_DIFFERS))


def motion_by(film: Film, view: View) -> FilmEvidence:
    """Returns the evidence of a film about a photo's motion.

    Args:
        film: frames around the photo's time.
        view: the photo and the known data of its camera.
    """
    height, width = film.frames[0].shape
    if len(film.frames) < _FEWEST or height > width:  # rotated upright: its rows are not those of the sensor
        return FilmEvidence(reason=Reason(Code.FILM_TOO_SHORT))
    still = _Still.of(view, film)
    if still is None:
        return FilmEvidence(reason=Reason(Code.FILM_DIFFERS))
    view = replace(view, camera=replace(view.camera, readout=still.readout.value))
    run = _Run.around(film, still.near)
    if run is None:
        return FilmEvidence(reason=Reason(Code.FILM_TOO_SHORT))
    focal = still.focal_px * ROWS / height
    ratio = run.ratio(focal)
    if ratio is None or ratio.value < _LEAST_RATIO:
        return FilmEvidence(reason=Reason(Code.FILM_STABILISED))
    frames = run.frames(focal, ratio)
    near = still.near - run.first
    fit = still.fit(frames, run, near)
    if fit is not None and abs((at := _nearest(frames, fit)[0]) - near) > _MATCHED:  # taken at another time
        near = int(np.clip(round(at), 0, len(run.greys) - 1))
        fit = still.fit(frames, run, near) or fit
    if fit is None:
        return FilmEvidence(reason=Reason(Code.FILM_DIFFERS))
    return _judged(view, frames, fit, ratio)


# ---- the photo within the film -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Still:
    """A photo located within its film.

    Attributes:
        copy: grey copy in the readout frame.
        placement: placement of that copy in the film's frames.
        near: number of the frame in which it was found.
        readout: direction in which the stored photo was read, if the film's rows are those of the sensor.
        focal_px: focal length [px of the film's copies].
    """

    copy: UInt8[np.ndarray, "rows columns"]
    placement: Placement
    near: int
    readout: Readout
    focal_px: float

    @classmethod
    def of(cls, view: View, film: Film) -> _Still | None:
        """Locates the photo in one of the frames; returns None if it is not found."""
        stored = view.photo.grey(TRACKED_SIDE)
        last = len(film.frames) - 1
        middle = last / 2
        if film.moment_s is not None:
            middle = np.interp(film.moment_s, film.times_s, np.arange(last + 1))
        tried = dict.fromkeys(int(np.clip(round(at), 0, last)) for at in (middle, 0.75 * middle, middle + 0.25 * last))
        for near in tried:
            place = placement(stored, film.frames[near])
            if place is not None:
                break
        else:
            return None
        readout = next(each for each in Readout if each.quarter_turns % 4 == place.quarter_turns)
        if view.camera.readout not in ("auto", readout.value):
            return None
        copy = np.ascontiguousarray(readout.turn(stored))
        scale = place.scale * copy.shape[0] / readout.frame_size(view.photo.height, view.photo.width)[0]
        return cls(copy, place, near, readout, view.focal_px() * scale)

    def fit(self, frames: Frames, run: _Run, near: int) -> StillFit | None:
        """Fits the rotation of the photo's rows from the frames around ``near``; None if found in fewer than two."""
        found: dict[int, Matches] = {}
        guess = np.zeros(3)
        unit, focal = frames.height / ROWS, frames.fit.focal_px
        beside = [k for k in range(near - _MATCHED, near + _MATCHED + 1) if 0 <= k < len(run.greys)]
        path = frames.path(frames.times + frames.ratio / 2)
        for k in sorted(beside, key=lambda k: abs(k - near)):
            moved = path[k] - path[near]
            expected = guess + np.array([moved[1] * unit, -moved[0] * unit, moved[2] / focal])
            each = matches(self.copy, run.greys[k], self.placement.scale, expected)
            if each is not None:
                found[k] = each
                if k == near:
                    guess = np.append(np.median(each.frame - each.photo, axis=0), 0.0)
        if len(found) < 2:
            return None
        return fit_still(frames, found, self.copy.shape[0] * self.placement.scale)


# ---- the film ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Run:
    """Consecutive frames of one shot around the photo's time.

    Attributes:
        first: number of the first of them in the film.
        greys: the frames.
        starts: times of the frames [usual frame intervals since the first].
        pairs: tracks of the background from each frame to the next.
    """

    first: int
    greys: list[UInt8[np.ndarray, "height width"]]
    starts: list[float]
    pairs: list[Tracks]

    @classmethod
    def around(cls, film: Film, near: int) -> _Run | None:
        """Returns the connected frames around ``near``, or None if there are too few."""
        first, last = max(near - _AROUND, 0), min(near + _AROUND, len(film.frames) - 1)
        links = {k: background(follow(film.frames[k], film.frames[k + 1])) for k in range(first, last)}
        while near > first and all(links[k].joined for k in range(first, near)) is False:
            first += 1
        while last > near and all(links[k].joined for k in range(near, last)) is False:
            last -= 1
        times = film.times_s[first : last + 1]
        if len(times) < _FEWEST or np.diff(times).min() <= 0:
            return None
        starts = (times - times[0]) / np.median(np.diff(times))
        pairs = [links[k].tracks for k in range(first, last)]
        return cls(first, film.frames[first : last + 1], starts.tolist(), pairs)

    def ratio(self, focal_px: float) -> ReadoutRatio | None:
        """Returns the frames' readout ratio, the usual one if they do not reveal it, or None if they contradict any.

        Args:
            focal_px: focal length [px of ROWS rows].
        """
        try:
            return ratio_from_motion(self.pairs, focal_px)
        except UnknownRatioError as error:
            return None if error.reason.code is Code.SHOOK_TOO_FAST else _USUAL_RATIO

    def frames(self, focal_px: float, ratio: ReadoutRatio) -> Frames:
        """Fits the camera's rotation to the frames.

        Args:
            focal_px: focal length [px of ROWS rows].
            ratio: their readout ratio.
        """
        height, width = self.greys[0].shape
        fit = steady(Problem([fewer(pair) for pair in self.pairs], focal_px, self.starts), ratio.value, None)
        return Frames(fit, np.array(self.starts), ratio.value, height, width)


# ---- plausibility --------------------------------------------------------------------------------------------


def _judged(view: View, frames: Frames, fit: StillFit, ratio: ReadoutRatio) -> FilmEvidence:
    """Returns the motion of the photo, or why it is rejected, for instance because the film was stabilised."""
    at, off_px = _nearest(frames, fit)
    shape = _shape(frames)
    rate = ((frames.path(np.array([at + _STEP])) - frames.path(np.array([at - _STEP])))[0] / (2 * _STEP)) * shape
    turned = fit.turn[1] * shape
    readout = np.clip(rate @ turned / max(rate @ rate, 1e-9), *_RATIOS)
    against = float(np.linalg.norm(turned - readout * rate))
    if np.hypot(off_px / _OFF_PX, against / (_AGAINST_PX + _AGAINST_SHARE * np.linalg.norm(turned))) > 1:
        return FilmEvidence(reason=Reason(Code.FILM_STABILISED))
    rows = (np.arange(view.height) + 0.5) / view.height
    turns = fit.rotation(rows)
    turns = turns - turns[0]
    size = float(np.linalg.norm(turns * shape, axis=1).mean())
    if size < _LEAST_PX:
        return FilmEvidence(view.no_motion(NAME, Reason(Code.FILM_STOOD_STILL)))
    motion = view.rotation_motion(turns / frames.fit.focal_px, NAME)
    if motion.is_zero:  # the fitted motion would fold the picture
        return FilmEvidence(reason=Reason(Code.FILM_DIFFERS))
    errors = [*(fit.error[1] * shape), ratio.error * np.linalg.norm(rate), against]  # of the last row
    error = np.hypot(np.linalg.norm(errors) / 2, _SYSTEMATIC_PX)
    right = math.erf(max(_RIGHT_PX, _RIGHT_SHARE * size) / (math.sqrt(2) * float(error)))
    return FilmEvidence(replace(motion, confidence=right))


def _nearest(frames: Frames, fit: StillFit) -> tuple[float, float]:
    """Returns the time [frame intervals] at which the path is closest to the photo, and the distance [px of ROWS]."""
    times = np.arange(frames.times[0], frames.times[-1] + 1, _STEP)
    off = np.linalg.norm((frames.path(times) - fit.turn[0]) * _shape(frames), axis=1)
    return float(times[off.argmin()]), float(off.min())


def _shape(frames: Frames) -> np.ndarray:
    """[3] displacement in the picture per unit of rotation about each axis; at the picture's edge for the z axis."""
    return np.array([1.0, 1.0, ROWS / 2 / frames.fit.focal_px])
