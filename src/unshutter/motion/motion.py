"""Motion: how the camera moved while the rows of one photo were read out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.geometry import rows as geometry
from unshutter.geometry.readout import Readout
from unshutter.storage.files import written_whole
from unshutter.version import __version__

Reference = Literal["first", "middle", "last"]
BEYOND = 128  # rows past the first and the last on which the motion goes on smoothly


@dataclass(frozen=True, eq=False)
class Motion:
    """Row motion of one photo, in its readout frame (readout.py), signs as in geometry.py (paper, Eq. 1).

    Attributes:
        width: columns of the readout frame [px].
        tx_px: [H] t_x of every row [px], positive moves the scene to the right.
        rz_rad: [H] r_z of every row [rad], positive turns the scene clockwise as seen in the picture.
        reference: the row (first | middle | last) at whose moment the global-shutter picture is taken;
            both motions are zero there.
        readout: direction in which the stored pixels were read.
        estimator: what found this motion.
        confidence: 0 ... 1, or None where the estimator gives none.
        center_shift_px: offset of the rotation centre from the picture's centre along the columns [px];
            non-zero only after :meth:`rereferenced`.
        reason: why there is no motion, when an estimator declined; empty otherwise.
        version: version of unshutter that made it.

    Raises:
        UnshutterError: samples that are not finite, or not one per row.
    """

    width: int
    tx_px: np.ndarray
    rz_rad: np.ndarray
    reference: Reference = "first"
    readout: Readout = Readout.TOP_TO_BOTTOM
    estimator: str = "given"
    confidence: float | None = None
    center_shift_px: float = 0.0
    reason: str = ""
    version: str = field(default=__version__)

    def __post_init__(self) -> None:
        tx, rz = (np.array(a, dtype=np.float64) for a in (self.tx_px, self.rz_rad))
        if tx.ndim != 1 or tx.shape != rz.shape or tx.size < 1:
            raise UnshutterError(f"a motion needs one t_x and one r_z per row, got shapes {tx.shape} and {rz.shape}")
        if self.width < 1:
            raise UnshutterError(f"a motion needs a width of at least 1 px, got {self.width}")
        if not (np.isfinite(tx).all() and np.isfinite(rz).all() and np.isfinite(self.center_shift_px)):
            raise UnshutterError("the motion contains values that are not finite numbers")
        if self.reference not in ("first", "middle", "last"):
            raise UsageError(f"unknown reference row '{self.reference}': choose first, middle or last")
        tx.setflags(write=False)
        rz.setflags(write=False)
        object.__setattr__(self, "tx_px", tx)
        object.__setattr__(self, "rz_rad", rz)

    # ---- made from -------------------------------------------------------------------------------------

    @classmethod
    def zero(cls, height: int, width: int, **about: Any) -> Motion:
        """No motion at all; ``about`` sets further attributes (estimator, reason, readout ...)."""
        return cls(width, np.zeros(height), np.zeros(height), **about)

    @classmethod
    def from_polynomials(
        cls, tx_coefficients: Sequence[float], rz_coefficients: Sequence[float], height: int, width: int, **about: Any
    ) -> Motion:
        """Motion whose t_x [px] and r_z [rad] are polynomials in u = row / (height - 1).

        Args:
            tx_coefficients, rz_coefficients: of u^0, u^1, ...; a constant term is kept as it is given.
        """
        u = np.arange(height) / max(height - 1, 1)
        tx = geometry.polynomial(np.asarray(tx_coefficients, dtype=np.float64), u)
        rz = geometry.polynomial(np.asarray(rz_coefficients, dtype=np.float64), u)
        return cls(width, tx, rz, **about)

    @classmethod
    def from_key_rows(
        cls,
        rows: Sequence[float],
        tx_px: Sequence[float],
        rz_rad: Sequence[float],
        height: int,
        width: int,
        degree: int | None = None,
        **about: Any,
    ) -> Motion:
        """Motion known at some rows only (increasing, at least two).

        Args:
            rows: row of each sample [px].
            degree: fit a polynomial of this degree (the predecessor: 2); None interpolates linearly and
                carries the first and last slope to the borders.
        """
        known = np.asarray(rows, dtype=np.float64)
        if known.size < 2 or (np.diff(known) <= 0).any():
            raise UnshutterError("key rows must be at least two, in increasing order")
        every_row = np.arange(height, dtype=np.float64)
        if degree is None:
            tx, rz = (_interpolate(every_row, known, np.asarray(a, dtype=np.float64)) for a in (tx_px, rz_rad))
        else:
            tx, rz = (np.polynomial.Polynomial.fit(known, a, degree)(every_row) for a in (tx_px, rz_rad))
        return cls(width, tx, rz, **about)

    # ---- what it says ----------------------------------------------------------------------------------

    @property
    def height(self) -> int:
        """Rows of the readout frame: the number of lines read out."""
        return len(self.tx_px)

    @property
    def reference_row(self) -> int:
        """Index of the row that has zero motion."""
        return {"first": 0, "middle": self.height // 2, "last": self.height - 1}[self.reference]

    @property
    def center(self) -> tuple[float, float]:
        """(col, row) of the rotation centre [px]."""
        return (self.width - 1) / 2 + self.center_shift_px, (self.height - 1) / 2

    @property
    def is_zero(self) -> bool:
        """Whether rectifying with this motion changes nothing."""
        return not (self.tx_px.any() or self.rz_rad.any())

    def rs_to_gs(self, col: Any, row: Any) -> tuple[np.ndarray, np.ndarray]:
        """RS positions [px] of the readout frame -> GS positions [px] (closed form)."""
        col, row = np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64)
        tx, rz, _ = self._at(row)
        return geometry.rs_to_gs(col, row, tx, rz, self.center)

    def gs_to_rs(self, col: Any, row: Any) -> tuple[np.ndarray, np.ndarray]:
        """GS positions [px] of the readout frame -> RS positions [px] (exact inverse)."""
        col, row = np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64)
        return geometry.gs_to_rs(col, row, self._at, self.center)

    def check_unfolded(self) -> None:
        """Passes where every place of the scene was seen by one row only.

        Raises:
            UnshutterError: the motion turns faster than rows are read.
        """
        turning = np.abs(np.diff(self.rz_rad)).max(initial=0.0)
        if turning * (self.width / 2 + np.abs(self.tx_px).max() + abs(self.center_shift_px)) >= 1:
            raise UnshutterError("the motion turns faster than rows are read: the picture would fold over itself")

    @cached_property
    def _at(self) -> geometry.RowMotion:
        """The motion of any row; carried on smoothly past the first and the last, where no photo looks.

        (Kinked there, the map would be costly to interpolate in the cells that straddle the border.)
        """
        tx, rz = (np.pad(a, BEYOND, mode="reflect", reflect_type="odd") for a in (self.tx_px, self.rz_rad))
        look_up = geometry.row_motion_from_samples(tx, rz)
        return lambda row: look_up(row + BEYOND)

    # ---- changed into ----------------------------------------------------------------------------------

    def rereferenced(self, reference: Reference) -> Motion:
        """The same camera motion, with the picture taken at another row's moment.

        Exact: the new GS picture is the old one turned by r_z and moved by t_x of the new reference row m.
        Substituting p_m = R(r_m) p + t_m in Eq. 1 gives t - t_m, r - r_m and a rotation centre moved by t_m.
        """
        row = replace(self, reference=reference).reference_row
        tx, rz = self.tx_px[row], self.rz_rad[row]
        shift = self.center_shift_px + float(tx)
        if not (self.rz_rad - rz).any():  # nothing rotates: the centre does not matter
            shift = 0.0
        return replace(self, reference=reference, tx_px=self.tx_px - tx, rz_rad=self.rz_rad - rz, center_shift_px=shift)

    def resized(self, height: int, width: int) -> Motion:
        """The same motion for the picture scaled to another size: t_x scales with the width, r_z stays.

        Rows are matched at their centres; the first and last slope carry on to the new borders.

        Raises:
            UnshutterError: the aspect ratio changes by more than two per cent (a rotation would not stay one).
        """
        self._check_aspect(height, width)
        if (height, width) == (self.height, self.width):
            return self
        at = (np.arange(height) + 0.5) * (self.height / height) - 0.5
        known = np.arange(self.height, dtype=np.float64)
        scale = width / self.width
        tx, rz = (_interpolate(at, known, a) for a in (self.tx_px * scale, self.rz_rad))
        moved = replace(self, width=width, tx_px=tx, rz_rad=rz, center_shift_px=self.center_shift_px * scale)
        return moved.rereferenced(self.reference)

    def scaled(self, strength: float) -> Motion:
        """Both motions times ``strength``: 0 does nothing, 1 is this motion."""
        if not 0 <= strength <= 1:
            raise UsageError(f"strength must lie between 0 and 1, got {strength:g}")
        return replace(
            self,
            tx_px=self.tx_px * strength,
            rz_rad=self.rz_rad * strength,
            center_shift_px=self.center_shift_px * strength,
        )

    def smoothed(self, degree: int) -> Motion:
        """Least-squares polynomials of the given degree over the rows (the paper's trajectory module: 3)."""
        tx, rz = self._smooth(np.stack([self.tx_px, self.rz_rad]), degree)
        return replace(self, tx_px=tx, rz_rad=rz)

    def _check_aspect(self, height: int, width: int) -> None:
        if abs((width / self.width) / (height / self.height) - 1) > 0.02 + 1 / min(height, self.height):
            raise UnshutterError(
                f"cannot fit a motion of {self.width}x{self.height} px to {width}x{height} px: "
                "the aspect ratio differs, it belongs to another photo or readout direction"
            )

    def _smooth(self, samples: np.ndarray, degree: int) -> np.ndarray:
        """Samples [K, H] replaced by their least-squares polynomials over the rows."""
        if not 0 <= degree < self.height:
            raise UsageError(f"a polynomial over {self.height} rows needs a degree from 0 to {self.height - 1}")
        coefficients = samples @ geometry.polynomial_projection(self.height, degree, like=samples)
        u = np.arange(self.height) / max(self.height - 1, 1)
        return np.stack([geometry.polynomial(c, u) for c in coefficients])

    # ---- file form -------------------------------------------------------------------------------------

    def to_json(self) -> str:
        """The motion as JSON text, format ``unshutter-motion/1`` (docs/conventions)."""
        from unshutter.motion.motion_file import to_json

        return to_json(self)

    @staticmethod
    def from_json(text: str) -> Motion:
        """Reads what :meth:`to_json` wrote.

        Raises:
            UnshutterError: the text is no motion of this format, or its numbers do not fit together.
        """
        from unshutter.motion.motion_file import from_json

        return from_json(text)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes :meth:`to_json` to a file, replacing what is there.

        Raises:
            UnshutterError: it cannot be written.
        """
        with written_whole(Path(path)) as part:
            part.write_text(self.to_json() + "\n", encoding="utf-8")

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Motion:
        """Reads a motion file.

        Raises:
            UnshutterError: the file cannot be read or is no motion.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not a text file"
            raise UnshutterError(f"cannot read motion file {path}: {reason}") from None
        try:
            return Motion.from_json(text)
        except UnshutterError as error:
            raise UnshutterError(f"{path}: {error}") from None


def _interpolate(at: np.ndarray, known_at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Linear interpolation that carries the first and the last slope on beyond the ends."""
    inner = np.interp(at, known_at, values)
    if len(known_at) < 2:
        return inner
    first = (values[1] - values[0]) / (known_at[1] - known_at[0])
    last = (values[-1] - values[-2]) / (known_at[-1] - known_at[-2])
    before = np.minimum(at - known_at[0], 0.0) * first
    after = np.maximum(at - known_at[-1], 0.0) * last
    return inner + before + after
