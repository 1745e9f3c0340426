"""Estimates a photo's motion from the video embedded in it; rejects stabilised videos."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from unshutter.errors import UnknownRatioError, UnshutterError
from unshutter.frames import pyav
from unshutter.frames.camera import ROWS, Problem, steady
from unshutter.frames.registration import VIDEO, Frames, Matches, StillFit, fit_still, matches, placement
from unshutter.frames.self_calibration import fewer, ratio_from_motion
from unshutter.frames.tracks import TRACKED_SIDE, Tracks, background, follow
from unshutter.motion.finding import Finding
from unshutter.motion.verdict import probability_better
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutRatio, ReadoutSource
from unshutter.reasons import Code, MotionSource, Reason
from unshutter.single.estimator import View

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer

    from unshutter.motion.shapes import Float64, UInt8
    from unshutter.photo.embedded_video import EmbeddedVideo


_IDENTIFIER = "com.apple.quicktime.content.identifier"
_KINDS = "mov,mp4,m4a,3gp,3g2,mj2"  # FFmpeg's names of the file formats accepted


@dataclass(frozen=True, eq=False)
class DecodedVideo:
    """Frames around the time of a photo."""

    frames: list[UInt8[np.ndarray, "height width"]]  # grey copies of the stored frames
    times_s: Float64[np.ndarray, "frames"]  # time of each frame [s]
    moment_s: float | None = None  # time of the photo on the video's clock [s]; None if unknown


def decode_embedded_video(video: EmbeddedVideo) -> DecodedVideo | None:
    """Decodes the frames of a video; returns None if it is unreadable, belongs to another photo, or PyAV is missing."""
    try:
        av_error = pyav.av().error.FFmpegError
    except UnshutterError:
        return None
    source = io.BytesIO(video.place) if isinstance(video.place, bytes) else str(video.place.absolute())
    frames = []
    times = []
    with suppress(av_error, OSError, ValueError, EOFError):
        options = {"format_whitelist": _KINDS, "max_pixels": str(VIDEO.largest_frame)}
        with pyav.open_to_read(source, options=options) as container:
            if video.identifier and container.metadata.get(_IDENTIFIER) != video.identifier:
                return None
            for frame in _frames(container, video.moment_s):
                shrink = max(min(frame.height, frame.width) / TRACKED_SIDE, 1.0)
                width, height = round(frame.width / shrink), round(frame.height / shrink)
                frames.append(frame.to_ndarray(format="gray", interpolation="AREA", width=width, height=height))
                times.append(frame.time)
                if len(frames) == VIDEO.most_frames:
                    break
    return DecodedVideo(frames, np.array(times), video.moment_s) if frames else None


def _frames(container: InputContainer, moment_s: float | None) -> Iterator[VideoFrame]:
    """Yields the frames around a moment from the longest video stream of a container."""
    videos = [stream for stream in container.streams.video if stream.codec_context is not None]
    if not videos:
        return
    video = max(videos, key=lambda each: each.frames)  # some phones store a sharper copy of the photo in a second one
    video.thread_type = "AUTO"
    tick_s = video.time_base or 1
    if moment_s is not None and moment_s > VIDEO.long_s:
        if video.duration and moment_s > ((video.start_time or 0) + video.duration) * tick_s + VIDEO.about_s:
            return
        container.seek(int((moment_s - VIDEO.about_s - 1) / tick_s), stream=video)
    for number, frame in enumerate(container.decode(video)):
        if number > VIDEO.most_before + VIDEO.most_frames:
            return
        if frame.time is None or (moment_s is not None and frame.time < moment_s - VIDEO.about_s):
            continue
        if moment_s is not None and frame.time > moment_s + VIDEO.about_s:
            return
        yield frame


NAME = "film"
_USUAL_RATIO = ReadoutRatio(0.6, 0.2, ReadoutSource.USUAL)  # typical of phones' videos


def motion_by_embedded_video(view: View) -> Finding | Reason | None:
    """Estimates a photo's motion from its video.

    Returns:
        The motion, zero with a reason if the camera stood still; a reason if the video is inconclusive; None if the
        photo has no readable video.
    """
    place = view.photo.embedded_video()
    video = None if place is None else decode_embedded_video(place)
    if video is None:
        return None
    try:
        return motion_by(video, view)
    except (cv2.error, np.linalg.LinAlgError):  # blank or noisy frames
        return Reason(Code.EMBEDDED_VIDEO_DIFFERS)


def motion_by(video: DecodedVideo, view: View) -> Finding | Reason:
    """Estimates a photo's motion from a video; returns a reason if the video is inconclusive."""
    height, width = video.frames[0].shape
    if len(video.frames) < VIDEO.min_frames or height > width:  # rotated upright: its rows are not those of the sensor
        return Reason(Code.EMBEDDED_VIDEO_TOO_SHORT)
    still = _Still.of(view, video)
    if still is None:
        return Reason(Code.EMBEDDED_VIDEO_DIFFERS)
    view = replace(view, camera=replace(view.camera, readout=still.scan_direction.value))
    run = _Run.around(video, still.near)
    if run is None:
        return Reason(Code.EMBEDDED_VIDEO_TOO_SHORT)
    focal = still.focal_px * ROWS / height
    ratio = run.ratio(focal)
    if ratio is None or ratio.value < VIDEO.least_ratio:
        return Reason(Code.EMBEDDED_VIDEO_STABILISED)
    frames = run.frames(focal, ratio)
    near = still.near - run.first
    fit = still.fit(frames, run, near)
    if fit is not None and abs((at := _nearest(frames, fit)[0]) - near) > VIDEO.matched:  # taken at another time
        near = int(np.clip(round(at), 0, len(run.greys) - 1))
        fit = still.fit(frames, run, near) or fit
    if fit is None:
        return Reason(Code.EMBEDDED_VIDEO_DIFFERS)
    return _judged(view, frames, fit, ratio)


