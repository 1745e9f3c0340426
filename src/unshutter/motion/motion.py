"""Motion: the camera's motion during the readout of one photo; the interface shared by all kinds of motion."""

from __future__ import annotations

import json
import math
import os
from abc import ABC, abstractmethod
from dataclasses import KW_ONLY, dataclass, fields
from functools import cached_property, partial
from typing import ClassVar, Self

import numpy as np

from unshutter import version
from unshutter.errors import UnshutterError, UsageError, shortened
from unshutter.motion import motion_file
from unshutter.motion.motion_file import Common
from unshutter.motion.shapes import ArrayLike, Float, Float64, Numbers
from unshutter.options import Reference
from unshutter.orientation import ScanDirection
from unshutter.reasons import JsonObject

BEYOND = 128  # rows beyond the first and last to which a motion is extrapolated smoothly


def row_index(reference: Reference, height: int) -> int:
    """Returns the index of a reference row."""
    rows = {"first": 0, "middle": height // 2, "last": height - 1}
    if reference not in rows:
        raise UsageError(f"unknown reference row '{reference}': choose first, middle or last")
    return rows[reference]


def matching_rows(height: int, new_height: int) -> Float64[np.ndarray, "{new_height}"]:
    """[new_height] positions, by row centres, of the rows of a picture scaled to ``new_height`` in the original."""
    return (np.arange(new_height) + 0.5) * (height / new_height) - 0.5


def interpolated(
    at: Float[np.ndarray, "rows"], known_at: Float[np.ndarray, "known"], values: Float[np.ndarray, "known"]
) -> Float[np.ndarray, "rows"]:
    """Interpolates linearly, extrapolating the first and last slopes beyond the ends."""
    inner = np.interp(at, known_at, values)
    if len(known_at) < 2:
        return inner
    first = (values[1] - values[0]) / (known_at[1] - known_at[0])
    last = (values[-1] - values[-2]) / (known_at[-1] - known_at[-2])
    before = np.minimum(at - known_at[0], 0.0) * first
    after = np.maximum(at - known_at[-1], 0.0) * last
    return inner + before + after


def slope(values: Float[np.ndarray, "rows *rest"]) -> Float[np.ndarray, "rows *rest"]:
    """Returns the change per row of values [H, ...] with at least two rows."""
    return np.gradient(values, axis=0, edge_order=2 if len(values) > 2 else 1)


def positions(col: ArrayLike, row: ArrayLike) -> tuple[Float64[np.ndarray, "*at"], Float64[np.ndarray, "*at"]]:
    """Returns two float64 arrays broadcast to a common shape."""
    col, row = np.broadcast_arrays(np.asarray(col, dtype=np.float64), np.asarray(row, dtype=np.float64))
    return col, row


@dataclass(frozen=True, eq=False, repr=False)
class Motion(ABC):
    """Camera motion during the readout of one photo, in its readout frame (orientation.py).

    It is geometry; what is known about it, such as who found it and how sure that is, is in a
    :class:`~unshutter.Finding`.

    Abstract: each kind of motion is a final class that defines how positions are mapped; none overrides
    the concrete methods below. A new kind is a subclass, ``class MyMotion(Motion, kind="my-tag")``, that
    ``motion/__init__.py`` imports; the tag identifies the class in motion files.

    Attributes:
        width: columns of the readout frame [px].
        reference: the row (first | middle | last) whose time is that of the global-shutter picture;
            the motion is zero there.
        scan_direction: direction in which the stored pixels were read.

    Raises:
        UnshutterError: a value is not finite, is impossible for a photo, or contradicts another value.
        UsageError: unknown reference row.
    """

    kind: ClassVar[str]
    _kinds: ClassVar[dict[str, type[Motion]]] = {}

    width: int
    _: KW_ONLY
    reference: Reference = "first"
    scan_direction: ScanDirection = ScanDirection.TOP_TO_BOTTOM

    def __init_subclass__(cls, *, kind: str) -> None:
        super().__init_subclass__()
        cls.kind = kind
        Motion._kinds[kind] = cls

    def __post_init__(self) -> None:
        self._settle()
        tx = self.tx_px.shape
        rz = self.rz_rad.shape
        if len(tx) != 1 or tx != rz or tx[0] < 1:
            raise UnshutterError(f"a motion needs one t_x and one r_z per row, got shapes {tx} and {rz}")
        motion_file.check_lengths(self.tx_px)
        motion_file.check_rotations(self.rz_rad)
        motion_file.check_size(self.height, self.width)
        row_index(self.reference, self.height)

    # ---- defined by each kind --------------------------------------------------------------------------

    @property
    @abstractmethod
    def tx_px(self) -> np.ndarray:
        """[H] t_x of every row [px], positive moves the scene to the right (paper, Eq. 1)."""

    @property
    @abstractmethod
    def rz_rad(self) -> np.ndarray:
        """[H] r_z of every row [rad], positive turns the scene clockwise as seen in the picture (paper, Eq. 1)."""

    @property
    @abstractmethod
    def is_zero(self) -> bool:
        """Whether rectifying with this motion leaves the picture unchanged."""

    @abstractmethod
    def rs_to_gs(self, col: ArrayLike, row: ArrayLike) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps RS positions [px] of the readout frame to GS positions [px]."""

    @abstractmethod
    def gs_to_rs(self, col: ArrayLike, row: ArrayLike) -> tuple[Float64[Numbers, "*at"], Float64[Numbers, "*at"]]:
        """Maps GS positions [px] of the readout frame to RS positions [px]."""

    @abstractmethod
    def check_unfolded(self) -> None:
        """Checks that every point of the scene was read by one row only.

        Raises:
            UnshutterError: the motion turns faster than rows are read.
        """

    @abstractmethod
    def rates(self) -> tuple[Float64[np.ndarray, "rows"], Float64[np.ndarray, "rows 2"]]:
        """Returns how fast the picture moved at each row, of at least two; the reference row has no influence.

        Returns:
            Angular rate [H] about the viewing axis [rad per row], positive clockwise as seen in the picture, and
            velocity [H, 2], (col, row) of the scene in the middle of the picture [px per row].
        """

    @abstractmethod
    def rereferenced(self, reference: Reference) -> Self:
        """Returns the same camera motion relative to another reference row."""

    @abstractmethod
    def resized(self, height: int, width: int) -> Self:
        """Returns this motion for the picture scaled to another size.

        Rows are matched at their centres; the first and last slopes are extrapolated to the new borders.

        Raises:
            UnshutterError: the aspect ratio changes by more than two per cent (a rotation would not remain one).
        """

    @abstractmethod
    def scaled(self, strength: float) -> Self:
        """Returns the motion multiplied by ``strength``: 0 has no effect, 1 is this motion.

        Raises:
            UsageError: ``strength`` is below 0 or above 2.
        """

    @abstractmethod
    def _settle(self) -> None:
        """Checks the attributes specific to this kind and makes its arrays read-only; called first on construction."""

    @abstractmethod
    def _own_data(self) -> JsonObject:
        """Returns the JSON keys specific to this kind, which the motion file adds to the common ones."""

    @classmethod
    @abstractmethod
    def _of_data(cls, data: JsonObject, common: Common) -> Self:
        """Builds the motion from the contents of a motion file."""

    # ---- shared by all kinds ---------------------------------------------------------------------------

    @property
    def height(self) -> int:
        """Rows of the readout frame: the number of lines read out."""
        return len(self.tx_px)

    @property
    def reference_row(self) -> int:
        """Index of the reference row, whose motion is zero."""
        return row_index(self.reference, self.height)

    @cached_property
    def largest_px(self) -> float:
        """Largest displacement of any point of the picture [px], whatever its cause (t_x, r_z, other rotations)."""
        row = np.arange(self.height, dtype=np.float64)[:, None]
        col = np.array([[0.0, (self.width - 1) / 2, self.width - 1.0]])
        moved = self.rs_to_gs(col, row)
        return float(np.hypot(moved[0] - col, moved[1] - row).max())

    @property
    def common(self) -> Common:
        """Attributes shared by all kinds, by name."""
        return Common(width=self.width, reference=self.reference, scan_direction=self.scan_direction)

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return all(np.array_equal(getattr(self, field.name), getattr(other, field.name)) for field in fields(self))

    def __hash__(self) -> int:
        return hash((self.kind, self.height, self.tx_px.tobytes(), *self.common.values()))

    def __repr__(self) -> str:
        shift = f"t_x up to {np.abs(self.tx_px).max():.1f} px"
        rotation = f"r_z up to {np.degrees(np.abs(self.rz_rad).max()):.1f} deg"
        return f"{type(self).__name__}({self.height} rows x {self.width}, {shift}, {rotation})"

    def __reduce__(self) -> tuple:  # cached look-up functions cannot be pickled; they are rebuilt
        return partial(type(self), **{field.name: getattr(self, field.name) for field in fields(self)}), ()

    # ---- file format -----------------------------------------------------------------------------------

    def to_json(self) -> str:
        """Returns the motion as JSON text, format ``unshutter-motion/1`` (docs/reference/conventions), as given."""
        return json.dumps(self.as_data(motion_file.GIVEN))

    def as_data(self, answer: JsonObject) -> JsonObject:
        """Returns the contents of a motion file in order, including the keys of an answer about the motion."""
        largest = self.largest_px
        return {
            "format": motion_file.FORMAT,
            "kind": self.kind,
            "height": self.height,
            "width": self.width,
            "readout": str(self.scan_direction),
            "reference": self.reference,
            "reference_row": self.reference_row,
            "largest_px": round(largest, 3) if math.isfinite(largest) else None,
            "tx_px": self.tx_px.tolist(),
            "rz_rad": self.rz_rad.tolist(),
            **answer,
            **self._own_data(),
        }

    @staticmethod
    def from_json(text: str) -> Motion:
        """Parses the text of a motion file and returns the motion alone, without its :class:`~unshutter.Finding`.

        Raises:
            UnshutterError: the text is not a motion of this format, or its values are inconsistent.
        """
        with motion_file.reading():
            return Motion.of_data(motion_file.parsed(text))

    @staticmethod
    def of_data(data: JsonObject) -> Motion:
        """Returns the motion in the contents of a motion file, of the stored kind; call it inside ``reading``.

        Raises:
            UnshutterError: no installed package has the kind, or the values are inconsistent.
        """
        first_kinds = "rotations" if "rotations_rad" in data else "rows"  # the earliest files do not name theirs
        kind = str(data.get("kind", first_kinds))
        height = motion_file.whole_number(data["height"])
        if kind not in Motion._kinds:
            version.import_method(str(data.get("estimator")))
        if kind not in Motion._kinds:
            made_by = shortened(data.get("estimator"))
            raise UnshutterError(
                f"cannot read motions of kind '{shortened(kind)}': install the package of the method that found it "
                f"({made_by}; {version.lab()} has research methods), or a newer version"
            )
        motion = Motion._kinds[kind]._of_data(data, motion_file.common_of(data))
        if height != motion.height:
            raise UnshutterError(f"the motion file states a height of {height} but has {motion.height} rows")
        return motion

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes :meth:`to_json` to a file, replacing a motion file of this name.

        Raises:
            UsageError: the name does not end in ``.json``.
            UnshutterError: the file cannot be written, or is another file than a motion.
        """
        motion_file.save(path, self.to_json())

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Motion:
        """Reads the motion in a motion file.

        Raises:
            MissingFileError: there is no such file.
            UnshutterError: the file cannot be read or is not a motion.
        """
        return motion_file.read_file(path, Motion.from_json)
