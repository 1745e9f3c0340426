"""Jobs on photos: upright previews with facts about them, and results identical to the command line's.

The motion of an open photo is estimated and cached, or set by hand with lines drawn on it and numbers.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from unshutter.api import motion_of_lines
from unshutter.errors import UnshutterError, UsageError
from unshutter.motion.edges import EdgeDecision, EdgePolicy, valid_window
from unshutter.motion.finding import Finding
from unshutter.motion.grid import Tile, rs_to_gs_map
from unshutter.motion.lean import Lean
from unshutter.motion.verdict import LEAST_PX, Certainty, Verdict, judge
from unshutter.motion.warp import edge_decision, straighten, validity_mask
from unshutter.options import LEAST_GOOD_CROP, DecisionOptions, Find, Rectify, Undo
from unshutter.orientation import Orientation
from unshutter.page.opened import OpenFile, errors_of, neighbour_names, remembered
from unshutter.page.screen import arrows, as_jpeg, corners_of, opened, pixels_of, shares, small_copy
from unshutter.page.sentences import reason_json, verdict_json
from unshutter.page.settings import ByHand, PhotoOptions
from unshutter.photo import Photo
from unshutter.photo.libvips import libvips
from unshutter.readout_time import ReadoutRatio
from unshutter.reasons import JsonObject, MotionSource, rounded
from unshutter.rectification.find import find as find_motion
from unshutter.rectification.sequences import rectify_between, with_ratio
from unshutter.run.bursts import look_like_bursts
from unshutter.run.job import Job, Work
from unshutter.run.sequences import sequence_options
from unshutter.run.work import rectify_photo
from unshutter.single.drawn_lines import DrawnLine, StraightenedLines
from unshutter.single.likelihood import MOST_SEGMENTS, SHORT_SIDE, find_segments
from unshutter.single.register import load
from unshutter.storage.targets import Target, TargetKind

_RIM = 2  # px around a crop that a browser may blend with those in it
_ROUNDED = 1e-6  # by which rounding may move a border between two pixels
NAME = "by-hand"  # recorded as the estimator of motions set by hand


def warm() -> int:
    """Preloads what the first photo would otherwise have to wait for, and returns the process id."""
    libvips()
    load().prepare()
    return os.getpid()


def estimate(open_file: OpenFile, options: PhotoOptions) -> str:
    """Returns the photo's motion as JSON, in the format of `unshutter estimate`."""
    with errors_of(open_file):
        finding, undo = _find(open_file, opened(open_file), options)
        return finding.rereferenced(undo.reference or "first").to_json() + "\n"


def save(open_file: OpenFile, target: Path, unchanged: Path | None, options: PhotoOptions) -> JsonObject:
    """Writes the rectified photo exactly as `unshutter rectify` does, and returns the verdict and a note as JSON.

    A photo that is left unchanged is written to ``unchanged``, or not at all; ``result`` is the name of the file.
    """
    names = {path: path.name for path in (target, unchanged) if path is not None}
    with errors_of(open_file, {**names, **neighbour_names(options.neighbours)}):
        asked, finding = _with_known_motion(open_file, options)
        targets = [Target(target)]
        if unchanged is not None:
            targets.append(Target(unchanged, TargetKind.UNCHANGED))
        outcome = rectify_photo(Job(open_file.path, tuple(targets)), Work(asked, finding, open_file.max_pixels))
    report = outcome.verdict.as_json() if outcome.verdict else {}
    report |= {"result": outcome.picture.name} if outcome.picture is not None else {}
    report |= {"left_out": outcome.left_out} if outcome.left_out else {}
    return {**report, "note": outcome.note} if outcome.note else report


