"""Renders and writes the result for one photo: its new pixels, or the reason why it was left unchanged."""

from __future__ import annotations

import builtins
import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from unshutter.motion import Motion
from unshutter.motion.finding import Candidate, Finding
from unshutter.motion.verdict import Verdict
from unshutter.motion.warp import straighten, validity_mask
from unshutter.options import LEAST_GOOD_CROP, Edges, PictureFormat, Save, Subsampling
from unshutter.options.fields import errors_in_python, from_keywords
from unshutter.options.picture_formats import of_suffix
from unshutter.orientation import Orientation
from unshutter.photo import Photo
from unshutter.photo.formats import FORMATS, of_target
from unshutter.photo.formats.picture_format import Format, WrittenFormat
from unshutter.photo.photo import check_size
from unshutter.photo.placement import Placement
from unshutter.photo.saving import Encoded, check_result, write_photo
from unshutter.rectification.auxiliaries import undone_in_auxiliaries
from unshutter.storage.files import write_file, written_whole
from unshutter.storage.targets import Target, TargetKind, Written

if TYPE_CHECKING:
    from PIL.Image import Image

    from unshutter.motion.grid import Tile


@dataclass(frozen=True, repr=False)
class Result(ABC):
    """Outcome for a photo, processed by itself or with its neighbours.

    Attributes:
        photo: the new pixels with the metadata of the original; the original itself if it was left unchanged.
        original: the photo as it was read.
        verdict: whether anything was undone, and why not.
        edges: ``keep``, ``crop``, ``fill`` or ``borrow``: how areas that the photo did not see were handled.
        area_left: share of the photo's area that a crop leaves; None if no crop was computed.
    """

    photo: Photo
    original: Photo
    verdict: Verdict
    edges: Edges = "keep"
    area_left: float | None = None

    @property
    @abstractmethod
    def valid(self) -> np.ndarray:
        """Mask [H, W] bool of the pixels that the photo shows (before any crop or fill)."""

    @property
    @abstractmethod
    def motion(self) -> Motion | None:
        """The motion that was undone."""

    @property
    def changed(self) -> bool:
        """Whether anything was undone, the camera's pose included; if not, :attr:`reason` explains why."""
        return self.verdict.changes

    @property
    def reason(self) -> str:
        """The reason why the photo was left unchanged, ``only 3 straight segments found``; empty if it was changed."""
        return self.verdict.sentence

    @property
    def needs_a_look(self) -> bool:
        """Whether someone should compare both pictures: the motion is large but unsure, or a crop left little."""
        return self.verdict.needs_a_look or (self.area_left is not None and self.area_left < LEAST_GOOD_CROP)

    @property
    def pixels(self) -> np.ndarray:
        """The stored pixels [H, W, bands] (bands is 1 for grey), uint8 or uint16; treat as read-only."""
        return self.photo.pixels

    @property
    def array(self) -> np.ndarray:
        """The stored pixels [H, W] or [H, W, bands], a copy: uint8, uint16, or floating point as was given."""
        pixels = self.photo.to_array()
        if self.original.given is None:
            return pixels
        given = np.asarray(self.original.given)
        if not self.changed:
            return given.copy()
        if given.dtype.kind == "f":
            pixels = (pixels / 65535).astype(given.dtype)
        return pixels.reshape(*pixels.shape[:2], *given.shape[2:])

    @property
    def image(self) -> Image:
        """The stored pixels as a Pillow image, see :meth:`Photo.to_image`."""
        return self.photo.to_image()

    @property
    def bytes(self) -> builtins.bytes:
        """The encoded file, in the photo's format (PNG for pixels); the original's bytes if it was left unchanged."""
        return self.encode().data

    @errors_in_python()
    def save(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = False,
        quality: int | None = None,
        subsampling: Subsampling | None = None,
        keep_times: bool = False,
    ) -> tuple[str, ...]:
        """Writes the picture in the format that the file extension names. See :meth:`Photo.save`.

        An unchanged photo is copied byte for byte, unless another format or encoding is requested.

        Returns:
            The names of metadata that the format cannot hold, such as ``("IPTC",)``.
        """
        target = Path(path)
        options = from_keywords(Save, {"quality": quality, "subsampling": subsampling, "keep_times": keep_times})
        format = of_target(target)
        check_result(target, overwrite, self.photo.made_from)
        return _write_picture(self, target, format, options, overwrite)

    @errors_in_python()
    def encode(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> Encoded:
        """Encodes the picture as :meth:`save` does; returns the file and the names of metadata that it cannot hold."""
        save = from_keywords(Save, {"format": format, "quality": quality, "subsampling": subsampling})
        copied = self.photo.file_as(format or self.photo.format, save)
        if copied is None:
            return self.photo.encode(format, quality, subsampling)
        return Encoded(copied.data(), ())


@dataclass(frozen=True, repr=False)
class Rectified(Result):
    """A rectified photo, or one left unchanged because no sufficiently certain, visible motion was found."""

    @property
    def motion(self) -> Motion:
        """The motion that was undone, in the readout frame; zero if its motion was left."""
        return self.verdict.motion

    @property
    def found(self) -> Finding:
        """The motion that was found or given, undone or not, at the requested reference row and strength."""
        return self.verdict.finding

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The motions that fit the photo, the default one first, with the first row as the reference.

        Empty if the motion was given.
        """
        return self.verdict.finding.candidates

    def __repr__(self) -> str:
        size = f"{self.photo.width}x{self.photo.height} {self.photo.format}"
        return f"Rectified({size}, {self.verdict.described() if self.changed else f'left unchanged: {self.reason}'})"

    @property
    def valid(self) -> np.ndarray:
        """Mask [H, W] bool of the pixels that the rolling-shutter photo shows (before any crop or fill)."""
        return validity_mask(self.motion, self.verdict.upright)


# ---- from a photo and its verdict to the files --------------------------------------------------------------


def render(photo: Photo, verdict: Verdict, edges: Edges = "auto") -> Rectified:
    """Carries out a verdict; a photo that is left unchanged is not decoded.

    Raises:
        UnshutterError: the photo is damaged, too small, or a crop would leave almost nothing of it.
    """
    check_size(photo.height, photo.width)
    if not verdict.changes:
        return Rectified(photo, photo, verdict)
    pixels, decision = straighten(photo.pixels, verdict.motion, edges, photo.masked, verdict.upright)
    auxiliaries = undone_in_auxiliaries(photo, verdict, decision.edges, decision.window)
    rectified = photo.with_pixels(pixels, placement(photo, verdict, decision.window), auxiliaries)
    return Rectified(rectified, photo, verdict, decision.edges, decision.area_left)


def placement(photo: Photo, verdict: Verdict, window: Tile) -> Placement:
    """Returns where the picture in a window of the photo's frame shows what the photo shows."""
    import numpy as np

    from unshutter.motion.grid import rs_to_gs_map

    to_picture = rs_to_gs_map(verdict.motion, verdict.upright)
    new_size = window.bottom - window.top, window.right - window.left

    def position(across: Sequence[float], down: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
        with np.errstate(all="ignore"):
            col, row = to_picture(np.array(across) * photo.width - 0.5, np.array(down) * photo.height - 0.5)
        return (
            ((col + 0.5 - window.left) / new_size[1]).tolist(),
            ((row + 0.5 - window.top) / new_size[0]).tolist(),
        )

    corner = window.top, window.left
    return Placement((photo.height, photo.width), new_size, position, corner, Orientation(photo.orientation))


def write(
    result: Result, target: Target, save: Save | None = None, overwrite: bool = False, source: Path | None = None
) -> Written:
    """Writes one of the files that come of a photo, whole or not at all; the caller has checked the target.

    A photo that is left unchanged is copied under its own name, whatever the quality. As a picture, it is copied unless
    another format or encoding is asked for.

    Args:
        source: place of the photo, whose permissions files about it get; by default the file that was opened.

    Returns:
        The file, and the names of metadata that its format cannot hold.
    """
    save = save or Save()
    source = source or (result.original.opened and result.original.opened.path)
    if target.kind is TargetKind.MOTION:
        write_file(f"{result.verdict.carried_out.to_json()}\n".encode(), target.path, overwrite, mode_of=source)
        return Written(target.path, target.kind)
    if target.kind in (TargetKind.MASK, TargetKind.UNCHANGED_MASK):
        mask = Photo.from_array(result.valid.astype("uint8") * 255).to_bytes("png")  # 255: the photo shows the scene
        write_file(mask, target.path, overwrite, mode_of=source)
        return Written(target.path, target.kind)
    suffix = target.path.suffix
    own = FORMATS[result.original.format]
    same_name = source is not None and suffix == source.suffix
    if target.kind is TargetKind.UNCHANGED and (same_name or of_suffix(suffix) is own.row):
        return Written(
            target.path,
            target.kind,
            _write_picture(result, target.path, own, replace(save, quality=None, subsampling=None), overwrite),
        )
    format = of_target(Path(target.path.name))
    left_out = _write_picture(result, target.path, format, save, overwrite)
    return Written(target.path, target.kind, left_out, "" if result.changed else format.row.title)


def _write_picture(result: Result, target: Path, format: Format, save: Save, overwrite: bool) -> tuple[str, ...]:
    """Writes a picture; returns the names of metadata that its format cannot hold."""
    photo = result.photo
    copied = photo.file_as(format.row.name, save)
    if copied is None:
        assert isinstance(format, WrittenFormat)
        return write_photo(photo, target, format, save, overwrite)
    times_ns = photo.times_ns if save.keep_times else None
    mode_of = photo.opened and photo.opened.path
    with written_whole(target, overwrite, mode_of, times_ns) as part:
        copied.copy_to(part)
    return ()
