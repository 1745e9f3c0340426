"""Options for finding a motion: the method, and known facts about the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TypedDict

from unshutter.errors import UsageError
from unshutter.geometry.readout import Readout
from unshutter.options.description import check_time, option

DEFAULT_ESTIMATOR = "segment-manhattan"
MOST_ROLL_DEG, MOST_TILT_DEG = 45, 90  # beyond these, up is no longer up


def check_focal(focal_px: float | None) -> None:
    """Checks a focal length [px]; None is allowed.

    Raises:
        UsageError: it is not positive.
    """
    if focal_px is not None and not 0 < focal_px < math.inf:
        raise UsageError(f"the focal length must be positive, got {focal_px:g} px")


@dataclass(frozen=True)
class Camera:
    """What you know about the camera.

    Attributes:
        at_any_odds: whether to accept the likeliest motion even if no motion at all is likelier; set by a least
            confidence of 0 (:meth:`for_least_confidence`).

    Raises:
        UsageError: unknown direction, a focal length or time that is not positive, or an angle out of range.
    """

    readout: str = option(
        "auto",
        "Direction in which the sensor was read out, if an editor has rotated the file. Default: taken from "
        "--motion or found in the photo, otherwise top-to-bottom.",
        choices=("auto", *Readout),
    )
    focal_px: float | None = option(
        None,
        "Focal length in px of the photo, for methods that use it. Default: from EXIF, otherwise 0.85 "
        "(width + height).",
    )
    roll_deg: float | None = option(
        None,
        "Camera roll in degrees, clockwise from upright, if you know it; for methods that use it.",
        limits=(-MOST_ROLL_DEG, MOST_ROLL_DEG),
    )
    tilt_deg: float | None = option(
        None,
        "Camera tilt in degrees, if you know it: positive is up, -90 straight down.",
        limits=(-MOST_TILT_DEG, MOST_TILT_DEG),
    )
    exposure_s: float | None = option(
        None, "Exposure time of the photo, in seconds. Default: from EXIF.", metavar="SECONDS"
    )
    readout_ms: float | None = option(
        None,
        "Readout time, from the first row to the last, in milliseconds. Default: the usual time for such a camera.",
        metavar="MS",
    )
    moving: bool = option(False, "The camera was on the move: in a train, on a car, on a drone.")
    no_film: bool = option(False, "Do not use the film that belongs to a motion photo or Live Photo.")
    candidate: int | None = option(
        None,
        "Undo candidate N from `unshutter estimate --candidates`, however unsure, instead of the first.",
        metavar="N",
    )
    at_any_odds: bool = False

    def __post_init__(self) -> None:
        Readout.parse(self.readout)
        if self.candidate is not None and self.candidate < 1:
            raise UsageError(f"candidates are counted from 1, got {self.candidate}")
        check_focal(self.focal_px)
        for name, time, unit in (("exposure", self.exposure_s, "s"), ("readout", self.readout_ms, "ms")):
            check_time(name, time, unit)
        for name, angle, most in (("roll", self.roll_deg, MOST_ROLL_DEG), ("tilt", self.tilt_deg, MOST_TILT_DEG)):
            if angle is not None and not -most <= angle <= most:
                raise UsageError(f"the camera's {name} must lie between -{most} and {most} degrees, got {angle:g}")

    @property
    def direction(self) -> Readout:
        """The readout direction, with ``auto`` resolved."""
        return Readout.parse(self.readout)

    def for_least_confidence(self, least: float) -> Camera:
        """Adapts the options to a least confidence of motions; 0 accepts the likeliest motion, however unsure."""
        return replace(self, at_any_odds=least == 0 and self.candidate is None)

    def check_unused(self) -> None:
        """Checks that only the readout direction is set, as required when no motion is to be found.

        Raises:
            UsageError: another field is set.
        """
        if self != Camera(self.readout):
            raise UsageError(
                "focal length, roll, tilt, exposure, readout time, --moving, --no-film and --candidate are for finding "
                "a motion: leave them out when you give one"
            )


class CameraKeywords(TypedDict, total=False):
    """Keyword arguments corresponding to the fields of :class:`Camera`."""

    readout: str
    focal_px: float | None
    roll_deg: float | None
    tilt_deg: float | None
    exposure_s: float | None
    readout_ms: float | None
    moving: bool
    no_film: bool
    candidate: int | None


@dataclass(frozen=True)
class Find:
    """How a photo's motion is found.

    Attributes:
        estimator: name of the method, or NAME@FILE with weights of your own.
        camera: known facts about the camera.
    """

    estimator: str = option(
        DEFAULT_ESTIMATOR, "Method that finds the camera's motion; `unshutter models` lists them.", names="word"
    )
    camera: Camera = field(default_factory=Camera)
