"""Sets up the estimation of a camera's path over a clip: small copies of frames, in windows that fit into memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from unshutter.frames.frame_motion import FrameMotion
from unshutter.frames.self_calibration import GreyFrame
from unshutter.frames.sequence import CameraMotion, Window
from unshutter.motion.finding import Finding
from unshutter.readout_time import ReadoutTime
from unshutter.video.calibrate.sampled_frames import COPY_SIDE, SampledFrames
from unshutter.video.calibrate.scene_check import SceneCheck
from unshutter.video.file.camera_clock import Changes
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.pixels import Frame
from unshutter.video.file.row_samples import GYRO_ROWS, ROWS
from unshutter.video.file.stages import Stage
from unshutter.video.gyro.synchronisation import GyroRotations

_WAITING = (8, 56)  # fewest and most frames awaiting their motion: those of a window, and of its margin ahead


def window_for(size: float) -> Window:
    """Returns the window for estimating motion that memory allows for a frame size [bytes]."""
    waiting = int(min(max(72_000_000 / size, _WAITING[0]), _WAITING[1]))
    ahead = min(Window.ahead, max(2 * waiting // 5, 4))
    return Window(core=waiting - ahead, ahead=ahead)


def camera_motion(
    request: ClipRequest,
    time: ReadoutTime,
    gyro_rotations: GyroRotations | None = None,
    focal_px: float | None = None,
    stage: Stage = Stage.FIT,
) -> CameraMotion:
    """Returns the estimator of the motion of a clip's frames; see :func:`with_motion` and :class:`CameraMotion`.

    Args:
        stage: as what its fits are counted.
    """
    focal_px = focal_px or (request.focal and request.focal * request.frame_size[0])
    if focal_px is None and gyro_rotations is not None:
        focal_px = gyro_rotations.focal_px(request.frame_size[0])
    return CameraMotion(
        ratio=time.ratio(request.clip.camera_interval_s),
        focal_px=focal_px,
        scan_direction=request.scan_direction,
        window=window_for(request.clip.frame_bytes),
        fewest=8,  # frames of a shot: shorter ones are usually errors, not cuts
        known_rotations=gyro_rotations,
        whole_path=True,
        lens=request.lens,
        check=SceneCheck.of(time, request.clip.camera_interval_s),
        count=request.work.counts(stage),
    )


def grey_copies(
    request: ClipRequest, frames: Iterable[Frame], sampled: SampledFrames | None = None
) -> Iterator[GreyFrame | None]:
    """Yields the small copies of frames in which corners are tracked, and None where frames are missing.

    Args:
        sampled: frames whose corners were tracked before; these have no copy unless the next frame needs one.
    """
    known = {} if sampled is None else sampled.by_time
    last = set() if sampled is None else {part[-1].time_s for part in sampled.parts}
    nothing = np.zeros((0, 0), np.uint8)
    before = None
    repeats = request.clip.clock.repeats
    changes = Changes(request.clip.clock)
    for frame in frames:
        time_s = request.clip.camera_time(frame)
        grey = request.grey(frame, COPY_SIDE) if repeats else nothing
        if repeats and changes.is_repeated(grey):
            yield GreyFrame(*request.frame_size, grey, after=0.0, time_s=time_s)
            continue
        since = request.clip.since(before, frame)
        if since is None:
            yield None
        tracked = None if before is None else known.get(time_s)
        if not repeats:
            grey = request.grey(frame, COPY_SIDE) if tracked is None or time_s in last else nothing
        after = 1.0 if since is None else since
        followed = (None, None) if tracked is None else (tracked.tracks, tracked.background)
        yield GreyFrame(*request.frame_size, grey, after, 0.0, time_s, *followed)
        before = frame


def small_finding(motion: FrameMotion) -> Finding:
    """Returns a frame's motion for a picture of ``ROWS`` rows, or ``GYRO_ROWS`` with a gyro."""
    rows = ROWS if motion.rotations is None else GYRO_ROWS
    width = max(1, round(motion.width * rows / motion.height))
    return replace(motion, height=rows, width=width).finding()
