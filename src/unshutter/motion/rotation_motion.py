"""Motion of a camera that rotates about all three axes; where it walks, depth displaces the picture besides."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import motion_file
from unshutter.motion.lens import Lens
from unshutter.motion.motion import BEYOND, Motion, matching_rows, positions, row_index, slope
from unshutter.motion.motion_file import Common, numbers
from unshutter.motion.parallax_field import between_nodes, checked_parallax
from unshutter.motion.rotations import (
    RowRotation,
    continued,
    rotated_gs_to_rs,
    rotated_rs_to_gs,
    rotation_matrix,
    rotation_vector,
    row_residual,
    row_rotation_from_samples,
)
from unshutter.motion.shapes import ArrayLike, Float64, Numbers
from unshutter.options import Reference, check_strength
from unshutter.reasons import JsonObject

_FOLDED = "the motion turns faster than rows are read: the picture would fold over itself"
_FARTHEST = np.pi / 2  # rad; beyond a right angle the picture's centre is no longer in front of the camera


@final
@dataclass(frozen=True, eq=False, repr=False)
class RotationMotion(Motion, kind="rotations"):
    """Rotation of the camera about all three axes at every row; exact, signs as in motion/rotations.py.

    ``tx_px`` and ``rz_rad`` are derived from the rotations and describe their effect at the picture's centre: the
    number of columns by which the row's homography moves it, and the angle by which it turns a line of pixels there.
    For a rotation about the z axis alone they are the whole motion; otherwise they are its projection onto the paper's
    motion (Eq. 1). Positions are mapped by the rotations themselves, which also shift rows.

    Attributes:
        rotations: [H, 3] rotation vector (r_x, r_y, r_z) of every row [rad], zero at the reference row.
        focal_px: focal length [px of this size].
        lens: the lens, if it bends straight lines; None for one that does not.
        parallax: [63, 2] columns and rows by which depth displaces, from the first to the last row, what the camera
            shows at each node of a grid of 7 x 9 (parallax_field.py) [px]; None for a camera that only rotates.

    Raises:
        UnshutterError: the array is not [H, 3] or not finite, a rotation is 90 degrees or more, or the focal length
            is not positive.
    """

    rotations: np.ndarray
    focal_px: float
    lens: Lens | None = None
    parallax: np.ndarray | None = None

    def _settle(self) -> None:
        rotations = motion_file.read_only(self.rotations)
        object.__setattr__(self, "rotations", rotations)
        if rotations.ndim != 2 or rotations.shape[1] != 3 or len(rotations) < 1:
            raise UnshutterError(f"a motion needs three rotations per row, got an array of shape {rotations.shape}")
        motion_file.check_rotations(rotations)
        motion_file.check_focal(self.focal_px)
        if np.linalg.norm(rotations, axis=1).max() >= _FARTHEST:
            raise UnshutterError("the motion turns the camera by 90 degrees or more")
        if self.parallax is not None:
            object.__setattr__(self, "parallax", checked_parallax(self.parallax, self.height))

    # ---- mapping ---------------------------------------------------------------------------------------

    @cached_property
    def tx_px(self) -> np.ndarray:
        """[H] columns by which each row's rotation moves the picture's centre [px]."""
        return motion_file.read_only(self.focal_px * self._matrices[:, 0, 2] / self._matrices[:, 2, 2])

    @cached_property
    def rz_rad(self) -> np.ndarray:
        """[H] angle by which each row's rotation turns a line of pixels at the picture's centre [rad]."""
        return motion_file.read_only(np.arctan2(-self._matrices[:, 0, 1], self._matrices[:, 1, 1]))

    @property
    def center(self) -> tuple[float, float]:
        """(col, row) of the principal point: the picture's centre [px]."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    @property
    def is_zero(self) -> bool:
        """Whether rectifying with this motion leaves the picture unchanged."""
        return not self.rotations.any() and (self.parallax is None or not self.parallax.any())

    def rs_to_gs(self, col: ArrayLike, row: ArrayLike) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps RS positions [px] of the readout frame to GS positions [px] (closed form)."""
        col, row = positions(col, row)
        seen = rotated_rs_to_gs(col, row, self._rotation_at, self.focal_px, self.center, self.lens)
        if self.parallax is None:
            return seen
        across, down = self._displaced(col, row)
        return seen[0] - across, seen[1] - down

    def gs_to_rs(self, col: ArrayLike, row: ArrayLike) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps GS positions [px] of the readout frame to RS positions [px].

        The exact inverse of :meth:`rs_to_gs`, but for a hundredth of the parallax.
        """
        col, row = positions(col, row)
        seen = rotated_gs_to_rs(col, row, self._rotation_at, self.focal_px, self.center, lens=self.lens)
        if self.parallax is None:
            return seen
        across, down = self._displaced(*seen)
        across, down = self._displaced(seen[0] + across, seen[1] + down)
        at = col + across, row + down
        return rotated_gs_to_rs(*at, self._rotation_at, self.focal_px, self.center, 2, self.lens, seen[1] + down)

    def _displaced(self, col: Float64[np.ndarray, "*at"], row: Float64[np.ndarray, "*at"]) -> tuple:
        """Returns how far depth displaces RS positions from where they are at the reference row [px]."""
        assert self.parallax is not None
        moved = between_nodes(self.parallax, (col + 0.5) / self.width, (row + 0.5) / self.height)
        share = np.clip((row - self.reference_row) / self.height, -1.0, 1.0)
        return moved[..., 0] * share, moved[..., 1] * share

    def check_unfolded(self) -> None:
        """Checks that every point of the scene was read by one row only and lay in front of the camera."""
        reach = self.width / 2 + np.abs(self.tx_px).max()
        row = np.arange(self.height, dtype=np.float64)
        wx, wy, wz = self._rotation_at(row)[1].T
        if self.lens is not None:
            col = np.linspace(-reach, reach, 9)[:, None] + self.center[0] + 0 * row
            slope = row_residual(row, col, row, self._rotation_at, self.focal_px, self.center, self.lens)[1]
            if slope.min() <= 0:
                raise UnshutterError(_FOLDED)
            return
        x = np.array([[-reach], [reach]]) / self.focal_px
        y = (row - self.center[1]) / self.focal_px
        # rows by which a point at (x, y) moves while one row is read; linear in x, so the two ends suffice
        speed = self.focal_px * (wz * x - wx * (1 + y * y) + wy * x * y)
        if speed.max() >= 1:
            raise UnshutterError(_FOLDED)
        corners = np.array([[sx * reach, sy * self.height / 2, self.focal_px] for sx in (-1, 1) for sy in (-1, 1)])
        along = np.concatenate([self._matrices[:, 2], self._matrices[:, :, 2]])
        if (along @ corners.T).min() <= 0:
            raise UnshutterError("the motion turns part of the picture behind the camera")

    def rates(self) -> tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "rows 2"]]:
        """Returns the angular rate [H], in rad per row, and velocity [H, 2], in px per row, at the picture's centre.

        The central ray (0, 0, 1) moves by the rates (w_x, w_y, w_z) x (0, 0, 1).
        """
        rates = slope(self._matrices) @ self._matrices.transpose(0, 2, 1)
        wx = rates[:, 2, 1]
        wy = rates[:, 0, 2]
        wz = rates[:, 1, 0]
        return wz, self.focal_px * np.stack([wy, -wx], axis=-1)

    @cached_property
    def _matrices(self) -> np.ndarray:
        """[H, 3, 3] rotation matrix of every row."""
        return rotation_matrix(self.rotations)

    @cached_property
    def _rotation_at(self) -> RowRotation:
        """Rotation at any row; extrapolated smoothly beyond the first and last rows, as in RowMotion."""
        rotations = continued(self._matrices, BEYOND)
        look_up = row_rotation_from_samples(rotations)
        return lambda row: look_up(row + BEYOND)

    # ---- derived motions -------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> RotationMotion:
        """Returns the same camera motion relative to another reference row.

        Exact: the new GS picture is the old one rotated by R of the new reference row m, which leaves R(row) R(m)^T.
        """
        row = row_index(reference, self.height)
        if not self.rotations[row].any():  # of depth, all but the square of its displacement is the same
            return self if reference == self.reference else replace(self, reference=reference)
        rotations = rotation_vector(self._matrices @ self._matrices[row].T)
        rotations[row] = 0.0
        return replace(self, reference=reference, rotations=rotations)

    def resized(self, height: int, width: int) -> RotationMotion:
        """Returns this motion for the picture scaled to another size; the focal length scales with the width.

        Rows are matched at their centres; the rotation is extrapolated beyond the first and last rows.
        """
        if (height, width) == (self.height, self.width):
            return self
        motion_file.check_aspect(self.height, self.width, height, width)
        rotations = rotation_vector(self._rotation_at(matching_rows(self.height, height))[0])
        larger = width / self.width
        parallax = None if self.parallax is None else self.parallax * larger
        moved = replace(self, width=width, rotations=rotations, focal_px=self.focal_px * larger, parallax=parallax)
        return moved.rereferenced(self.reference)

    def scaled(self, strength: float) -> RotationMotion:
        """Returns the motion with all rotation angles multiplied by ``strength``: 0 has no effect, 1 is this motion."""
        check_strength(strength)
        if strength == 1:
            return self
        parallax = None if self.parallax is None else self.parallax * strength
        return replace(self, rotations=self.rotations * strength, parallax=parallax)

    # ---- file format -----------------------------------------------------------------------------------

    def _own_data(self) -> JsonObject:
        lens = {} if self.lens is None else {"lens": self.lens.as_json()}
        parallax = {} if self.parallax is None else {"parallax_px": self.parallax.tolist()}
        return {"rotations_rad": self.rotations.tolist(), "focal_px": self.focal_px, **lens, **parallax}

    @classmethod
    def _of_data(cls, data: JsonObject, common: Common) -> RotationMotion:
        lens = Lens.of_json(data["lens"]) if "lens" in data else None
        parallax = numbers(data["parallax_px"]) if "parallax_px" in data else None
        camera = {"focal_px": float(data["focal_px"]), "lens": lens, "parallax": parallax}
        motion = cls(rotations=numbers(data["rotations_rad"]), **camera, **common)
        for key, worked_out in (("tx_px", motion.tx_px), ("rz_rad", motion.rz_rad)):
            written = numbers(data[key])
            if written.shape != worked_out.shape or not np.allclose(written, worked_out, rtol=1e-6, atol=1e-6):
                raise UnshutterError("the motion file contradicts itself: t_x and r_z are not those of its rotations")
        return motion