# ---- the photo within the video -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Still:
    """A photo located within its video."""

    copy: UInt8[np.ndarray, "rows columns"]  # grey copy in the readout frame
    scale: float  # px of the video per px of that copy
    near: int  # number of the frame in which it was found
    scan_direction: ScanDirection  # of the stored photo, if the video's rows are those of the sensor
    focal_px: float  # focal length [px of the video's copies]

    @classmethod
    def of(cls, view: View, video: DecodedVideo) -> _Still | None:
        """Locates the photo in one of the frames; returns None if it is not found."""
        stored = view.photo.grey(TRACKED_SIDE)
        last = len(video.frames) - 1
        middle = last / 2
        if video.moment_s is not None:
            middle = np.interp(video.moment_s, video.times_s, np.arange(last + 1))
        tried = dict.fromkeys(int(np.clip(round(at), 0, last)) for at in (middle, 0.75 * middle, middle + 0.25 * last))
        for near in tried:
            place = placement(stored, video.frames[near])
            if place is not None:
                break
        else:
            return None
        quarter_turns, scale = place
        scan_direction = next(each for each in ScanDirection if each.quarter_turns % 4 == quarter_turns)
        if view.camera.readout not in ("auto", scan_direction.value):
            return None
        copy = np.ascontiguousarray(scan_direction.to_scan_frame(stored))
        of_photo = scale * copy.shape[0] / scan_direction.frame_size(view.photo.height, view.photo.width)[0]
        return cls(copy, scale, near, scan_direction, view.focal_px() * of_photo)

    def fit(self, frames: Frames, run: _Run, near: int) -> StillFit | None:
        """Fits the rotation of the photo's rows from the frames around ``near``; None if found in fewer than two."""
        found: dict[int, Matches] = {}
        guess = np.zeros(3)
        unit = frames.height / ROWS
        focal = frames.fit.focal_px
        beside = [k for k in range(near - VIDEO.matched, near + VIDEO.matched + 1) if 0 <= k < len(run.greys)]
        path = frames.path(frames.times + frames.ratio / 2)
        for k in sorted(beside, key=lambda k: abs(k - near)):
            moved = path[k] - path[near]
            expected = guess + np.array([moved[1] * unit, -moved[0] * unit, moved[2] / focal])
            each = matches(self.copy, run.greys[k], self.scale, expected)
            if each is not None:
                found[k] = each
                if k == near:
                    guess = np.append(np.median(each.frame - each.photo, axis=0), 0.0)
        if len(found) < 2:
            return None
        return fit_still(frames, found, self.copy.shape[0] * self.scale)


