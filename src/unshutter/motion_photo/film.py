"""Decodes the frames of a photo's film around the photo's time as small grey copies."""

from __future__ import annotations

import io
import os
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from unshutter.frames.tracks import TRACKED_SIDE

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64, UInt8
    from unshutter.photo.film import PhotoFilm

_IDENTIFIER = "com.apple.quicktime.content.identifier"
_MOST_FRAMES = 120  # decoded at most
_ABOUT_S = 1.2  # before and after the photo's time; frames farther away are ignored
_KINDS = "mov,mp4,m4a,3gp,3g2,mj2"  # FFmpeg's names of the file formats accepted
_LARGEST_FRAME = 1 << 24  # px


@dataclass(frozen=True, eq=False)
class Film:
    """Frames around the time of a photo.

    Attributes:
        frames: grey copies of the stored frames.
        times_s: time of each frame [s].
        moment_s: time of the photo on the film's clock [s]; None if unknown.
    """

    frames: list[UInt8[np.ndarray, "height width"]]
    times_s: Float64[np.ndarray, "frames"]
    moment_s: float | None = None


def decoded(film: PhotoFilm) -> Film | None:
    """Decodes the frames of a film; returns None if it is unreadable, belongs to another photo, or PyAV is missing."""
    os.environ.setdefault("SVT_LOG", "1")  # silences an encoder that writes to standard error
    try:
        import av
        from av import error as av_error
        from av import logging
    except ImportError:
        return None
    logging.set_level(None)
    source = io.BytesIO(film.place) if isinstance(film.place, bytes) else str(film.place.absolute())
    frames, times = [], []
    with suppress(av_error.FFmpegError, OSError, ValueError, EOFError):
        options = {"format_whitelist": _KINDS, "max_pixels": str(_LARGEST_FRAME)}
        with av.open(source, options=options, metadata_errors="replace") as container:
            if film.identifier and container.metadata.get(_IDENTIFIER) != film.identifier:
                return None
            for frame in _frames(container, film.moment_s):
                frames.append(_grey(frame))
                times.append(frame.time)
                if len(frames) == _MOST_FRAMES:
                    break
    return Film(frames, np.array(times), film.moment_s) if frames else None


def _frames(container: Any, moment_s: float | None) -> Any:
    """Yields the frames around a moment from the longest video stream of a container."""
    films = [stream for stream in container.streams.video if stream.codec_context is not None]
    if not films:
        return
    film = max(films, key=lambda each: each.frames)  # some phones store a sharper copy of the photo in a second one
    film.thread_type = "AUTO"
    for frame in container.decode(film):
        if frame.time is None or (moment_s is not None and frame.time < moment_s - _ABOUT_S):
            continue
        if moment_s is not None and frame.time > moment_s + _ABOUT_S:
            return
        yield frame


def _grey(frame: Any) -> np.ndarray:
    """Returns the small grey copy in which corners are tracked."""
    shrink = max(min(frame.height, frame.width) / TRACKED_SIDE, 1.0)
    size = {"width": round(frame.width / shrink), "height": round(frame.height / shrink)}
    return frame.to_ndarray(format="gray", interpolation="AREA", **size)
