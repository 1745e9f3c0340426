"""Chooses between the camera's motion and a dense motion for a photo with neighbours.

Corners tracked to the neighbours decide. Those on near or moving objects did not contribute to the camera's motion, and
none of them contributed to the flow. If the camera's motion predicts their positions about as well as the flow does, it
is the better model: it is smooth over time and includes how the speed changes during the readout.
"""

from __future__ import annotations

import numpy as np

from unshutter.frames.camera import ROWS, rotation_jacobian
from unshutter.frames.flow import Flow, bilinear
from unshutter.frames.frame import Frame
from unshutter.frames.frame_motion import FrameMotion
from unshutter.frames.tracks import MIN_TRACKS, Tracks
from unshutter.options import FrameModel

_SHARE = 75  # percentile of the corners' errors that is compared
_LEAST, _WORSE = 0.1, 1.5  # error always allowed [px of ROWS rows]; plus this multiple of the flow's


def better_model(camera: FrameMotion, before: Frame | None, current: Frame, after: Frame | None) -> FrameModel:
    """Chooses the model that suits a frame better; computes optical flow only if the camera model may be poor."""
    pairs = [
        (first, earlier, later)
        for first, earlier, later in ((-1, before, current), (0, current, after))
        if earlier is not None and later is not None
    ]
    if camera.fit is None:
        if camera.stood_still:
            return "camera"
        for _, earlier, later in pairs:
            earlier.connect(later)
        # flow fits noise to noise, too: some corner must be found again
        return "dense" if any(len(earlier.tracks_to(later)) for _, earlier, later in pairs) else "camera"
    for first, earlier, later in pairs:
        tracks = earlier.tracks_to(later)
        missed = camera_misses(camera, tracks, first)
        if missed <= _LEAST or not tracks:  # where nothing can be followed, neither model is better
            continue
        earlier.connect(later)
        if earlier.to_next is None or missed > _LEAST + _WORSE * flow_misses(earlier.to_next.flow, tracks):
            return "dense"
    return "camera"


def camera_misses(camera: FrameMotion, tracks: Tracks, first: int) -> float:
    """Returns the 75th percentile of the corners' distance from the camera motion's prediction [px of ROWS rows].

    Args:
        first: number of the earlier frame, counted from ``camera``'s frame.
    """
    if camera.fit is None or len(tracks) < MIN_TRACKS:
        return np.inf
    unit = ROWS / tracks.height
    ends = (np.stack([tracks.start, tracks.end]) + 0.5) * unit
    rows = np.clip(ends[..., 1] / ROWS, 0, 1)
    rotation = [camera.rotation_between(first + k + camera.ratio * rows[k]) for k in (0, 1)]
    J_turn = rotation_jacobian(ends.mean(axis=0), tracks.width * unit, camera.fit.focal_px)[..., :3]
    led = np.einsum("nij,nj->ni", J_turn, (rotation[1] - rotation[0]) * camera.fit.focal_px)
    return float(np.percentile(np.hypot(*(ends[1] - ends[0] - led).T), _SHARE))


def flow_misses(flow: Flow, tracks: Tracks) -> float:
    """Returns the 75th percentile of the corners' distance from the flow's prediction [px of ROWS rows]."""
    scale = flow.forward.shape[0] / tracks.height
    at = ((tracks.start + 0.5) * scale - 0.5).astype(np.float32)[:, None]
    led = bilinear(flow.forward, at)[:, 0] / scale
    return float(np.percentile(np.hypot(*(tracks.end - tracks.start - led).T), _SHARE)) * ROWS / tracks.height