# ---- the video ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Run:
    """Consecutive frames of one shot around the photo's time."""

    first: int  # number of the first of them in the video
    greys: list[UInt8[np.ndarray, "height width"]]  # the frames
    starts: list[float]  # times of the frames [usual frame intervals since the first]
    pairs: list[Tracks]  # tracks of the background from each frame to the next

    @classmethod
    def around(cls, video: DecodedVideo, near: int) -> _Run | None:
        """Returns the connected frames around ``near``, or None if there are too few."""
        first = max(near - VIDEO.around, 0)
        last = min(near + VIDEO.around, len(video.frames) - 1)
        links = {k: background(follow(video.frames[k], video.frames[k + 1])) for k in range(first, last)}
        while near > first and all(links[k].joined for k in range(first, near)) is False:
            first += 1
        while last > near and all(links[k].joined for k in range(near, last)) is False:
            last -= 1
        times = video.times_s[first : last + 1]
        if len(times) < VIDEO.min_frames or np.diff(times).min() <= 0:
            return None
        starts = (times - times[0]) / np.median(np.diff(times))
        pairs = [links[k].tracks for k in range(first, last)]
        return cls(first, video.frames[first : last + 1], starts.tolist(), pairs)

    def ratio(self, focal_px: float) -> ReadoutRatio | None:
        """Returns the frames' readout ratio, the usual one if they do not reveal it, or None if they contradict any."""
        try:
            return ratio_from_motion(self.pairs, focal_px)
        except UnknownRatioError as error:
            return None if error.reason.code is Code.SHOOK_TOO_FAST else _USUAL_RATIO

    def frames(self, focal_px: float, ratio: ReadoutRatio) -> Frames:
        """Fits the camera's rotation to the frames."""
        height, width = self.greys[0].shape
        problem = Problem([fewer(pair) for pair in self.pairs], focal_px, self.starts)
        fit = steady(problem.fit(ratio.value), problem, ratio.value)
        return Frames(fit, np.array(self.starts), ratio.value, height, width)


# ---- plausibility --------------------------------------------------------------------------------------------


def _judged(view: View, frames: Frames, fit: StillFit, ratio: ReadoutRatio) -> Finding | Reason:
    """Returns the motion of the photo, or why it is rejected, for instance because the video was stabilised."""
    at, off_px = _nearest(frames, fit)
    shape = _shape(frames)
    rate = (
        (frames.path(np.array([at + VIDEO.step])) - frames.path(np.array([at - VIDEO.step])))[0] / (2 * VIDEO.step)
    ) * shape
    rotated = fit.coefficients[1] * shape
    readout_ratio = np.clip(rate @ rotated / max(rate @ rate, 1e-9), *VIDEO.ratios)
    against = float(np.linalg.norm(rotated - readout_ratio * rate))
    if (
        np.hypot(off_px / VIDEO.off_px, against / (VIDEO.against_px + VIDEO.against_share * np.linalg.norm(rotated)))
        > 1
    ):
        return Reason(Code.EMBEDDED_VIDEO_STABILISED)
    rows = (np.arange(view.height) + 0.5) / view.height
    rotations = fit.rotation(rows)
    rotations = rotations - rotations[0]
    size = float(np.linalg.norm(rotations * shape, axis=1).mean())
    if size < VIDEO.least_px:
        still = view.no_motion(NAME, Reason(Code.EMBEDDED_VIDEO_STOOD_STILL))
        return replace(still, source=MotionSource.EMBEDDED_VIDEO)
    found = view.rotation_motion(rotations / frames.fit.focal_px, NAME)
    if found.motion.is_zero:  # the fitted motion would fold the picture
        return Reason(Code.EMBEDDED_VIDEO_DIFFERS)
    errors = [*(fit.error[1] * shape), ratio.error * np.linalg.norm(rate), against]  # of the last row
    error = np.hypot(np.linalg.norm(errors) / 2, VIDEO.systematic_px)
    better = probability_better(size, float(error))
    known = {"source": MotionSource.EMBEDDED_VIDEO, "confidence": better, "expected_error": float(error) / ROWS}
    return replace(found, **known)


def _nearest(frames: Frames, fit: StillFit) -> tuple[float, float]:
    """Returns the time [frame intervals] at which the path is closest to the photo, and the distance [px of ROWS]."""
    times = np.arange(frames.times[0], frames.times[-1] + 1, VIDEO.step)
    off = np.linalg.norm((frames.path(times) - fit.coefficients[0]) * _shape(frames), axis=1)
    return float(times[off.argmin()]), float(off.min())


def _shape(frames: Frames) -> np.ndarray:
    """[3] displacement in the picture per unit of rotation about each axis; at the picture's edge for the z axis."""
    return np.array([1.0, 1.0, ROWS / 2 / frames.fit.focal_px])
