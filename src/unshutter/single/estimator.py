"""The Estimator interface and its input, View."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import Motion, RotationMotion, RowMotion
from unshutter.motion.finding import Candidate, Finding, list_single
from unshutter.motion.upright import Angle, Pose
from unshutter.options import USUAL_FOCAL, Camera, DecisionOptions
from unshutter.orientation import ScanDirection, scene_up
from unshutter.photo import Photo
from unshutter.photo.attitude import Attitude
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import Code, MotionSource, Reason
from unshutter.single import Method
from unshutter.single.sharpness import EdgeWidths, SpeedLimit, speed_limit


@dataclass(frozen=True)
class View:
    """A photo as seen by an estimator: in its readout frame, with the first line read on top (orientation.py).

    Attributes:
        photo: the photo as read.
        camera: what the user states about the camera; otherwise the photo's own metadata are used.
        guessed_focal_px: a better guess than that from the picture's size, for instance for a crop of a larger photo.
        decision: what decides between undoing a motion and leaving the photo unchanged.
    """

    photo: Photo
    camera: Camera = field(default_factory=Camera)
    guessed_focal_px: float | None = None
    decision: DecisionOptions = field(default_factory=DecisionOptions)

    @property
    def scan_direction(self) -> ScanDirection:
        """Direction in which the stored pixels were read: as stated, or else from gravity, or else top to bottom."""
        if self.camera.readout == "auto" and self.photo.attitude is not None:
            return self.photo.attitude.scan_direction
        return self.camera.scan_direction

    @property
    def height(self) -> int:
        """Rows of the full-size readout frame."""
        return self.scan_direction.frame_size(self.photo.height, self.photo.width)[0]

    @property
    def width(self) -> int:
        """Columns of the full-size readout frame."""
        return self.scan_direction.frame_size(self.photo.height, self.photo.width)[1]

    @property
    def up(self) -> tuple[int, int]:
        """Unit vector (right, down) towards the top of the scene, from the EXIF orientation."""
        return scene_up(self.photo.orientation, self.scan_direction)

    @property
    def heading(self) -> int:
        """Sign of t_x over the readout, from the stated way of the camera across the picture; 0 if that is unknown."""
        right, up = self.up
        return {"left": -up, "right": up, "up": -right, "down": right}.get(self.camera.moving or "", 0)

    def grey(self, short_side: int | None = None) -> np.ndarray:
        """Returns a [h, w] uint8 grey copy whose short side is about ``short_side`` px; never enlarged."""
        return self.scan_direction.to_scan_frame(self.photo.grey(short_side))

    def focal_px(self) -> float:
        """Returns the focal length [px of the full-size picture], if unknown guessed as 0.85 (width + height)."""
        return self.known_focal_px() or self.guessed_focal_px or USUAL_FOCAL * (self.width + self.height)

    def known_focal_px(self) -> float | None:
        """Returns the focal length [px of the full-size picture] as stated, or else EXIF's, or else None."""
        return self.camera.focal_px or self.photo.focal_px()

    def attitude(self) -> Attitude:
        """Returns the camera's attitude: each angle as stated, or else the photo's own, or else None."""
        own = self.photo.attitude or Attitude(None, None, "")
        roll = self.camera.roll_deg
        tilt = self.camera.tilt_deg
        if roll is None and tilt is None:
            return own
        kept = own.tilt_deg if tilt is None else own.roll_deg if roll is None else None
        roll = own.roll_deg if roll is None else roll
        tilt = own.tilt_deg if tilt is None else tilt
        return Attitude(roll, tilt, "given" if kept is None else f"given; {own.source}", own.scan_direction)

    def attitude_deg(self) -> tuple[float | None, float | None]:
        """Returns the camera's roll and tilt [degrees] as stated, or else the photo's own, or else None."""
        held = self.attitude()
        return held.roll_deg, held.tilt_deg

    def exposure_s(self) -> float | None:
        """Returns the exposure time of each line [s] as stated, or else EXIF's, or else None."""
        return self.camera.exposure_s or self.photo.exposure_s()

    def readout_s(self) -> ReadoutTime:
        """Returns the readout time or its plausible range: as stated, or else typical for the kind of camera."""
        if self.camera.readout_ms is None:
            return self.photo.readout_time()
        return ReadoutTime.of_ms(self.camera.readout_ms, ReadoutSource.GIVEN)

    def read_at_once(self) -> Reason | None:
        """Returns why no row can have moved against another, by the kind of camera; None if rows can have."""
        if self.readout_s().longest_s > 0:
            return None
        return Reason.of(Code.NO_ROLLING_SHUTTER, camera=self.photo.camera_in_words())

    @cached_property
    def speed_limit(self) -> SpeedLimit | None:
        """The fastest motion that the photo's sharpness allows; None if it sets no limit.

        Raises:
            UnshutterError: the photo is damaged or gone.
        """
        return speed_limit(lambda: self.edges, self.exposure_s(), self.readout_s(), self.photo.is_merged())

    @cached_property
    def edges(self) -> EdgeWidths:
        """The widths of the photo's edges. Reads it at full size, once.

        Raises:
            UnshutterError: the photo is damaged or gone.
        """
        return EdgeWidths.of(self.scan_direction.to_scan_frame(self.photo.pixels))

    def noted(self, found: Finding) -> Finding:
        """Adds the attitude, exposure and pose from the photo's metadata or the user to a finding."""
        held = self.attitude()
        roll = None if held.roll_deg is None else Angle(round(held.roll_deg, 2), self.camera.roll_deg is not None)
        tilt = None if held.tilt_deg is None else Angle(round(held.tilt_deg, 2), self.camera.tilt_deg is not None)
        noted = replace(found, roll=roll, tilt=tilt, attitude_from=held.source, exposure_s=self.exposure_s())
        if held.roll_deg is None:
            return noted
        measured = Pose(held.roll_deg, held.tilt_deg, self.focal_px() / self.height, self.up)
        return replace(noted, held=found.held or measured, held_at_rest=found.held_at_rest or measured)

    def no_motion(self, estimator: str, reason: Reason | str | None = None) -> Finding:
        """Returns the answer of an estimator that declines.

        Args:
            reason: why; methods from other packages give a sentence. None for the unchanged photo among candidates.
        """
        why = Reason.stated(reason) if isinstance(reason, str) else reason
        motion = RowMotion.zero(self.height, self.width, scan_direction=self.scan_direction)
        return Finding(motion, estimator=estimator, source=MotionSource.PIXELS, reason=why)

    def cubic_motion(self, coefficients: np.ndarray, estimator: str, confidence: float | None = None) -> Finding:
        """Returns the answer of an estimator that found a cubic row motion, first row as the reference.

        Args:
            coefficients: [2, 3] of u, u^2, u^3 with u = (row + 1/2) / rows: t_x [rows], r_z [rad].
        """
        u = (np.arange(self.height) + 0.5) / self.height
        tx, rz = (c[0] * u + c[1] * u**2 + c[2] * u**3 for c in coefficients)
        motion = RowMotion(self.width, (tx - tx[0]) * self.height, rz - rz[0], scan_direction=self.scan_direction)
        return Finding(motion, estimator=estimator, source=MotionSource.PIXELS, confidence=confidence)

    @staticmethod
    def cubic_of(motion: Motion) -> np.ndarray:
        """Returns the [6] coefficients of a motion of :meth:`cubic_motion`."""
        u = (np.arange(motion.height) + 0.5) / motion.height
        values = np.stack([motion.tx_px / motion.height, motion.rz_rad], axis=1)
        return np.polynomial.polynomial.polyfit(u, values, 3)[1:].T.ravel()

    def rotation_motion(self, rotations: np.ndarray, estimator: str) -> Finding:
        """Returns the answer of an estimator that found rotations about three axes, first row as the reference.

        Args:
            rotations: [height, 3] (r_x, r_y, r_z) of every row [rad].
        """
        try:
            motion = RotationMotion(
                self.width, rotations, self.focal_px(), scan_direction=self.scan_direction
            ).rereferenced("first")
            motion.check_unfolded()
        except UnshutterError as error:
            return self.no_motion(estimator, Reason.of(Code.IMPOSSIBLE_MOTION, detail=str(error)))
        return Finding.of(motion, estimator)


