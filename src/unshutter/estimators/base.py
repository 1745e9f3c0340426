"""What an estimator is given, and what it must be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.geometry.readout import Readout, scene_up
from unshutter.motion import Motion, RotationMotion
from unshutter.options import MOST_ROLL_DEG, MOST_TILT_DEG
from unshutter.photo import Photo


@dataclass(frozen=True)
class View:
    """A photo as an estimator sees it: in its readout frame, first line on top (readout.py).

    Attributes:
        photo: as it was read.
        readout: direction in which the stored pixels were read.
        given_focal_px: focal length that the user knows [px of the full-size picture]; None: EXIF's or a guess.
        guessed_focal_px: a better guess than by the picture's size, as for one cut out of a larger photo.
        given_roll_deg: how far the camera was turned clockwise, as its user sees it, from upright; None: unknown.
        given_tilt_deg: how far it looked up, -90 is straight down; None: unknown.

    Raises:
        UsageError: a focal length that is not positive, an angle out of range.
    """

    photo: Photo
    readout: Readout = Readout.TOP_TO_BOTTOM
    given_focal_px: float | None = None
    guessed_focal_px: float | None = None
    given_roll_deg: float | None = None
    given_tilt_deg: float | None = None

    def __post_init__(self) -> None:
        if self.given_focal_px is not None and not 0 < self.given_focal_px < float("inf"):
            raise UsageError(f"the focal length must be positive, got {self.given_focal_px:g} px")
        for name, angle, most in (
            ("roll", self.given_roll_deg, MOST_ROLL_DEG),
            ("tilt", self.given_tilt_deg, MOST_TILT_DEG),
        ):
            if angle is not None and not -most <= angle <= most:
                raise UsageError(f"the camera's {name} must lie between -{most} and {most} degrees, got {angle:g}")

    @property
    def height(self) -> int:
        """Rows of the full-size readout frame."""
        return self.readout.frame_size(self.photo.height, self.photo.width)[0]

    @property
    def width(self) -> int:
        """Columns of the full-size readout frame."""
        return self.readout.frame_size(self.photo.height, self.photo.width)[1]

    @property
    def up(self) -> tuple[int, int]:
        """Unit vector (right, down) to the scene's top, from the EXIF orientation."""
        return scene_up(self.photo.orientation, self.readout)

    def grey(self, short_side: int | None = None) -> np.ndarray:
        """[h, w] uint8 grey copy whose short side is about ``short_side`` px; never enlarged."""
        return self.readout.turn(self.photo.grey(short_side))

    def focal_px(self) -> float:
        """Focal length [px of the full-size picture]: the known one, else a guess, by itself 0.85 (width + height)."""
        return self.known_focal_px() or self.guessed_focal_px or 0.85 * (self.width + self.height)

    def known_focal_px(self) -> float | None:
        """Focal length [px of the full-size picture]: the given one, else EXIF's, else None."""
        return self.given_focal_px or self.photo.focal_px()

    def attitude_deg(self) -> tuple[float | None, float | None]:
        """Roll and tilt of the camera [degrees], each where it is known: the given ones, else the photo's own."""
        roll, tilt = self.photo.attitude_deg() or (None, None)
        given = self.given_roll_deg, self.given_tilt_deg
        return roll if given[0] is None else given[0], tilt if given[1] is None else given[1]

    def no_motion(self, estimator: str, reason: str) -> Motion:
        """The answer of an estimator that declines, and why."""
        return Motion.zero(self.height, self.width, readout=self.readout, estimator=estimator, reason=reason)

    def rotations(self, rotations: np.ndarray, estimator: str) -> Motion:
        """The answer of an estimator that found rotations about three axes, first row as the reference.

        Args:
            rotations: [height, 3] (r_x, r_y, r_z) of every row [rad].
            estimator: its name.

        Returns:
            The motion; none, with the reason, where it would fold the picture over itself.
        """
        about = {"width": self.width, "readout": self.readout, "estimator": estimator}
        try:
            motion = RotationMotion(rotations=rotations, focal_px=self.focal_px(), **about).rereferenced("first")
            motion.check_unfolded()
        except UnshutterError as error:
            return self.no_motion(estimator, f"what fits the lines is no motion of a camera: {error}")
        return motion


class Estimator(Protocol):
    """Finds the row motion of a photo.

    May have a method ``prepare()`` that does beforehand what the first estimate would else wait for, and may be asked
    by several threads at once.

    Attributes:
        name: under which it is registered.
    """

    name: str

    def estimate(self, view: View) -> Motion:
        """The motion of the full-size photo in its readout frame, first row as the reference.

        Where the photo does not say enough the motion is zero and carries a reason; it never raises for that.
        """
        ...
