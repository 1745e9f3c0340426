"""Previews with before and after side by side: a picture of five moments, or a short film."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.storage.files import written_whole
from unshutter.video.clip import Clip
from unshutter.video.containers import av
from unshutter.video.film_file import writing

if TYPE_CHECKING:
    from av import VideoFrame

    from unshutter.geometry.shapes import UInt8

_MOMENTS = 5
_WIDTH = 640  # px, of each half
_LONGEST_S = 10.0
_FILMS = (".mp4", ".mov", ".mkv")
_PICTURES = (".jpg", ".jpeg", ".png")


def check_ending(path: Path | None) -> None:
    """Raises UsageError if a preview is neither a picture nor a film."""
    if path is not None and path.suffix.lower() not in (*_FILMS, *_PICTURES):
        raise UsageError(f"a preview is a picture (.jpg, .png) or a film (.mp4), not {path.name}")


def write_preview(path: Path, before: Clip, after: str, start_s: float, frames: int, overwrite: bool) -> None:
    """Writes a preview of a rectified clip.

    Args:
        path: file to write.
        before: the original clip.
        after: the rectified file.
        start_s: time in the original at which the rectified part begins [s].
        frames: number of frames in the rectified file.
        overwrite: whether an existing file may be replaced.

    Raises:
        UnshutterError: the preview cannot be written.
    """
    pairs = _pairs(before, Clip.look(after, 1 / before.interval_s), start_s)
    with written_whole(path, overwrite) as part:
        if path.suffix.lower() in _FILMS:
            _film(part, path.suffix, islice(pairs, round(_LONGEST_S / before.interval_s)), before.interval_s)
        else:
            moments = {round(k * (frames - 1) / (_MOMENTS - 1)) for k in range(_MOMENTS)}
            rows = [pair for k, pair in enumerate(pairs) if k in moments]
            if not cv2.imwrite(str(part), np.concatenate(rows)[..., ::-1]):
                raise UnshutterError(f"cannot write {path}")


def _pairs(before: Clip, after: Clip, start_s: float) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """Yields frames of both clips, side by side."""
    for one, other in zip(before.iter_frames(start_s or None), after.iter_frames(), strict=False):
        yield np.concatenate([small_picture(one), small_picture(other)], axis=1)


def small_picture(frame: VideoFrame, turned_as: VideoFrame | None = None) -> UInt8[np.ndarray, "height width 3"]:
    """Returns a frame upright and small, in RGB.

    Args:
        frame: the frame as stored.
        turned_as: the frame that holds the rotation, if this one does not.
    """
    height = 2 * round(_WIDTH * frame.height / frame.width / 2)
    pixels = frame.reformat(width=_WIDTH, height=height, format="rgb24").to_ndarray()
    return np.ascontiguousarray(np.rot90(pixels, round((turned_as or frame).rotation / 90)))


def _film(part: Path, ending: str, pairs: Iterator[np.ndarray], interval_s: float) -> None:
    rate = Fraction(1 / interval_s).limit_denominator(1001)
    with writing(part, ending) as container:
        stream = None
        for pair in pairs:
            if stream is None:
                stream = container.add_stream("libx264", rate=rate, options={"crf": "20", "preset": "fast"})
                stream.height, stream.width, stream.pix_fmt = *pair.shape[:2], "yuv420p"
            container.mux(stream.encode(av().VideoFrame.from_ndarray(pair, format="rgb24")))
        if stream is not None:
            container.mux(stream.encode(None))