def candidates(open_file: OpenFile, options: PhotoOptions) -> list[JsonObject]:
    """Lists the motions that fit a photo as JSON, in the order of option ``candidate``; ``taken``: the default."""
    find = options.rectify.find
    find = replace(find, candidate=None, decision=DecisionOptions())
    with errors_of(open_file):
        possible = _find_motion(open_file, opened(open_file), find).candidates
        verdicts = [judge(each.finding, options.undo) for each in possible]
    taken = 0 if verdicts[0].changes else next((k for k, each in enumerate(possible) if each.kind == "still"), None)
    return [
        {
            "kind": each.kind,
            "direction": each.direction if each.kind == "pan" else None,
            "largest_px": round(verdict.largest_px, 2),  # at the requested strength
            "visible": each.kind == "still" or verdict.largest_px >= LEAST_PX,
            "within_error": each.is_within_error,
            "probability": rounded(each.probability, 4),
            "certainty": None if each.kind == "still" or each.probability is None else Certainty.of(each.probability),
            "taken": taken == k,
        }
        for k, (each, verdict) in enumerate(zip(possible, verdicts, strict=True))
    ]


def segments(open_file: OpenFile, options: PhotoOptions) -> JsonObject:
    """Returns the line segments that estimators use, before and after, as shares of the upright photo's size."""
    with errors_of(open_file, neighbour_names(options.neighbours)):
        photo = opened(open_file)
        grey = photo.grey(SHORT_SIDE)
        ends = find_segments(grey, MOST_SEGMENTS).reshape(-1, 2)
        scale = np.array([photo.width / grey.shape[1], photo.height / grey.shape[0]])
        col, row = ((ends + 0.5) * scale - 0.5).T
        found = {"before": (col, row)}
        if not options.neighbours:  # motion from neighbours applies to places, not to lines
            verdict = judge(*_find(open_file, photo, options))
            found["after"] = rs_to_gs_map(verdict.motion, verdict.upright)(col, row)
        size = photo.width, photo.height
        return {
            side: shares(*at, size, photo.orientation).reshape(-1, 4).round(4).tolist() for side, at in found.items()
        }


def bursts(open_files: Sequence[OpenFile]) -> list[list[str]]:
    """Returns the ids of photos that look like bursts, each burst in the order in which it was taken."""
    ids = {each.path: each.id for each in open_files}
    most = max((each.max_pixels for each in open_files), default=0)
    return [[ids[place] for place in burst] for burst in look_like_bursts(list(ids), most)]


def before(open_file: OpenFile, longest: int | None) -> tuple[bytes, JsonObject]:
    """Returns the upright photo as a JPEG for the screen, and its upright size and readout directions as JSON.

    Its longer side has ``longest`` px, or full size if that is None.
    """
    with errors_of(open_file):
        photo = opened(open_file)
        jpeg = as_jpeg(small_copy(open_file, photo, longest), photo.orientation)
        height, width = Orientation(photo.orientation).size(photo.height, photo.width)
        facts = {"height": height, "width": width, "arrows": arrows(photo.orientation)}
        return jpeg, facts | {"hdr_formats": photo.hdr_formats}


def after(
    open_file: OpenFile, options: PhotoOptions, longest: int | None, draft: bool = False
) -> tuple[bytes, JsonObject]:
    """Returns the rectified photo, uncropped, as :func:`before` does, and what was done to it as JSON.

    A draft saves time while something is being dragged: decisions are based on the small copy, and the crop is not
    computed.
    """
    with errors_of(open_file, neighbour_names(options.neighbours)):
        asked = options.rectify
        photo = opened(open_file)
        if asked.neighbours:
            pixels, result = _rectify_between(open_file, photo, asked, longest)
        else:
            finding, undo = _find(open_file, photo, options)
            pixels, result = _rectify_alone(photo, small_copy(open_file, photo, longest), finding, undo, draft)
            shape = {name: round(value, 3) for name, value in vars(Lean.of(finding.motion)).items()}
            result |= {"shape": shape, "readout": str(finding.motion.scan_direction)}
            if options.hand.lines:
                result["lines"] = _straighten_lines(open_file, photo, asked.find, options.hand.lines).troubles
        uncropped = {"edges": None, "area_left": None, "little_left": False, "crop": None}
        return as_jpeg(pixels, photo.orientation), uncropped | result


