"""Jobs on a photo: files as the command line writes them, and small upright pictures for the screen with facts."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from unshutter.batch.job import Job
from unshutter.options import Find, Rectify, Reference
from unshutter.serve.jobs.cache import (
    OpenFile,
    errors_of,
    found_motion,
    motion_file,
    neighbour_names,
    opened,
    small_copy,
)

if TYPE_CHECKING:
    import numpy as np

    from unshutter.motion import Motion
    from unshutter.photo import Photo

# Stored pixels, what was found and done, and (left, top, right, bottom) of the part that is kept, as shares.
Shown: TypeAlias = "tuple[np.ndarray, dict[str, Any], tuple[float, float, float, float]]"

_WHOLE = (0.0, 0.0, 1.0, 1.0)
_SCREEN_QUALITY = 88
_CURVE_POINTS = 41


def warm() -> int:
    """Loads what the first photo would wait for; returns the number of this process."""
    import unshutter.rectification
    import unshutter.warp.pixels  # noqa: F401
    from unshutter.estimators.register import load
    from unshutter.photo.libvips import libvips

    libvips()
    load().prepare()
    return os.getpid()


def estimated(open_file: OpenFile, find: Find, reference: Reference) -> str:
    """The photo's motion as JSON, as `unshutter estimate` writes it.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    with errors_of(open_file):
        return found_motion(open_file, opened(open_file), find).rereferenced(reference).to_json() + "\n"


def saved(open_file: OpenFile, target: Path, wanted: Rectify) -> dict[str, Any]:
    """Writes the rectified photo exactly as `unshutter rectify` does; returns the verdict and a note, for programs.

    Raises:
        UnshutterError, UsageError: something about the photo or the options makes it impossible.
    """
    from unshutter.batch.work import finish_job

    names = {target: target.name, **neighbour_names(wanted.neighbours)}
    if wanted.motion is not None:
        names[wanted.motion] = "the motion"
    with errors_of(open_file, names):
        job = Job(open_file.path, target, None, overwrite=False, max_pixels=open_file.max_pixels)
        outcome = finish_job(job, wanted, _known_motion(open_file, wanted))
    about = outcome.verdict.as_json() if outcome.verdict else {}
    return {**about, "note": outcome.note} if outcome.note else about


def _known_motion(open_file: OpenFile, wanted: Rectify) -> str | None:
    """The text of the motion that is sent along, or was found for the screen; None: it is to be found."""
    if wanted.neighbours:
        return None
    if wanted.motion is not None:
        from unshutter.motion import Motion

        return Motion.load(wanted.motion).to_json()
    file = motion_file(open_file, wanted.find)
    return file.read_text(encoding="utf-8") if file.exists() else None


