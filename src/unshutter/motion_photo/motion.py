"""A photo's motion by its film, or that it stood still; where the film was stabilised, nothing."""

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
_AROUND, _FEWEST = 30, 6  # frames on both sides of the photo that count; those without which a film says nothing
_MATCHED = 2  # frames on both sides that the photo is compared with
_USUAL_RATIO = ReadoutRatio(0.6, 0.2, "what is usual")  # of phones' films
_LEAST_RATIO = 0.12  # frames that are read out faster than this were rectified by the phone
_LEAST_PX = 0.25  # px of ROWS rows, mean over the photo: less is none
_OFF_PX = 1.5  # px of ROWS rows by which the photo may lie beside the path of a film that was not stabilised
_AGAINST_PX, _AGAINST_SHARE = 0.8, 0.1  # by which its rate may differ from the path's; and share of it
_RATIOS = (0.05, 2.0)  # readout times of photos [frame intervals]
_STEP = 0.05  # frame intervals
_SYSTEMATIC_PX = 0.08  # px of ROWS rows: lens corrections, and whatever else is no motion
_RIGHT_PX, _RIGHT_SHARE = 1.0, 0.1  # a motion is right to so many px of ROWS rows, or that share of it


@dataclass(frozen=True)
class FilmEvidence:
    """What the film of a photo says.

    Attributes:
        motion: the photo's motion, zero with a reason where it stood still; None: the film says nothing.
        reason: why it says nothing; None where it says something.
    """

    motion: Motion | None = None
    reason: Reason | None = None


def film_motion(view: View) -> FilmEvidence | None:
    """What the film of a photo says of its motion; None where the photo has no film that can be read.

    Raises:
        UnshutterError: the photo is damaged or gone.
    """
    place = view.photo.film()
    film = None if place is None else decoded(place)
    if film is None:
        return None
    try:
        return motion_by(film, view)
    except (cv2.error, np.linalg.LinAlgError):  # frames that show nothing, or noise
        return FilmEvidence(reason=Reason(Code.FILM_DIFFERS))


def motion_by(film: Film, view: View) -> FilmEvidence:
    """What a film says of a photo's motion.

    Args:
        film: frames around the photo's moment.
        view: the photo, and what is known of its camera.
    """
    height, width = film.frames[0].shape
    if len(film.frames) < _FEWEST or height > width:  # set upright: its rows are not those of the sensor
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
    if fit is not None and abs((at := _nearest(frames, fit)[0]) - near) > _MATCHED:  # the photo's moment is elsewhere
        near = int(np.clip(round(at), 0, len(run.greys) - 1))
        fit = still.fit(frames, run, near) or fit
    if fit is None:
        return FilmEvidence(reason=Reason(Code.FILM_DIFFERS))
    return _judged(view, frames, fit, ratio)


# ---- the photo in the film -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Still:
    """A photo as it lies in its film.

    Attributes:
        copy: grey, in the readout frame.
        placement: of it.
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
        """The photo found in one of the frames; None where it is not."""
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
        """The turn of its rows, by the frames about one of them; None where it is found in too few."""
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
    """Frames of one shot about the photo's moment.

    Attributes:
        first: number of the first in the film.
        greys: the frames.
        starts: when they were taken [usual frame intervals since the first].
        pairs: tracks of the background from each to the next.
    """

    first: int
    greys: list[UInt8[np.ndarray, "height width"]]
    starts: list[float]
    pairs: list[Tracks]

    @classmethod
    def around(cls, film: Film, near: int) -> _Run | None:
        """The frames about one of them that hang together; None where they are too few."""
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
        """Their readout ratio, if they show none the usual one; None where they contradict any.

        Args:
            focal_px: focal length [px of ROWS rows].
        """
        try:
            return ratio_from_motion(self.pairs, focal_px)
        except UnknownRatioError as error:
            return None if error.reason.code is Code.SHOOK_TOO_FAST else _USUAL_RATIO

    def frames(self, focal_px: float, ratio: ReadoutRatio) -> Frames:
        """What they say of the camera.

        Args:
            focal_px: focal length [px of ROWS rows].
            ratio: their readout ratio.
        """
        height, width = self.greys[0].shape
        fit = steady(Problem([fewer(pair) for pair in self.pairs], focal_px, self.starts), ratio.value, None)
        return Frames(fit, np.array(self.starts), ratio.value, height, width)


# ---- is it to be believed? -----------------------------------------------------------------------------------


def _judged(view: View, frames: Frames, fit: StillFit, ratio: ReadoutRatio) -> FilmEvidence:
    """The motion of a photo whose film was not stabilised."""
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
    if motion.is_zero:  # what fits would fold the picture
        return FilmEvidence(reason=Reason(Code.FILM_DIFFERS))
    errors = [*(fit.error[1] * shape), ratio.error * np.linalg.norm(rate), against]  # of the last row
    error = np.hypot(np.linalg.norm(errors) / 2, _SYSTEMATIC_PX)
    right = math.erf(max(_RIGHT_PX, _RIGHT_SHARE * size) / (math.sqrt(2) * float(error)))
    return FilmEvidence(replace(motion, confidence=right))


def _nearest(frames: Frames, fit: StillFit) -> tuple[float, float]:
    """The moment at which the path comes nearest to the photo [frame intervals], and how near [px of ROWS rows]."""
    times = np.arange(frames.times[0], frames.times[-1] + 1, _STEP)
    off = np.linalg.norm((frames.path(times) - fit.turn[0]) * _shape(frames), axis=1)
    return float(times[off.argmin()]), float(off.min())


def _shape(frames: Frames) -> np.ndarray:
    """[3] what turns about the three axes do to a picture, at its edge for the third."""
    return np.array([1.0, 1.0, ROWS / 2 / frames.fit.focal_px])
