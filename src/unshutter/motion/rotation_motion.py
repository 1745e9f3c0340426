"""A motion of three rotations per row: what a camera with a known focal length does when it only turns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.geometry import rotations as rotation_geometry
from unshutter.motion.motion import BEYOND, Motion, Reference

_FARTHEST = np.pi / 2  # rad; at a right angle nothing of the centre's neighbourhood stays in front of the camera


@dataclass(frozen=True, eq=False)
class RotationMotion(Motion):
    """Rotation of the camera's picture at every row, about all three axes; exact, signs as in rotation_geometry.py.

    ``tx_px`` and ``rz_rad`` are worked out from the rotations and say what they do at the picture's centre: how many
    columns the row's homography moves it, and by how much it turns a line of pixels there. That is all of a motion
    that turns about the z axis alone, and the projection to the paper's motion (Eq. 1) of any other: positions are
    mapped by the rotations themselves, which also shift rows.

    Attributes:
        rotations: [H, 3] rotation vector (r_x, r_y, r_z) of every row [rad], zero at the reference row.
        focal_px: focal length [px of this size].

    Raises:
        UnshutterError: not three finite numbers per row, a rotation of 90 degrees or more, or a focal length that
            is not positive.
    """

    tx_px: np.ndarray = field(init=False)
    rz_rad: np.ndarray = field(init=False)
    center_shift_px: float = field(init=False, default=0.0)
    rotations: np.ndarray = field(kw_only=True)
    focal_px: float = field(kw_only=True)

    def __post_init__(self) -> None:
        rotations = np.array(self.rotations, dtype=np.float64)
        if rotations.ndim != 2 or rotations.shape[1] != 3 or len(rotations) < 1:
            raise UnshutterError(f"a motion needs three rotations per row, got an array of shape {rotations.shape}")
        if not (np.isfinite(rotations).all() and np.isfinite(self.focal_px)):
            raise UnshutterError("the motion contains values that are not finite numbers")
        if self.focal_px <= 0:
            raise UnshutterError(f"the focal length must be positive, got {self.focal_px:g} px")
        if np.linalg.norm(rotations, axis=1).max() >= _FARTHEST:
            raise UnshutterError("the motion turns the camera by 90 degrees or more")
        rotations.setflags(write=False)
        matrices = rotation_geometry.rotation_matrix(rotations)
        object.__setattr__(self, "rotations", rotations)
        object.__setattr__(self, "tx_px", self.focal_px * matrices[:, 0, 2] / matrices[:, 2, 2])
        object.__setattr__(self, "rz_rad", np.arctan2(-matrices[:, 0, 1], matrices[:, 1, 1]))
        super().__post_init__()

    # ---- what it says ----------------------------------------------------------------------------------

    @property
    def is_zero(self) -> bool:
        """Whether rectifying with this motion changes nothing."""
        return not self.rotations.any()

    def rs_to_gs(self, col: Any, row: Any) -> tuple[np.ndarray, np.ndarray]:
        """RS positions [px] of the readout frame -> GS positions [px] (closed form)."""
        return rotation_geometry.rotated_rs_to_gs(*_positions(col, row), self._rotation_at, self.focal_px, self.center)

    def gs_to_rs(self, col: Any, row: Any) -> tuple[np.ndarray, np.ndarray]:
        """GS positions [px] of the readout frame -> RS positions [px] (exact inverse)."""
        return rotation_geometry.rotated_gs_to_rs(*_positions(col, row), self._rotation_at, self.focal_px, self.center)

    def check_unfolded(self) -> None:
        """Passes where every place of the scene was seen by one row only, and all of it in front of the camera.

        Raises:
            UnshutterError: the motion turns faster than rows are read, or out of the picture's plane.
        """
        reach = self.width / 2 + np.abs(self.tx_px).max()
        row = np.arange(self.height, dtype=np.float64)
        wx, wy, wz = self._rotation_at(row)[1].T
        x, y = np.array([[-reach], [reach]]) / self.focal_px, (row - self.center[1]) / self.focal_px
        # how many rows a point at (x, y) is carried on while one row is read; linear in x, so the ends tell
        speed = self.focal_px * (wz * x - wx * (1 + y * y) + wy * x * y)
        if speed.max() >= 1:
            raise UnshutterError("the motion turns faster than rows are read: the picture would fold over itself")
        corners = np.array([[sx * reach, sy * self.height / 2, self.focal_px] for sx in (-1, 1) for sy in (-1, 1)])
        matrices = rotation_geometry.rotation_matrix(self.rotations)
        if min((corners @ m[2]).min() for m in (*matrices, *matrices.transpose(0, 2, 1))) <= 0:
            raise UnshutterError("the motion turns part of the picture behind the camera")

    @cached_property
    def _rotation_at(self) -> rotation_geometry.RowRotation:
        """The rotation of any row; carried on smoothly past the first and the last, as Motion does."""
        rotations = _continued(rotation_geometry.rotation_matrix(self.rotations), BEYOND)
        look_up = rotation_geometry.row_rotation_from_samples(rotations)
        return lambda row: look_up(row + BEYOND)

    # ---- changed into ----------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> RotationMotion:
        """The same camera motion, with the picture taken at another row's moment.

        Exact: the new GS picture is the old one turned by R of the new reference row m, so R(row) R(m)^T remains.
        """
        changed = replace(self, reference=reference)
        row = changed.reference_row
        if not self.rotations[row].any():
            return changed
        matrices = rotation_geometry.rotation_matrix(self.rotations)
        rotations = rotation_geometry.rotation_vector(matrices @ matrices[row].T)
        rotations[row] = 0.0
        return replace(changed, rotations=rotations)

    def resized(self, height: int, width: int) -> RotationMotion:
        """The same motion for the picture scaled to another size: the focal length scales with the width.

        Rows are matched at their centres; the first and last turn carry on to the new borders.

        Raises:
            UnshutterError: the aspect ratio changes by more than two per cent.
        """
        self._check_aspect(height, width)
        if (height, width) == (self.height, self.width):
            return self
        at = (np.arange(height) + 0.5) * (self.height / height) - 0.5
        rotations = rotation_geometry.rotation_vector(self._rotation_at(at)[0])
        moved = replace(self, width=width, rotations=rotations, focal_px=self.focal_px * width / self.width)
        return moved.rereferenced(self.reference)

    def scaled(self, strength: float) -> RotationMotion:
        """All rotation angles times ``strength``: 0 does nothing, 1 is this motion."""
        if not 0 <= strength <= 1:
            raise UsageError(f"strength must lie between 0 and 1, got {strength:g}")
        return replace(self, rotations=self.rotations * strength)

    def smoothed(self, degree: int) -> RotationMotion:
        """Least-squares polynomials of the given degree over the rows, of each rotation."""
        return replace(self, rotations=self._smooth(self.rotations.T, degree).T)


def _positions(col: Any, row: Any) -> tuple[np.ndarray, np.ndarray]:
    """Two float64 arrays of one shape."""
    col, row = np.broadcast_arrays(np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64))
    return col, row


def _continued(rotations: np.ndarray, rows: int) -> np.ndarray:
    """Matrices [H, 3, 3] with so many rows more at both ends: the turns from the end, mirrored in time.

    R(-k) = R(0) R(k)^T R(0): the odd reflection that Motion uses, for rotations that do not commute.
    """
    for end in (-1, 1):
        missing = rows
        while missing:
            ordered = rotations[::end]  # the end to continue comes last
            last = ordered[-1]
            more = last @ ordered[-2 : -2 - missing : -1].transpose(0, 2, 1) @ last if len(ordered) > 1 else last[None]
            missing -= len(more)
            rotations = np.concatenate([ordered, more])[::end]
    return rotations
