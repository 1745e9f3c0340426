"""Job on a clip: a short, small preview with before and after side by side, so that the page plays them in sync."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.geometry.readout import Readout
from unshutter.serve.jobs.cache import OpenFile, digest, errors_of
from unshutter.serve.jobs.clip import camera_of, moment_time, ratio_of, upright_pixels
from unshutter.video.containers import av
from unshutter.video.options import RectifyClip

if TYPE_CHECKING:
    import numpy as np

    from unshutter.geometry.shapes import UInt8
    from unshutter.video.clip import Clip

LONGEST_S = 8.0
_SIDE = 640  # px, longer side of either half
_MOST_FRAMES = 480
_QUALITY = "22"  # constant quality at any bit rate: with a fixed bit rate, VP9's fastest setting shows blocks


def film(open_file: OpenFile, options: RectifyClip, moment: int) -> Path:
    """Returns the path of a WebM film around a moment, with each frame before (left) and after (right), upright.

    Args:
        open_file: the clip.
        options: options of the clip; the film always uses the camera's motion model, keeps edges that would be
            cropped, and does not smooth the camera's path.
        moment: index of the moment, from 0.

    Raises:
        UsageError, UnshutterError: the options do not fit the clip, or its readout time is unknown.
    """
    from unshutter.video.clip import Clip

    with errors_of(open_file):
        clip = Clip.look(open_file.path)
        file = open_file.path.with_name(f"film-{digest(options, moment)}.webm")
        if not file.exists():
            part = file.with_name(f"{os.getpid()}-{file.name}")  # the suffix determines the format
            _write(part, _pairs(open_file, clip, options, moment), 1 / clip.interval_s)
            os.replace(part, file)
        return file


def _pairs(
    open_file: OpenFile, clip: Clip, options: RectifyClip, moment: int
) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """Yields small frames around a moment, before and after side by side."""
    import numpy as np

    from unshutter.video.frame_warper import Warper
    from unshutter.video.moving_frames import MovingFrame, with_motion
    from unshutter.warp.pixels import straighten

    ratio = ratio_of(open_file, clip, options)
    readout = Readout.parse(options.shutter.readout)
    edges = "keep" if options.undo.edges in ("keep", "crop") else "fill"
    warper = Warper(clip, replace(options.undo, model="camera", edges=edges))
    start_s, end_s = options.span(clip.duration_s)
    first = max(moment_time(clip, options, moment) - LONGEST_S / 2, start_s)
    count = min(round(min(LONGEST_S, end_s - first) / clip.interval_s), _MOST_FRAMES)
    frames = islice(clip.iter_frames(first), max(count, 1))
    for moving in with_motion(clip, frames, camera_of(clip, options, ratio)):
        if isinstance(moving, MovingFrame):
            scale = min(_SIDE / max(moving.frame.height, moving.frame.width), 1.0)
            height, width = (2 * max(round(side * scale / 2), 1) for side in (moving.frame.height, moving.frame.width))
            before = moving.frame.reformat(width, height, format="rgb24").to_ndarray()
            motion = warper.motion(moving).resized(*readout.frame_size(height, width))
            after = straighten(before, motion, edges).pixels
            turned = [upright_pixels(each, moving.frame) for each in (before, after)]
            yield np.concatenate(turned, axis=1)


def _write(file: Path, pairs: Iterator[UInt8[np.ndarray, "height width 3"]], rate: float) -> None:
    # a sixth of the work of VP8's fastest setting; keyframes are frequent enough for scrubbing
    settings = {"deadline": "realtime", "cpu-used": "8", "row-mt": "1", "g": "15", "crf": _QUALITY}
    with av().open(str(file), "w", format="webm") as container:
        stream = None
        for pair in pairs:
            if stream is None:
                stream = container.add_stream(
                    "libvpx-vp9", rate=Fraction(rate).limit_denominator(1001), options=settings
                )
                stream.bit_rate = 0
                stream.height, stream.width, stream.pix_fmt = *pair.shape[:2], "yuv420p"
            container.mux(stream.encode(av().VideoFrame.from_ndarray(pair, format="rgb24")))
        if stream is not None:
            container.mux(stream.encode(None))