def _rectify_alone(
    photo: Photo, pixels: np.ndarray, finding: Finding, undo: Undo, draft: bool
) -> tuple[np.ndarray, JsonObject]:
    """Undoes a motion in a small copy; decisions are made at full size, as for saving, or at that of a draft's copy."""
    height, width = pixels.shape[:2]
    verdict = judge(finding.fit(height, width) if draft else finding, undo)
    if draft:
        verdict = replace(verdict, largest_px=verdict.largest_px * photo.height / height)
    result = {**verdict_json(verdict), **_finding_json(verdict)}
    if not verdict.changes:
        return pixels, result
    motion = verdict.motion
    upright = verdict.upright
    if not draft:
        decision = edge_decision(motion, undo.edges, upright)
        result = result | _edges_json(decision, (photo.height, photo.width), photo.orientation)
        motion = motion.resized(*motion.scan_direction.frame_size(height, width))
    shown = straighten(pixels, motion, "fill" if undo.edges == "fill" else "keep", upright=upright)[0]
    if not draft and decision.edges == "crop":
        shown = _rim_repeated(shown, validity_mask(motion, upright), decision.window, (photo.height, photo.width))
    return shown, result


def _rectify_between(
    open_file: OpenFile, photo: Photo, options: Rectify, longest: int | None
) -> tuple[np.ndarray, JsonObject]:
    """Rectifies a small copy of the photo, using small copies of its neighbours."""
    frames = options.neighbours
    scale = 1.0 if longest is None else max(max(photo.height, photo.width) / longest, 1.0)
    focal_px = options.find.camera.focal_px or photo.focal_px()
    sequence = replace(sequence_options(options), uncropped=True, focal_px=focal_px and focal_px / scale)
    neighbours = [path and replace(open_file, path=path) for path in (frames.before, frames.after)]
    for each in map(opened, filter(None, neighbours)):
        if (each.height, each.width) != (photo.height, photo.width):
            sizes = f"it has {each.width} × {each.height} px and the photo {photo.width} × {photo.height} px"
            raise UnshutterError(f"{sizes}: they are not from the same burst or clip")
    ratio = sequence.time
    if ratio is None:  # by the files themselves, as for saving
        files = [each for each in (neighbours[0], open_file, neighbours[1]) if each is not None]

        def find_ratio() -> ReadoutRatio | None:
            return with_ratio([opened(each) for each in files], replace(sequence, focal_px=focal_px)).time

        key = frames, options.undo, focal_px, sequence.scan_direction, sequence.model, sequence.at, sequence.alone
        ratio = remembered(open_file, "ratio", key, find_ratio)
        sequence = replace(sequence, time=ratio)
    copies = [each and Photo.from_array(small_copy(each, opened(each), longest)) for each in neighbours]
    frame = rectify_between(Photo.from_array(small_copy(open_file, photo, longest)), copies[0], copies[1], sequence)
    verdict = replace(frame.verdict, largest_px=frame.verdict.largest_px * scale)
    result = {**verdict_json(verdict), "neighbours": True, "shape": None, "readout": str(sequence.scan_direction)}
    result["ratio"] = None if ratio is None else {"value": round(ratio.value, 3), "source": ratio.source}
    if not frame.changed:
        return frame.pixels, result
    decision = EdgePolicy(options.undo.edges).decide(
        frame.valid.shape, lambda: valid_window(frame.valid, any_shape=True)
    )
    if frame.edges == "borrow":
        decision = decision._replace(edges="borrow")
    edges = _edges_json(decision, frame.valid.shape, photo.orientation)
    pixels = frame.pixels
    if edges["crop"] is not None:
        pixels = _rim_repeated(pixels, frame.valid, decision.window, frame.valid.shape)
    return pixels, result | edges