def before(open_file: OpenFile, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """The photo as a JPEG for the screen, upright, and what its file says.

    Args:
        open_file: the photo.
        longest: longer side [px]; None: full size.

    Raises:
        UnshutterError: it cannot be read.
    """
    with errors_of(open_file):
        return _before(open_file, longest)


def after(open_file: OpenFile, wanted: Rectify, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """The rectified photo for the screen, upright and not cropped, and what was found and done.

    Raises:
        UnshutterError, UsageError: see :func:`unshutter.result.undo`.
    """
    with errors_of(open_file, neighbour_names(wanted.neighbours)):
        return _after(open_file, wanted, longest)


def segments(open_file: OpenFile, wanted: Rectify) -> dict[str, Any]:
    """The line segments that methods look at: shares of width and height of the upright photo, before and after.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    with errors_of(open_file, neighbour_names(wanted.neighbours)):
        return _segments(open_file, wanted)


def _before(open_file: OpenFile, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    from unshutter.geometry.readout import Orientation
    from unshutter.serve.upright import arrows

    photo = opened(open_file)
    pixels = small_copy(open_file, photo, longest)
    held_so = photo.attitude
    height, width = Orientation(photo.orientation).size(photo.height, photo.width)
    return as_jpeg(pixels, photo.orientation), {
        "format": photo.format,
        "height": height,
        "width": width,
        "focal_px": photo.focal_px() or 0.85 * (photo.height + photo.width),
        "exposure_s": photo.exposure_s(),
        "arrows": arrows(photo.orientation),
        "attitude": held_so and {"roll_deg": held_so.roll_deg, "tilt_deg": held_so.tilt_deg, "from": held_so.source},
    }


def _after(open_file: OpenFile, wanted: Rectify, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    from unshutter.serve.upright import corners_of

    photo = opened(open_file)
    made = _shown_between if wanted.neighbours else _shown_alone
    pixels, told, window = made(open_file, photo, wanted, longest)
    crop = corners_of(window, photo.orientation) if told["edges"] == "crop" else None
    return as_jpeg(pixels, photo.orientation), {**told, "crop": crop}


def _shown_alone(open_file: OpenFile, photo: Photo, wanted: Rectify, longest: int | None) -> Shown:
    """By what the photo says itself: what will be saved, decided at full size, and drawn small."""
    from unshutter.result import judged
    from unshutter.warp.pixels import edge_decision, straighten

    motion = found_motion(open_file, photo, wanted.find)
    found, verdict = judged(motion, wanted.undo, photo.height, photo.width, wanted.find.camera.readout)
    told: dict[str, Any] = {**verdict.as_json(), **_told_of(found), "edges": None, "whole": None}
    pixels = small_copy(open_file, photo, longest)
    if not verdict.changes:
        return pixels, told, _WHOLE
    frame = edge_decision(found, wanted.undo.edges)
    small = found.resized(*found.readout.frame_size(*pixels.shape[:2]))
    pixels = straighten(pixels, small, "fill" if frame.edges == "fill" else "keep").pixels
    window, size = frame.window, (photo.width, photo.height)
    shares = window.left / size[0], window.top / size[1], window.right / size[0], window.bottom / size[1]
    return pixels, {**told, "edges": frame.edges, "whole": frame.whole}, shares


def _shown_between(open_file: OpenFile, photo: Photo, wanted: Rectify, longest: int | None) -> Shown:
    """By what the photo's neighbours say, all of them as small as they are shown."""
    from unshutter.frames.frame import SequenceOptions
    from unshutter.frames.sequence_rectification import rectify_between
    from unshutter.photo import Photo
    from unshutter.warp.edges import EdgePolicy, valid_window

    policy, given = EdgePolicy(wanted.undo.edges), wanted.neighbours
    undo = replace(wanted.undo, edges="keep") if policy.may_crop else wanted.undo
    scale = 1.0 if longest is None else max(max(photo.height, photo.width) / longest, 1.0)
    focal = wanted.find.camera.focal_px or photo.focal_px()
    alone = wanted.find if given.fallback else None
    told_so = given.at, given.model, focal and focal / scale, alone
    options = SequenceOptions(wanted.clock, undo, wanted.find.camera.direction, *told_so)
    neighbours = [path and replace(open_file, path=path) for path in (given.before, given.after)]
    copies = [each and Photo.from_array(small_copy(each, opened(each), longest)) for each in neighbours]
    result = rectify_between(Photo.from_array(small_copy(open_file, photo, longest)), copies[0], copies[1], options)
    told: dict[str, Any] = {**result.verdict.as_json(), "edges": None, "whole": None, "readout": str(options.readout)}
    told |= {"largest_px": result.verdict.largest_px * scale, "neighbours": True}
    if not result.changed:
        return result.pixels, told, _WHOLE
    rows, cols = result.valid.shape
    edges, window, whole = policy.decide((rows, cols), lambda: valid_window(result.valid))
    shares = window.left / cols, window.top / rows, window.right / cols, window.bottom / rows
    return result.pixels, {**told, "edges": edges, "whole": whole}, shares


def _told_of(motion: Motion) -> dict[str, Any]:
    """What the page says of a motion, its curves at a few rows."""
    import numpy as np

    rows = np.linspace(0, motion.height - 1, _CURVE_POINTS).round().astype(int)
    return {
        "estimator": motion.estimator,
        "readout": str(motion.readout),
        "reference": motion.reference,
        "rows": motion.height,
        "attitude": {"roll_deg": motion.roll_deg, "tilt_deg": motion.tilt_deg, "from": motion.attitude_from},
        "exposure_s": motion.exposure_s,
        "tx_px": np.round(motion.tx_px[rows], 2).tolist(),
        "rz_deg": np.round(np.degrees(motion.rz_rad[rows]), 3).tolist(),
    }


def _segments(open_file: OpenFile, wanted: Rectify) -> dict[str, Any]:
    import numpy as np

    from unshutter.estimators.lines.segments import find_segments
    from unshutter.estimators.right_angles.view import MOST_SEGMENTS, SHORT_SIDE
    from unshutter.result import judged
    from unshutter.serve.upright import shares
    from unshutter.warp.grid import rs_to_gs_map

    photo = opened(open_file)
    grey = photo.grey(SHORT_SIDE)
    ends = find_segments(grey, MOST_SEGMENTS).reshape(-1, 2)
    scale = np.array([photo.width / grey.shape[1], photo.height / grey.shape[0]])
    col, row = ((ends + 0.5) * scale - 0.5).T
    ends_at = {"before": (col, row)}
    if not wanted.neighbours:  # what they say holds for places, not for lines
        motion, verdict = judged(found_motion(open_file, photo, wanted.find), wanted.undo, photo.height, photo.width)
        ends_at["after"] = rs_to_gs_map(motion)(col, row) if verdict.changes else (col, row)
    size = photo.width, photo.height
    return {name: shares(*at, size, photo.orientation).reshape(-1, 4).round(4).tolist() for name, at in ends_at.items()}


def as_jpeg(pixels: np.ndarray, orientation: int = 1) -> bytes:
    """Stored pixels as a JPEG for the screen, upright."""
    from unshutter.geometry.readout import Orientation
    from unshutter.photo.libvips import as_image, refusing

    with refusing("cannot encode the copy for the screen"):
        return as_image(Orientation(orientation).upright(pixels)).jpegsave_buffer(Q=_SCREEN_QUALITY, keep=0)
