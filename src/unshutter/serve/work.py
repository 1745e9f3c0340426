"""What the lanes do with a photo, each in a process that a decoder may take down. NumPy and the like are only theirs.

Whatever takes a while to find lies beside the photo afterwards, for whichever lane is asked next: its small copies, and
the motions found.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from unshutter.batch.job import Job, Outcome
from unshutter.batch.report import naming_the_photo
from unshutter.errors import UnshutterError
from unshutter.options import Find, Rectify, Reference

if TYPE_CHECKING:
    import numpy as np

    from unshutter.motion import Motion
    from unshutter.photo import Photo

T = TypeVar("T")

_SCREEN_QUALITY = 88
_CURVE_POINTS = 41


@dataclass(frozen=True)
class Held:
    """A photo as a lane is handed it.

    Attributes:
        path: its file, alone in a folder with what is found about it.
        max_pixels: more are refused.
    """

    path: Path
    max_pixels: int


def warm() -> int:
    """Loads what the first photo would wait for; returns the number of this process."""
    import unshutter.rectification
    import unshutter.warp.pixels  # noqa: F401
    from unshutter.estimators.register import load
    from unshutter.photo.libvips import libvips

    libvips()
    load().prepare()
    return os.getpid()


# ---- for the screen -------------------------------------------------------------------------------------


def before(held: Held, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """The photo as a JPEG for the screen, upright, and what its file says.

    Args:
        held: the photo.
        longest: longer side [px]; None: full size.

    Raises:
        UnshutterError: it cannot be read.
    """
    return _in_one_line(held, lambda: _before(held, longest))


def after(held: Held, wanted: Rectify, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    """The rectified photo for the screen, upright and not cropped, and what was found and done.

    Raises:
        UnshutterError, UsageError: see :func:`unshutter.rectification.undo`.
    """
    return _in_one_line(held, lambda: _after(held, wanted, longest))


def segments(held: Held, wanted: Rectify) -> dict[str, Any]:
    """The line segments that methods look at: shares of width and height of the upright photo, before and after.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    return _in_one_line(held, lambda: _segments(held, wanted))