def _rim_repeated(pixels: np.ndarray, seen: np.ndarray, window: Tile, size: tuple[int, int]) -> np.ndarray:
    """Repeats the border of a crop's window outwards, into pixels [H, W, bands] of a small copy that nobody saw.

    The window may cut through pixels of the copy, and a browser that enlarges the copy blends those next to the window
    with those in it: none of them may be black.

    Args:
        seen: bool [H, W], the pixels that the photo or its neighbours show.
        window: in the photo, of ``size`` height and width [px].
    """

    def along(first: int, last: int, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns the places in and near the window, and for each the nearest one whose pixel lies in it entirely."""
        scale = pixels.shape[axis] / size[axis]
        low, high = math.ceil(first * scale - _ROUNDED), math.floor(last * scale + _ROUNDED)
        places = np.arange(max(low - _RIM, 0), min(high + _RIM, pixels.shape[axis]))
        return places, places.clip(low, max(high - 1, low))

    rows, from_rows = along(window.top, window.bottom, 0)
    cols, from_cols = along(window.left, window.right, 1)
    near = np.ix_(rows, cols)
    result = pixels.copy()
    result[near] = np.where(seen[near][..., None], pixels[near], pixels[np.ix_(from_rows, from_cols)])
    return result


def _finding_json(verdict: Verdict) -> JsonObject:
    """Returns the curves of the motion that was found at a few rows, and what is known of the camera."""
    found = verdict.finding
    motion = found.motion
    roll_deg, tilt_deg = (None if angle is None else angle.deg for angle in (found.roll, found.tilt))
    rows = np.linspace(0, motion.height - 1, 41).round().astype(int)
    return {
        "attitude": {"roll_deg": roll_deg, "tilt_deg": tilt_deg, "from": found.attitude_from},
        "film": reason_json(found.video_unused) if found.video_unused else None,
        "tx_px": np.round(motion.tx_px[rows], 2).tolist(),
        "rz_deg": np.round(np.degrees(motion.rz_rad[rows]), 3).tolist(),
    }


def _edges_json(decision: EdgeDecision, size: tuple[int, int], orientation: int) -> JsonObject:
    """Describes a decision about edges of stored pixels of height x width; the crop in shares of the upright photo."""
    (height, width), window = size, decision.window
    shares_left = window.left / width, window.top / height, window.right / width, window.bottom / height
    crop = corners_of(shares_left, orientation) if decision.edges in ("crop", "borrow") else None
    little = decision.area_left is not None and decision.area_left < LEAST_GOOD_CROP
    return {"edges": decision.edges, "area_left": decision.area_left, "little_left": little, "crop": crop}


# ---- the motion ------------------------------------------------------------------------------------------------


def _find(open_file: OpenFile, photo: Photo, options: PhotoOptions) -> tuple[Finding, Undo]:
    """Returns the motion before strength is applied, and how to undo it: at any confidence if it was set by hand."""
    asked = options.rectify
    if options.hand.lines:
        finding = _straighten_lines(open_file, photo, asked.find, options.hand.lines).finding
    else:
        finding = _find_motion(open_file, photo, asked.find).choose(asked.find.candidate)
    if not options.hand:
        return finding, asked.undo
    # lines that a person draws upright come out upright anyway
    return _adjust(finding, options.hand), replace(asked.undo, upright=None).at_any_confidence()


def _with_known_motion(open_file: OpenFile, options: PhotoOptions) -> tuple[Rectify, Finding | None]:
    """Returns the options for saving what the page shows, and the motion unless neighbours show it."""
    asked = options.rectify
    if asked.neighbours:
        return asked, None
    finding, undo = _find(open_file, opened(open_file), options)
    return replace(asked, undo=undo), finding


def _find_motion(open_file: OpenFile, photo: Photo, find: Find) -> Finding:
    """Returns the motions that fit a photo, estimating them unless cached; the first row is the reference."""
    alone = replace(find, candidate=None)  # whichever candidate is chosen
    candidates = remembered(open_file, "candidates", (alone,), lambda: find_motion(photo, find).candidates)
    return replace(candidates[0].finding, candidates=candidates)


# ---- by hand -----------------------------------------------------------------------------------------------------


def _straighten_lines(open_file: OpenFile, photo: Photo, find: Find, text: str) -> StraightenedLines:
    """Returns the motion that straightens drawn lines, and the trouble with each; cached."""
    return remembered(
        open_file, "lines", (find, text), lambda: motion_of_lines(photo, _lines(text, photo), find.camera)
    )


def _lines(text: str, photo: Photo) -> list[DrawnLine]:
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


def _adjust(finding: Finding, hand: ByHand) -> Finding:
    """Returns a motion set by hand: the one that was found, changed by the numbers."""
    lean = Lean.of(finding.motion)
    numbers = {name: value for name in vars(lean) if (value := getattr(hand, name)) is not None}
    try:
        adjusted = replace(lean, **numbers).given_to(finding.motion)
    except UnshutterError:
        raise UsageError("no camera moves like that: the picture would fold over itself") from None
    return Finding(adjusted, estimator=NAME, source=MotionSource.HAND)
