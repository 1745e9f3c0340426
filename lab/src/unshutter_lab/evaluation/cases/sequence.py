"""Pairs of consecutive frames: results of using a frame's neighbours, and published results of other methods."""

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

# rows of the tables: with a fixed model, and with the chosen one
FRAMES: dict[str, FrameModel | None] = {"frames-camera": "camera", "frames-dense": "dense", "frames": None}
PUBLISHED = "psnr_published_"  # followed by the name of the method


def neighbours_of(frame: Frame) -> tuple[Path | None, Path | None]:
    """Returns the files of the previous and next frames, or None where missing."""
    if frame.number < 0:
        return None, None
    before, after = (frame.rs.with_name(f"rs_{frame.number + way}{frame.rs.suffix}") for way in (-1, 1))
    return before if before.is_file() else None, after if after.is_file() else None


def by_neighbours(
    frame: Frame, ratio: float, reference: Reference, model: FrameModel | None
) -> tuple[np.ndarray, np.ndarray, Record]:
    """Returns the result of ``unshutter rectify --before --after`` for a frame.

    Returns:
        uint8 [H, W, 1 or 3]; a bool mask [H, W] of the pixels the frame shows; and the figures common to all records.
        A frame whose neighbours cannot be used is left unchanged.
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
    """Returns other methods' published pictures of a frame next to it: name of the method -> uint8 [H, W, 1 or 3].

    The files are called published_METHOD_NUMBER_REFERENCE; those of another size are ignored.
    """
    photo = Photo.open(frame.rs)
    others = {}
    for path in sorted(frame.rs.parent.glob(f"published_*_{frame.number}_{reference}{frame.rs.suffix}")):
        other = Photo.open(path)
        if (other.height, other.width) == (photo.height, photo.width):
            others[path.stem.split("_")[1]] = in_8_bits(other)
    return others
