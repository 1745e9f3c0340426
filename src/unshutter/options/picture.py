"""Options for computing and writing the rectified picture: undoing the motion, encoding the file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypedDict, get_args

from unshutter.errors import UsageError
from unshutter.options.description import option

MIN_CONFIDENCE = 0.02  # least confidence of a motion that is undone, unless the user sets another
MOST_STRENGTH = 2.0

Reference = Literal["first", "middle", "last"]
Edges = Literal["auto", "keep", "crop", "fill", "borrow"]


def check_edges(edges: str) -> None:
    """Checks a choice of edges that needs only the photo.

    Raises:
        UsageError: it is unknown, or needs other frames.
    """
    if edges not in get_args(Edges) or edges == "borrow":
        raise UsageError(f"unknown edges '{edges}': choose auto, keep, crop or fill")


def check_strength(strength: float) -> None:
    """Checks the share of the motion to undo.

    Raises:
        UsageError: it is negative or above :data:`MOST_STRENGTH`.
    """
    if not 0 <= strength <= MOST_STRENGTH:
        raise UsageError(f"strength must lie between 0 and {MOST_STRENGTH:g}, got {strength:g}")


class UndoKeywords(TypedDict, total=False):
    """Keyword arguments corresponding to the fields of :class:`Undo`."""

    reference: Reference | None
    strength: float
    edges: Edges
    min_confidence: float


@dataclass(frozen=True)
class Undo:
    """How a motion is undone.

    Raises:
        UsageError: a value is not one of its choices.
    """

    reference: Reference | None = option(
        None, "Row whose capture time the result shows. Default: taken from --motion, otherwise first."
    )
    strength: float = option(
        1.0, f"How much of the motion to undo, 0 to {MOST_STRENGTH:g}; 1 is all of it.", limits=(0, MOST_STRENGTH)
    )
    edges: Edges = option(
        "auto",
        "Areas outside the original photo: keep them empty (black, or transparent with alpha), crop them away, "
        "or fill them with a mirror image of the photo. auto crops if at least 80 % of the photo is left; "
        "otherwise it keeps them, as it does where coordinates refer to the whole photo: with masks, saved motions and "
        "sequences, and for arrays and Pillow images in Python. borrow takes them from the neighbouring "
        "frames. Default: auto.",
    )
    min_confidence: float = option(
        MIN_CONFIDENCE,
        "Leave a photo unchanged if the confidence in its motion is below this; 0 undoes the likeliest motion, however "
        "unsure. A motion that you supply is undone whatever its confidence. "
        f"Default: {MIN_CONFIDENCE:g}.",
        limits=(0, 1),
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
        """Returns the options with automatic edges set to keep, for results that keep the photo's coordinates."""
        return replace(self, edges="keep") if self.edges == "auto" else self

    def at_any_confidence(self) -> Undo:
        """Returns the options for a motion from the user, which is undone regardless of its confidence.

        Raises:
            UsageError: a least confidence is set as well.
        """
        if self.min_confidence not in (0, MIN_CONFIDENCE):
            raise UsageError("a given motion is undone whatever its confidence: leave out the least confidence")
        return replace(self, min_confidence=0)


PictureFormat = Literal["jpeg", "png", "webp", "tiff", "avif"]
Subsampling = Literal["4:4:4", "4:2:0"]


@dataclass(frozen=True)
class Save:
    """How a picture is written.

    Attributes:
        format: format of the file; None: the photo's own, AVIF for HEIC, 16-bit TIFF for raw files.
        quality: quality of JPEG, WebP and AVIF, 1 to 100; None: like the original.
        subsampling: chroma subsampling of JPEG and AVIF; None: like the original.
        keep_times: whether the file gets the access and modification time of the original.
        only_changed: whether to skip writing photos that are left unchanged.
        keep_names: whether results keep the names of their photos; only in another folder.

    Raises:
        UsageError: a value is not one of its choices.
    """

    format: PictureFormat | None = option(
        None, "File format of the results. Default: same as the photo; AVIF for HEIC, 16-bit TIFF for raw files."
    )
    quality: int | None = option(
        None, "Quality of JPEG, WebP and AVIF, 1 to 100. Default: close to the original's.", limits=(1, 100)
    )
    subsampling: Subsampling | None = option(
        None, "Colour at full (4:4:4) or half (4:2:0) resolution in JPEG and AVIF. Default: same as the original."
    )
    keep_times: bool = option(False, "Give each result the access and modification times of its photo.", page=False)
    only_changed: bool = option(False, "Write only photos that change. Default: copy the others.", page=False)
    keep_names: bool = option(
        False, "Keep the photos' file names for the results, in the folder set by --output.", page=False
    )

    def __post_init__(self) -> None:
        if self.quality is not None and not 1 <= self.quality <= 100:
            raise UsageError(f"quality must lie between 1 and 100, got {self.quality}")
        if self.subsampling not in (None, *get_args(Subsampling)):
            choices = ", ".join(get_args(Subsampling))
            raise UsageError(f"unknown subsampling '{self.subsampling}': choose one of {choices}")
        if self.format not in (None, *get_args(PictureFormat)):
            choices = ", ".join(get_args(PictureFormat))
            raise UsageError(f"unknown picture format '{self.format}': choose one of {choices}")
