"""Which description of the motion suits a frame: one motion of the camera, or every pixel's own.

Corners that are followed to the neighbours decide. Near and moving ones among them had no part in the camera's motion,
and the flow was found without any of them. Where the camera's motion leads them to their partners about as well as the
flow does, it is the better one: it is smooth over time, and says how the speed changes while a frame is read out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from unshutter.frames.camera import ROWS, turn_jacobian
from unshutter.frames.flow import Flow, bilinear
from unshutter.frames.sequence import FrameMotion
from unshutter.frames.tracks import Tracks

if TYPE_CHECKING:
    from unshutter.frames.frame import Frame
    from unshutter.options import FrameModel

_SHARE = 75  # per cent of the corners that must come out well
_LEAST, _WORSE = 0.1, 1.5  # px of ROWS rows by which the camera may always miss; times the flow's error besides
_FEWEST = 12  # corners


def better_model(camera: FrameMotion, before: Frame | None, current: Frame, after: Frame | None) -> FrameModel:
    """The model that suits a frame better. The flow is only looked for where the camera's motion leaves doubts.

    Args:
        camera: what is known of the camera's motion about the frame.
        before, current, after: the frame and its neighbours.

    Raises:
        UnshutterError: there is no motion of a camera, and too little flow (see :meth:`Frame.connect`).
    """
    if camera.fit is None:
        return "camera" if camera.stood_still else "dense"
    for first, earlier, later in ((-1, before, current), (0, current, after)):
        if earlier is None or later is None:
            continue
        tracks = earlier.tracks_to(later)
        missed = camera_misses(camera, tracks, first)
        if missed <= _LEAST:
            continue
        earlier.connect(later)
        if earlier.to_next is None or missed > _LEAST + _WORSE * flow_misses(earlier.to_next.flow, tracks):
            return "dense"
    return "camera"


def camera_misses(camera: FrameMotion, tracks: Tracks, first: int) -> float:
    """By how much most corners end elsewhere than the camera's motion says [px of ROWS rows].

    Args:
        camera: what is known of the camera's motion about the frame.
        tracks: of two successive frames, all that were found.
        first: number of the earlier frame, counted from that one.
    """
    if camera.fit is None or len(tracks) < _FEWEST:
        return np.inf
    unit = ROWS / tracks.height
    ends = (np.stack([tracks.start, tracks.end]) + 0.5) * unit
    rows = np.clip(ends[..., 1] / ROWS, 0, 1)
    turn = [camera.turn(first + k + camera.ratio * rows[k]) for k in (0, 1)]
    J_turn = turn_jacobian(ends.mean(axis=0), tracks.width * unit, camera.fit.focal_px)[..., :3]
    led = np.einsum("nij,nj->ni", J_turn, (turn[1] - turn[0]) * camera.fit.focal_px)
    return float(np.percentile(np.hypot(*(ends[1] - ends[0] - led).T), _SHARE))


def flow_misses(flow: Flow, tracks: Tracks) -> float:
    """By how much most corners end elsewhere than a flow says [px of ROWS rows]."""
    scale = flow.forward.shape[0] / tracks.height
    at = ((tracks.start + 0.5) * scale - 0.5).astype(np.float32)[:, None]
    led = bilinear(flow.forward, at)[:, 0] / scale
    return float(np.percentile(np.hypot(*(tracks.end - tracks.start - led).T), _SHARE)) * ROWS / tracks.height
