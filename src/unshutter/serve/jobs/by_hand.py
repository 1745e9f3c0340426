"""Motions set by hand: from lines drawn on a photo, and from sliders for lean, bend and turn."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, UsageError
from unshutter.options import Find, Rectify, Undo
from unshutter.photo import Photo
from unshutter.serve.fields import ByHand
from unshutter.serve.jobs.cache import OpenFile, digest, motion_of, opened, put
from unshutter.serve.jobs.screen import pixels_of

if TYPE_CHECKING:
    from unshutter.estimators.right_angles.drawn_lines import DrawnLine
    from unshutter.motion import Motion

NAME = "by-hand"  # recorded as the estimator of these motions


@dataclass(frozen=True)
class Shape:
    """A motion described by the three numbers that the page's sliders set.

    Attributes:
        lean_deg: angle by which the change in t_x from the first row to the last slants vertical lines.
        bend_percent: deviation of t_x at the middle row from the line between first and last row [% of the rows].
        turn_deg: r_z of the last row minus that of the first.
    """

    lean_deg: float
    bend_percent: float
    turn_deg: float

    @classmethod
    def of(cls, motion: Motion) -> Shape:
        """Measures the lean, bend and turn of a motion."""
        tx, rz, rows = motion.tx_px, motion.rz_rad, motion.height
        bend = (tx[(rows - 1) // 2] + tx[rows // 2]) / 2 - (tx[0] + tx[-1]) / 2
        lean = math.degrees(math.atan((tx[-1] - tx[0]) / rows))
        return cls(lean, 100 * float(bend) / rows, math.degrees(float(rz[-1] - rz[0])))


def motion_to_undo(open_file: OpenFile, photo: Photo, options: Rectify, hand: ByHand) -> Motion:
    """Returns the motion to undo, before strength is applied: from a motion file, set by hand, or estimated.

    Raises:
        UsageError: the lines cannot be parsed, or no camera motion has these numbers.
    """
    from unshutter.motion import Motion

    if options.motion is not None:
        return Motion.load(options.motion)
    if not hand:
        return motion_of(open_file, photo, options.find)
    motion = _motion_of_lines(open_file, photo, options.find, hand.lines) if hand.lines else None
    return _adjusted(motion or motion_of(open_file, photo, options.find), hand)


def undo_by_hand(options: Rectify, hand: ByHand) -> Undo:
    """Returns the options for undoing a motion, ignoring its confidence if it was set by hand."""
    return options.undo.at_any_confidence() if hand else options.undo


def with_motion_file(open_file: OpenFile, options: Rectify, hand: ByHand) -> Rectify:
    """Returns the options for saving, with a motion file if anything was set by hand and unchanged otherwise."""
    if not hand:
        return options
    motion = motion_to_undo(open_file, opened(open_file), options, hand)
    file = open_file.path.with_name(f"hand-{digest(options.find, hand)}.json")
    put(file, lambda part: part.write_text(motion.to_json(), encoding="utf-8"))
    return Rectify.of(motion=file, undo=options.undo, save=options.save)


def _motion_of_lines(open_file: OpenFile, photo: Photo, find: Find, text: str) -> Motion:
    """Estimates the motion from drawn lines, and caches it for adjustment with the sliders."""
    from unshutter.motion import Motion
    from unshutter.rectification import motion_of_lines

    file = open_file.path.with_name(f"lines-{digest(find, text)}.json")
    if file.exists():
        return Motion.from_json(file.read_text(encoding="utf-8"))
    motion = motion_of_lines(photo, _lines(text, photo), find.camera)
    put(file, lambda part: part.write_text(motion.to_json(), encoding="utf-8"))
    return motion


def _lines(text: str, photo: Photo) -> list[DrawnLine]:
    from unshutter.estimators.right_angles.drawn_lines import DrawnLine

    try:
        listed = [(kind, [float(share) for share in positions]) for kind, *positions in json.loads(text)]
    except (ValueError, TypeError, RecursionError):
        raise UsageError("'lines' takes JSON: [[kind, x, y, x, y, ...], ...]") from None
    lines = []
    for kind, positions in listed:
        if len(positions) % 2:
            raise UsageError("each position of a line has two numbers, x and y")
        points = pixels_of(positions[::2], positions[1::2], (photo.width, photo.height), photo.orientation)
        lines.append(DrawnLine(kind, tuple(map(tuple, points.tolist()))))
    return lines


def _adjusted(motion: Motion, hand: ByHand) -> Motion:
    """Applies the numbers set by hand to a motion; everything else about it is left unchanged."""
    import numpy as np

    from unshutter.motion import RowMotion

    shape, u = Shape.of(motion), np.linspace(0, 1, motion.height)
    lean = _tangent(shape.lean_deg if hand.lean_deg is None else hand.lean_deg) - _tangent(shape.lean_deg)
    bend = 0.0 if hand.bend_percent is None else hand.bend_percent - shape.bend_percent
    turn = 0.0 if hand.turn_deg is None else hand.turn_deg - shape.turn_deg
    tx_px = motion.tx_px + motion.height * (lean * u + bend / 100 * 4 * u * (1 - u))
    rz_rad = motion.rz_rad + math.radians(turn) * u
    adjusted = RowMotion(motion.width, tx_px, rz_rad, readout=motion.readout, estimator=NAME)
    try:
        adjusted.check_unfolded()
    except UnshutterError:
        raise UsageError("no camera moves like that: the picture would fold over itself") from None
    return adjusted


def _tangent(angle_deg: float) -> float:
    return math.tan(math.radians(angle_deg))