def _before(held: Held, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    from unshutter.serve.upright import arrows, is_sideways

    photo = _opened(held)
    pixels = _copy(held, photo, longest)
    held_so, sideways = photo.attitude, is_sideways(photo.orientation)
    return _jpeg(pixels, photo.orientation), {
        "format": photo.format,
        "height": photo.width if sideways else photo.height,
        "width": photo.height if sideways else photo.width,
        "focal_px": photo.focal_px() or 0.85 * (photo.height + photo.width),
        "exposure_s": photo.exposure_s(),
        "arrows": arrows(photo.orientation),
        "attitude": held_so and {"roll_deg": held_so.roll_deg, "tilt_deg": held_so.tilt_deg, "from": held_so.source},
    }


def _after(held: Held, wanted: Rectify, longest: int | None) -> tuple[bytes, dict[str, Any]]:
    from unshutter.rectification import judged
    from unshutter.serve.upright import corner_to_corner
    from unshutter.warp.pixels import framed, straighten

    photo = _opened(held)
    motion = _found(held, photo, wanted.find)
    found, verdict = judged(motion, wanted.undo, photo.height, photo.width, wanted.find.camera.readout)
    told: dict[str, Any] = {**verdict.as_json(), **_told_of(found), "edges": None, "whole": None, "crop": None}
    pixels = _copy(held, photo, longest)
    if verdict.changes:
        frame = framed(found, wanted.undo.edges)
        small = found.resized(*found.readout.frame_size(*pixels.shape[:2]))
        pixels = straighten(pixels, small, "fill" if frame.edges == "fill" else "keep").pixels
        told |= {"edges": frame.edges, "whole": frame.whole}
        if frame.edges == "crop":
            window, size = frame.window, (photo.width, photo.height)
            corners = (window.left, window.top), (window.right, window.bottom)
            told["crop"] = corner_to_corner(*corners, size, photo.orientation)
    return _jpeg(pixels, photo.orientation), told


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


def _segments(held: Held, wanted: Rectify) -> dict[str, Any]:
    import numpy as np

    from unshutter.estimators.lines.segments import find_segments
    from unshutter.estimators.right_angles.view import MOST_SEGMENTS, SHORT_SIDE
    from unshutter.rectification import judged
    from unshutter.serve.upright import shares
    from unshutter.warp.grid import rs_to_gs_map

    photo = _opened(held)
    grey = photo.grey(SHORT_SIDE)
    ends = find_segments(grey, MOST_SEGMENTS).reshape(-1, 2)
    scale = np.array([photo.width / grey.shape[1], photo.height / grey.shape[0]])
    col, row = ((ends + 0.5) * scale - 0.5).T
    motion, verdict = judged(_found(held, photo, wanted.find), wanted.undo, photo.height, photo.width)
    moved = rs_to_gs_map(motion)(col, row) if verdict.changes else (col, row)
    size = photo.width, photo.height
    return {
        name: shares(*at, size, photo.orientation).reshape(-1, 4).round(4).tolist()
        for name, at in (("before", (col, row)), ("after", moved))
    }


# ---- for files ------------------------------------------------------------------------------------------


def estimated(held: Held, find: Find, reference: Reference) -> str:
    """The photo's motion as JSON, as `unshutter estimate` writes it.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    return _in_one_line(held, lambda: _found(held, _opened(held), find).rereferenced(reference).to_json() + "\n")


def saved(held: Held, target: Path, wanted: Rectify) -> Outcome:
    """Writes the rectified photo as `unshutter rectify` does, to the byte; what goes wrong is in the outcome."""
    from unshutter.batch.work import do_job

    motion = None
    if wanted.motion is None:
        cached = _motion_file(held, wanted.find)
        motion = cached.read_text(encoding="utf-8") if cached.exists() else None
    else:
        from unshutter.motion import Motion

        try:
            motion = Motion.load(wanted.motion).to_json()
        except UnshutterError as error:
            return Outcome(str(error).replace(str(wanted.motion), "the motion"))
    job = Job(held.path, target, None, overwrite=False, max_pixels=held.max_pixels)
    return do_job(job, wanted, motion)


# ---- what lies beside the photo --------------------------------------------------------------------------


def _opened(held: Held) -> Photo:
    from unshutter.photo import Photo

    return Photo.open(held.path, held.max_pixels)


def _found(held: Held, photo: Photo, find: Find) -> Motion:
    """The photo's motion, first row as the reference."""
    from unshutter.estimators.register import load, method
    from unshutter.motion import Motion
    from unshutter.rectification import estimate_photo

    file = _motion_file(held, find)
    if file.exists():
        return Motion.from_json(file.read_text(encoding="utf-8"))
    photo.start_decoding(grey_px=method(find.estimator).grey_px, whole=False)
    motion = estimate_photo(photo, load(find.estimator), find.camera)
    _put(file, lambda part: part.write_text(motion.to_json(), encoding="utf-8"))
    return motion


def _motion_file(held: Held, find: Find) -> Path:
    digest = hashlib.sha256(repr(find).encode()).hexdigest()[:16]
    return held.path.with_name(f"motion-{digest}.json")


def _copy(held: Held, photo: Photo, longest: int | None) -> np.ndarray:
    """A copy of the stored pixels for the screen; of the full size none is kept."""
    import numpy as np

    if longest is None:
        return photo.screen_copy()
    file = held.path.with_name(f"copy-{longest}.npy")
    if file.exists():
        return np.load(file, mmap_mode="r")
    pixels = photo.screen_copy(longest)

    def write(part: Path) -> None:
        with part.open("wb") as stream:
            np.save(stream, pixels)

    _put(file, write)
    return pixels


def _put(file: Path, write: Callable[[Path], Any]) -> None:
    """Makes a file that another lane may be making, too: whole or not at all."""
    part = file.with_name(f"{file.name}.{os.getpid()}")
    write(part)
    os.replace(part, file)


def _jpeg(pixels: np.ndarray, orientation: int) -> bytes:
    from unshutter.photo.libvips import as_image, refusing
    from unshutter.serve.upright import upright

    with refusing("cannot encode the copy for the screen"):
        return as_image(upright(pixels, orientation)).jpegsave_buffer(Q=_SCREEN_QUALITY, keep=0)


def _in_one_line(held: Held, work: Callable[[], T]) -> T:
    """Whatever goes wrong becomes one line, in which the photo is called "the photo"."""
    done: list[T] = []
    try:
        naming_the_photo(held.path, lambda _: done.append(work()))
    except UnshutterError as error:
        raise type(error)(without_path(str(error), held.path)) from None
    return done[0]


def without_path(line: str, path: Path) -> str:
    """A message without the place where the photo lies meanwhile, which tells nobody anything."""
    return line.replace(f"{path}: ", "", 1).replace(str(path), "the photo")