class Estimator(ABC):
    """Estimates the row motion of a photo. Thread-safe.

    Args:
        method: its entry in the register.
        weights: weights file; None for methods that need none.
    """

    def __init__(self, method: Method, weights: Path | None = None):
        self.method = method
        self.weights = weights

    def __reduce__(self) -> tuple:  # an open network cannot be pickled; it is reopened
        return type(self), (self.method, self.weights)

    @property
    def name(self) -> str:
        """The method's name, which its findings carry as ``estimator``."""
        return self.method.name

    def prepare(self) -> None:
        """Does slow preparations ahead of the first estimate, such as opening a network.

        Does nothing by default. May be called more than once.

        Raises:
            UnshutterError: the weights cannot be used.
        """
        return

    @abstractmethod
    def estimate(self, view: View) -> Motion | Finding:
        """Returns the motion of the full-size photo in its readout frame, first row as the reference.

        A finding also says how sure that is. If the photo is inconclusive, its motion is zero, with a reason
        (:meth:`View.no_motion`); that is not an error.
        """

    def candidates(self, view: View) -> tuple[Candidate, ...]:
        """Returns the possible motions of the photo, including leaving it unchanged, that of :meth:`estimate` first.

        Methods that find several override this.
        """
        return list_single(Finding.of(self.estimate(view), self.name), view.photo.orientation)
