"""Motion with three rotations per row: a purely rotating camera with a known focal length."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.geometry import rotations as rotation_geometry
from unshutter.motion import checks
from unshutter.motion.motion import Motion
from unshutter.motion.motion_file import numbers
from unshutter.motion.sampling import BEYOND, matching_rows, positions, row_index, slope
from unshutter.options import Reference, check_strength

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64, Numbers

_FARTHEST = np.pi / 2  # rad; beyond a right angle the picture's centre is no longer in front of the camera


@final
@dataclass(frozen=True, eq=False, repr=False)
class RotationMotion(Motion, kind="rotations"):
    """Rotation of the camera about all three axes at every row; exact, signs as in geometry/rotations.py.

    ``tx_px`` and ``rz_rad`` are derived from the rotations and describe their effect at the picture's centre: the
    number of columns by which the row's homography moves it, and the angle by which it turns a line of pixels there.
    For a rotation about the z axis alone they are the whole motion; otherwise they are its projection onto the paper's
    motion (Eq. 1). Positions are mapped by the rotations themselves, which also shift rows.

    Attributes:
        rotations: [H, 3] rotation vector (r_x, r_y, r_z) of every row [rad], zero at the reference row.
        focal_px: focal length [px of this size].

    Raises:
        UnshutterError: the array is not [H, 3] or not finite, a rotation is 90 degrees or more, or the focal length
            is not positive.
    """

    rotations: np.ndarray
    focal_px: float

    def _settle(self) -> None:
        rotations = checks.read_only(self.rotations)
        object.__setattr__(self, "rotations", rotations)
        if rotations.ndim != 2 or rotations.shape[1] != 3 or len(rotations) < 1:
            raise UnshutterError(f"a motion needs three rotations per row, got an array of shape {rotations.shape}")
        checks.check_turns(rotations)
        checks.check_focal(self.focal_px)
        if np.linalg.norm(rotations, axis=1).max() >= _FARTHEST:
            raise UnshutterError("the motion turns the camera by 90 degrees or more")

    # ---- mapping ---------------------------------------------------------------------------------------

    @cached_property
    def tx_px(self) -> np.ndarray:
        """[H] columns by which each row's rotation moves the picture's centre [px]."""
        return checks.read_only(self.focal_px * self._matrices[:, 0, 2] / self._matrices[:, 2, 2])

    @cached_property
    def rz_rad(self) -> np.ndarray:
        """[H] angle by which each row's rotation turns a line of pixels at the picture's centre [rad]."""
        return checks.read_only(np.arctan2(-self._matrices[:, 0, 1], self._matrices[:, 1, 1]))

    @property
    def center(self) -> tuple[float, float]:
        """(col, row) of the principal point: the picture's centre [px]."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    @property
    def is_zero(self) -> bool:
        """Whether rectifying with this motion leaves the picture unchanged."""
        return not self.rotations.any()

    def rs_to_gs(self, col: Any, row: Any) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps RS positions [px] of the readout frame to GS positions [px] (closed form)."""
        return rotation_geometry.rotated_rs_to_gs(*positions(col, row), self._rotation_at, self.focal_px, self.center)

    def gs_to_rs(self, col: Any, row: Any) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps GS positions [px] of the readout frame to RS positions [px] (exact inverse)."""
        return rotation_geometry.rotated_gs_to_rs(*positions(col, row), self._rotation_at, self.focal_px, self.center)

    def check_unfolded(self) -> None:
        """Checks that every point of the scene was read by one row only and lay in front of the camera.

        Raises:
            UnshutterError: the motion turns faster than rows are read, or turns part of the picture behind the camera.
        """
        reach = self.width / 2 + np.abs(self.tx_px).max()
        row = np.arange(self.height, dtype=np.float64)
        wx, wy, wz = self._rotation_at(row)[1].T
        x, y = np.array([[-reach], [reach]]) / self.focal_px, (row - self.center[1]) / self.focal_px
        # rows by which a point at (x, y) moves while one row is read; linear in x, so the two ends suffice
        speed = self.focal_px * (wz * x - wx * (1 + y * y) + wy * x * y)
        if speed.max() >= 1:
            raise UnshutterError("the motion turns faster than rows are read: the picture would fold over itself")
        corners = np.array([[sx * reach, sy * self.height / 2, self.focal_px] for sx in (-1, 1) for sy in (-1, 1)])
        matrices = self._matrices
        if min((corners @ m[2]).min() for m in (*matrices, *matrices.transpose(0, 2, 1))) <= 0:
            raise UnshutterError("the motion turns part of the picture behind the camera")

    def rates(self) -> tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "rows 2"]]:
        """Returns the angular rate [H] [rad per row] and velocity [H, 2] [px per row] at the picture's centre.

        The central ray (0, 0, 1) moves by the rates (w_x, w_y, w_z) x (0, 0, 1).
        """
        rates = slope(self._matrices) @ self._matrices.transpose(0, 2, 1)
        wx, wy, wz = rates[:, 2, 1], rates[:, 0, 2], rates[:, 1, 0]
        return wz, self.focal_px * np.stack([wy, -wx], axis=-1)

    @cached_property
    def _matrices(self) -> np.ndarray:
        """[H, 3, 3] rotation matrix of every row."""
        return rotation_geometry.rotation_matrix(self.rotations)

    @cached_property
    def _rotation_at(self) -> rotation_geometry.RowRotation:
        """Rotation at any row; extrapolated smoothly beyond the first and last rows, as in RowMotion."""
        rotations = _continued(self._matrices, BEYOND)
        look_up = rotation_geometry.row_rotation_from_samples(rotations)
        return lambda row: look_up(row + BEYOND)

    # ---- derived motions -------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> RotationMotion:
        """Returns the same camera motion relative to another reference row.

        Exact: the new GS picture is the old one rotated by R of the new reference row m, which leaves R(row) R(m)^T.
        """
        row = row_index(reference, self.height)
        if not self.rotations[row].any():
            return replace(self, reference=reference)
        rotations = rotation_geometry.rotation_vector(self._matrices @ self._matrices[row].T)
        rotations[row] = 0.0
        return replace(self, reference=reference, rotations=rotations)

    def resized(self, height: int, width: int) -> RotationMotion:
        """Returns this motion for the picture scaled to another size; the focal length scales with the width.

        Rows are matched at their centres; the rotation is extrapolated beyond the first and last rows.

        Raises:
            UnshutterError: the aspect ratio changes by more than two per cent.
        """
        if (height, width) == (self.height, self.width):
            return self
        checks.check_aspect(self.height, self.width, height, width)
        rotations = rotation_geometry.rotation_vector(self._rotation_at(matching_rows(self.height, height))[0])
        moved = replace(self, width=width, rotations=rotations, focal_px=self.focal_px * width / self.width)
        return moved.rereferenced(self.reference)

    def scaled(self, strength: float) -> RotationMotion:
        """Returns the motion with all rotation angles multiplied by ``strength``: 0 has no effect, 1 is this motion."""
        check_strength(strength)
        return replace(self, rotations=self.rotations * strength)

    # ---- file format -----------------------------------------------------------------------------------

    def _own_data(self) -> dict[str, Any]:
        return {"rotations_rad": self.rotations.tolist(), "focal_px": self.focal_px}

    @classmethod
    def _of_data(cls, data: dict[str, Any], common: dict[str, Any]) -> RotationMotion:
        motion = cls(rotations=numbers(data["rotations_rad"]), focal_px=float(data["focal_px"]), **common)
        for key, worked_out in (("tx_px", motion.tx_px), ("rz_rad", motion.rz_rad)):
            written = numbers(data[key])
            if written.shape != worked_out.shape or not np.allclose(written, worked_out, rtol=1e-6, atol=1e-6):
                raise UnshutterError("the motion file contradicts itself: t_x and r_z are not those of its rotations")
        return motion


def _continued(rotations: np.ndarray, rows: int) -> np.ndarray:
    """Extends matrices [H, 3, 3] by ``rows`` rows at both ends, reflecting the rotations about each end.

    R(-k) = R(0) R(k)^T R(0): the odd reflection used by RowMotion, for rotations that do not commute.
    """
    for end in (-1, 1):
        missing = rows
        while missing:
            ordered = rotations[::end]  # the end to extend comes last
            last = ordered[-1]
            more = last @ ordered[-2 : -2 - missing : -1].transpose(0, 2, 1) @ last if len(ordered) > 1 else last[None]
            missing -= len(more)
            rotations = np.concatenate([ordered, more])[::end]
    return rotations
