"""The first pass over a clip whose camera path is smoothed; it determines the stabilised views for the second pass."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import replace

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.timing import SHARES
from unshutter.gyro.gravity import has_gravity, up_directions
from unshutter.progress import Steps, Watch
from unshutter.video.camera_path import CameraPath
from unshutter.video.clip import Clip, SidePacket
from unshutter.video.clip_gyro import ClipGyro
from unshutter.video.moving_frames import MovingFrame
from unshutter.video.options import RectifyClip
from unshutter.video.pipeline import Pipeline
from unshutter.video.stabilisation import stabilised


def with_steady_views(pipeline: Pipeline, gyro: ClipGyro | None, watch: Watch | None) -> Pipeline:
    """Returns the steps for stabilising a clip, after a first pass that determines the camera's path.

    Raises:
        UsageError: the horizon is to be levelled, but no log contains acceleration.
        UnshutterError: the camera's rotation between frames is unknown.
    """
    clip, options, readout = pipeline.clip, pipeline.options, pipeline.readout
    if options.steadiness.level:
        _check_gravity(gyro)
    path = CameraPath(options.undo, readout, *readout.frame_size(clip.height, clip.width))
    with closing(pipeline.moving()) as items:
        for moving in watched(items, clip, options, watch):
            path.add(moving.motion, moving.step, moving.cut, moving.frame.time or 0.0)
    if pipeline.file_motion is not None and not any(map(path.step, range(len(path)))):
        raise UnshutterError(
            f"{options.motion} does not say how the camera turned between frames: it is of an earlier version; "
            "write it again with --save-motion"
        )
    up = None
    if options.steadiness.level and pipeline.gyro is not None:
        up = up_directions(pipeline.gyro, np.array(path.times_s), SHARES[options.undo.reference])
    return replace(pipeline, stabilisation=stabilised(path, options.steadiness, clip.interval_s, up))


def _check_gravity(gyro: ClipGyro | None) -> None:
    """Raises UsageError unless a gyro log gives the direction of gravity."""
    if gyro is None:
        raise UsageError("--level needs a gyro log with acceleration, and the clip has no log: name one with --gyro")
    if gyro.turns is None:
        raise UsageError(f"--level needs the clip's gyro log ({gyro.origin}), which cannot be used: {gyro.reason}")
    if not has_gravity(gyro.turns):
        raise UsageError(f"--level needs acceleration, which the gyro log ({gyro.origin}) does not have")


def watched(
    items: Generator[MovingFrame | SidePacket], clip: Clip, options: RectifyClip, watch: Watch | None
) -> Iterator[MovingFrame]:
    """Yields the frames among the items, reporting progress for each."""
    steps = Steps("looking", clip.expected_frames(options.start, options.end), watch)
    for item in items:
        if not isinstance(item, SidePacket):
            steps.advance()
            yield item
