"""Writes previews of clips: some frames before and after, as a picture, or a short video of both."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from unshutter.frames.pyav import av
from unshutter.photo import Photo
from unshutter.photo.photo import PREVIEW
from unshutter.storage.files import written_whole
from unshutter.video.file.clip_facts import ClipFacts, read_clip_facts
from unshutter.video.file.pixels import in_srgb, upright
from unshutter.video.file.video_writer import USUAL, writing

if TYPE_CHECKING:
    from av import VideoFrame

    from unshutter.motion.shapes import UInt8

_MOMENTS = 5
_WIDTH = 640  # px, of each half
_LONGEST_S = 10.0


def write_preview(
    path: Path, before: ClipFacts, after: str, start_s: float | None, frames: int, overwrite: bool
) -> None:
    """Writes a preview of a rectified clip.

    Args:
        start_s: time in the original at which the rectified part begins [s]; None if it is the whole clip.
        frames: number of frames in the rectified file.
    """
    both = zip(before.frames_between(start_s or None), read_clip_facts(after).frames_between(), strict=False)
    pairs = (np.concatenate([_small_picture(one), _small_picture(other)], axis=1) for one, other in both)
    if path.suffix.lower() not in USUAL:
        moments = {round(k * (frames - 1) / (_MOMENTS - 1)) for k in range(_MOMENTS)}
        rows = [pair for k, pair in enumerate(pairs) if k in moments]
        Photo.from_array(np.concatenate(rows), software=PREVIEW).save(path, quality=90, overwrite=overwrite)
        return
    with written_whole(path, overwrite) as part, writing(part, path.suffix) as container:
        first = islice(pairs, round(_LONGEST_S / before.interval_s))
        encode_pairs(container, first, before.interval_s, "libx264", {"crf": "20", "preset": "fast"})


def _small_picture(frame: VideoFrame) -> UInt8[np.ndarray, "height width 3"]:
    """Returns a frame upright and small, in RGB."""
    height = 2 * round(_WIDTH * frame.height / frame.width / 2)
    return upright(in_srgb(frame, _WIDTH, height), frame)


def encode_pairs(
    container: Any, pairs: Iterable[np.ndarray], interval_s: float, encoder: str, options: dict[str, str]
) -> None:
    """Encodes pictures uint8 [H, W, 3], all of one size, into a container that is open for writing."""
    stream = None
    for pair in pairs:
        if stream is None:
            rate = Fraction(1 / interval_s).limit_denominator(1001)
            stream = container.add_stream(encoder, rate=rate, options=options)
            stream.height, stream.width, stream.pix_fmt = *pair.shape[:2], "yuv420p"
        container.mux(stream.encode(av().VideoFrame.from_ndarray(pair, format="rgb24")))
    if stream is not None:
        container.mux(stream.encode(None))
