"""Pairs whose frames follow one another: what the neighbours of a frame make of it, and what others published of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.frame import SequenceOptions
from unshutter.frames.sequence_rectification import rectify_between
from unshutter.geometry.readout import Readout
from unshutter.options import Clock, FrameModel, Reference, Undo
from unshutter.photo import Photo
from unshutter_lab.evaluation.cases.case import Record, in_8_bits
from unshutter_lab.evaluation.cases.folders import Frame

# rows of the tables: with the model forced, and chosen
FRAMES: dict[str, FrameModel | None] = {"frames-camera": "camera", "frames-dense": "dense", "frames": None}
PUBLISHED = "psnr_published_"  # and the name of the method


def neighbours_of(frame: Frame) -> tuple[Path | None, Path | None]:
    """The files of the frames before and after, where they are there."""
    if frame.number < 0:
        return None, None
    before, after = (frame.rs.with_name(f"rs_{frame.number + way}{frame.rs.suffix}") for way in (-1, 1))
    return before if before.is_file() else None, after if after.is_file() else None


def by_neighbours(
    frame: Frame, ratio: float, reference: Reference, model: FrameModel | None
) -> tuple[np.ndarray, np.ndarray, Record]:
    """What ``unshutter rectify --before --after`` makes of a frame.

    Returns:
        uint8 [H, W, 1 or 3]; bool [H, W], which of it the frame saw; and the figures that all records have. A frame
        whose neighbours cannot be used is left unchanged.
    """
    photo = Photo.open(frame.rs)
    before, after = (path and Photo.open(path) for path in neighbours_of(frame))
    figures: Record = {"declined": "", "failed": "", "confidence": None}
    try:
        options = SequenceOptions(Clock(ratio), Undo(reference, edges="keep"), Readout.TOP_TO_BOTTOM, model=model)
        result = rectify_between(photo, before or None, after or None, options)
    except UnshutterError as error:
        whole = np.ones((photo.height, photo.width), bool)
        return in_8_bits(photo), whole, figures | {"declined": str(error)}
    return in_8_bits(result.photo), result.valid, figures | {"declined": result.reason, "model": result.model}


def published_of(frame: Frame, reference: str) -> dict[str, np.ndarray]:
    """Other methods' published pictures of a frame, if they lie next to it: name of the method -> uint8 [H, W, 1 or 3].

    The files are called published_METHOD_NUMBER_REFERENCE; those of another size are left out.
    """
    photo = Photo.open(frame.rs)
    others = {}
    for path in sorted(frame.rs.parent.glob(f"published_*_{frame.number}_{reference}{frame.rs.suffix}")):
        other = Photo.open(path)
        if (other.height, other.width) == (photo.height, photo.width):
            others[path.stem.split("_")[1]] = in_8_bits(other)
    return others
