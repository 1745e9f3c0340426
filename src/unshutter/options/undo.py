"""How a motion is undone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypedDict, get_args

from unshutter.errors import UsageError
from unshutter.options.description import option

MIN_CONFIDENCE = 0.02  # of a motion that is undone, unless a user says otherwise

Reference = Literal["first", "middle", "last"]
Edges = Literal["auto", "keep", "crop", "fill", "borrow"]


def check_edges(edges: str) -> None:
    """Raises UsageError where nothing is known of such edges, or they need more than the photo."""
    if edges not in get_args(Edges) or edges == "borrow":
        raise UsageError(f"unknown edges '{edges}': choose auto, keep, crop or fill")


def check_strength(strength: float) -> None:
    """Raises UsageError for a share of the motion that is not between 0 and 1."""
    if not 0 <= strength <= 1:
        raise UsageError(f"strength must lie between 0 and 1, got {strength:g}")


class UndoKeywords(TypedDict, total=False):
    """The fields of :class:`Undo` as keywords of Python's functions."""

    reference: Reference | None
    strength: float
    edges: Edges
    min_confidence: float


@dataclass(frozen=True)
class Undo:
    """How a motion is undone.

    Raises:
        UsageError: a value that is none of its choices.
    """

    reference: Reference | None = option(
        None, "Row at whose moment the picture is taken. Default: that of a given motion, else first."
    )
    strength: float = option(1.0, "How much of the motion to undo, 0 to 1.")
    edges: Edges = option(
        "auto",
        "Places the photo did not see: keep them empty (black, transparent with alpha), crop them away, or fill them "
        "with the nearest colour. auto crops if that leaves at least 80 % of the photo, and keeps them otherwise and "
        "where coordinates are those of the whole photo: with masks, saved motions and sequences, and for arrays and "
        "Pillow images in Python. borrow takes them from the neighbouring frames. Default: auto.",
    )
    min_confidence: float = option(
        MIN_CONFIDENCE,
        "Leave a photo as it is if its motion is less sure than this; 0 undoes the likeliest motion, however unsure. "
        "A motion that you give is undone whatever its confidence. "
        f"Default: {MIN_CONFIDENCE:g}.",
    )

    def __post_init__(self) -> None:
        check_strength(self.strength)
        if not 0 <= self.min_confidence <= 1:
            raise UsageError(f"the least confidence must lie between 0 and 1, got {self.min_confidence:g}")
        if self.edges != "borrow":
            check_edges(self.edges)
        if self.reference not in (None, *get_args(Reference)):
            raise UsageError(f"unknown reference row '{self.reference}': choose first, middle or last")

    def keeping_coordinates(self) -> Undo:
        """The same, but that automatic edges are kept: for results of which coordinates are wanted."""
        return replace(self, edges="keep") if self.edges == "auto" else self

    def of_given_motion(self) -> Undo:
        """The same for a motion that the user gives, which is undone however sure its estimator was.

        Raises:
            UsageError: a least confidence is asked for, too.
        """
        if self.min_confidence not in (0, MIN_CONFIDENCE):
            raise UsageError("a given motion is undone whatever its confidence: leave out the least confidence")
        return replace(self, min_confidence=0)
