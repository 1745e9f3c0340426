"""Removes rolling-shutter distortion from photos and video.

    import unshutter
    unshutter.rectify("street.jpg").save("street.rectified.jpg")
    found = unshutter.estimate("street.jpg")

Everything listed here is public; the modules that hold it are not.

One photo       rectify -> Rectified, estimate -> Finding, candidates -> Candidate, Photo, DrawnLine
Frames          rectify_frames -> RectifiedFrame, estimate_frames -> Finding
Clips           rectify_clip -> ClipOutcome, rectify_clip_frames -> arrays, measure_clips -> ClipMeasurement
3D models       camera_poses -> CameraPoses, which has PicturePoses
Motions         Motion: RowMotion, RotationMotion; ScanDirection; Finding, what is known of one
Methods         load -> Estimator, which gets a View; Method
Errors          UnshutterError: UsageError, MissingFileError
"""

from importlib import import_module
from typing import TYPE_CHECKING

from unshutter.errors import MissingFileError, UnshutterError, UsageError
from unshutter.version import __version__

if TYPE_CHECKING:
    from unshutter.api import candidates, estimate, rectify
    from unshutter.frames.sequence import estimate_frames
    from unshutter.motion import Motion, RotationMotion, RowMotion
    from unshutter.motion.finding import Candidate, Finding
    from unshutter.orientation import ScanDirection
    from unshutter.photo import Photo
    from unshutter.poses.camera_poses import CameraPoses
    from unshutter.poses.picture_poses import PicturePoses
    from unshutter.poses.row_poses import camera_poses
    from unshutter.rectification.rectified import Rectified
    from unshutter.rectification.sequences import RectifiedFrame, rectify_frames
    from unshutter.single import Method
    from unshutter.single.drawn_lines import DrawnLine
    from unshutter.single.estimator import Estimator, View
    from unshutter.single.register import load
    from unshutter.video.clip_functions import rectify_clip, rectify_clip_frames
    from unshutter.video.measurement import ClipMeasurement, measure_clips
    from unshutter.video.outcome import ClipOutcome


__all__ = [
    "CameraPoses",
    "Candidate",
    "ClipMeasurement",
    "ClipOutcome",
    "DrawnLine",
    "Estimator",
    "Finding",
    "Method",
    "MissingFileError",
    "Motion",
    "Photo",
    "PicturePoses",
    "Rectified",
    "RectifiedFrame",
    "RotationMotion",
    "RowMotion",
    "ScanDirection",
    "UnshutterError",
    "UsageError",
    "View",
    "__version__",
    "camera_poses",
    "candidates",
    "estimate",
    "estimate_frames",
    "load",
    "measure_clips",
    "rectify",
    "rectify_clip",
    "rectify_clip_frames",
    "rectify_frames",
]

_HOMES = {
    "api": ("candidates", "estimate", "rectify"),
    "frames.sequence": ("estimate_frames",),
    "rectification.sequences": ("RectifiedFrame", "rectify_frames"),
    "motion": ("Motion", "RotationMotion", "RowMotion"),
    "motion.finding": ("Candidate", "Finding"),
    "rectification.rectified": ("Rectified",),
    "orientation": ("ScanDirection",),
    "photo": ("Photo",),
    "poses.camera_poses": ("CameraPoses",),
    "poses.picture_poses": ("PicturePoses",),
    "poses.row_poses": ("camera_poses",),
    "single": ("Method",),
    "single.drawn_lines": ("DrawnLine",),
    "single.estimator": ("Estimator", "View"),
    "single.register": ("load",),
    "video.clip_functions": ("rectify_clip", "rectify_clip_frames"),
    "video.measurement": ("ClipMeasurement", "measure_clips"),
    "video.outcome": ("ClipOutcome",),
}


def __getattr__(name: str) -> object:
    """Imports public names on first use, to keep ``import unshutter`` fast."""
    home = next((module for module, names in _HOMES.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module 'unshutter' has no attribute '{name}'")
    value = getattr(import_module(f"unshutter.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
