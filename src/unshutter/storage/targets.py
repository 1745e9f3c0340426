"""The files that may come of one photo, what each is for, and what was written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from unshutter.reasons import Worded


class TargetKind(Worded):
    """What a file is for: its word, and how messages call it."""

    PICTURE = "picture", "the picture"  # of a photo that changes
    MOTION = "motion", "its motion"
    MASK = "mask", "its mask"  # of the valid pixels of a photo that changes
    UNCHANGED = "unchanged", "the picture"  # of a photo that is left unchanged: usually a copy of its file
    UNCHANGED_MASK = "unchanged mask", "its mask"


@dataclass(frozen=True)
class Target:
    """A file that may be written."""

    path: Path
    kind: TargetKind = TargetKind.PICTURE
    left: str | None = None  # digest of what an earlier run wrote there; a file that still has it may be replaced


@dataclass(frozen=True)
class Written:
    """A file that was written."""

    path: Path
    kind: TargetKind = TargetKind.PICTURE
    left_out: tuple[str, ...] = ()  # names of metadata that it lacks: ("IPTC", "texts")
    encoded_as: str = ""  # its format, if a photo that is left unchanged was not copied: "PNG"
    fingerprint: str | None = None
    digest: str | None = None  # of its bytes, if it is recorded
