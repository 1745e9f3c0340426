"""unshutter removes rolling-shutter distortion from photos and video.

import unshutter
unshutter.rectify("street.jpg").save("street.rectified.jpg")
motion = unshutter.estimate("street.jpg")
"""

from typing import TYPE_CHECKING

from unshutter.errors import MissingFileError, UnshutterError, UsageError
from unshutter.version import __version__

if TYPE_CHECKING:
    from unshutter.estimators.base import Estimator, View
    from unshutter.estimators.method import Method
    from unshutter.estimators.register import load
    from unshutter.estimators.right_angles.drawn_lines import DrawnLine
    from unshutter.frames.frame import RectifiedFrame
    from unshutter.frames.sequence import estimate_frames
    from unshutter.frames.sequence_rectification import rectify_frames
    from unshutter.geometry.readout import Readout
    from unshutter.motion import Motion, RotationMotion, RowMapMotion, RowMotion
    from unshutter.motion.candidate import Candidate
    from unshutter.photo import Photo
    from unshutter.rectification import candidates, estimate, rectified, rectify
    from unshutter.result import Rectified
    from unshutter.video.clip_functions import rectify_clip, rectify_clip_frames
    from unshutter.video.outcome import ClipOutcome

__all__ = [
    "Candidate",
    "ClipOutcome",
    "DrawnLine",
    "Estimator",
    "Method",
    "MissingFileError",
    "Motion",
    "Photo",
    "Readout",
    "Rectified",
    "RectifiedFrame",
    "RotationMotion",
    "RowMapMotion",
    "RowMotion",
    "UnshutterError",
    "UsageError",
    "View",
    "__version__",
    "candidates",
    "estimate",
    "estimate_frames",
    "load",
    "rectified",
    "rectify",
    "rectify_clip",
    "rectify_clip_frames",
    "rectify_frames",
]

_HOMES = {
    "ClipOutcome": "video.outcome",
    "Candidate": "motion.candidate",
    "DrawnLine": "estimators.right_angles.drawn_lines",
    "Estimator": "estimators.base",
    "Method": "estimators.method",
    "Motion": "motion",
    "Photo": "photo",
    "Readout": "geometry.readout",
    "Rectified": "result",
    "RectifiedFrame": "frames.frame",
    "RotationMotion": "motion",
    "RowMapMotion": "motion",
    "RowMotion": "motion",
    "View": "estimators.base",
    "candidates": "rectification",
    "estimate": "rectification",
    "estimate_frames": "frames.sequence",
    "load": "estimators.register",
    "rectified": "rectification",
    "rectify": "rectification",
    "rectify_clip": "video.clip_functions",
    "rectify_clip_frames": "video.clip_functions",
    "rectify_frames": "frames.sequence_rectification",
}


def __getattr__(name: str) -> object:
    """Imports public names on first use, to keep ``import unshutter`` fast."""
    if name not in _HOMES:
        raise AttributeError(f"module 'unshutter' has no attribute '{name}'")
    from importlib import import_module

    value = getattr(import_module(f"unshutter.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
