"""Rectified: the outcome for one photo, with its new pixels or the reason why it was left unchanged."""

from __future__ import annotations

import builtins
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UsageError
from unshutter.motion import Motion
from unshutter.motion.verdict import Candidate, Verdict
from unshutter.options import Camera, Edges, PictureFormat, Save, Subsampling, Undo
from unshutter.options.fields import errors_in_python, from_keywords
from unshutter.photo import Photo
from unshutter.photo.formats import of_target
from unshutter.photo.formats.picture_format import Format, WrittenFormat
from unshutter.photo.photo import check_size
from unshutter.photo.saving import Encoded, check_result, write_photo
from unshutter.storage.files import written_whole
from unshutter.storage.locations import Place, write_place

if TYPE_CHECKING:
    import numpy as np
    from PIL.Image import Image


class Result:
    """Outcome for a photo, processed by itself or with its neighbours."""

    photo: Photo  # the new pixels with the metadata of the original; the original itself if it was left unchanged
    original: Photo  # the photo as it was read
    verdict: Verdict  # whether anything was undone, and why not

    @property
    def changed(self) -> bool:
        """Whether anything was undone, the camera's pose included; if not, :attr:`reason` explains why."""
        return self.verdict.changes

    @property
    def reason(self) -> str:
        """The reason why the photo was left unchanged, ``only 3 straight segments found``; empty if it was changed."""
        return self.verdict.sentence

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
        import numpy as np

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
        options, target = from_keywords(Save, locals()), Path(path)
        format = of_target(target)
        check_result(target, overwrite, self.photo.made_from)
        return write_result(self, target, format, options, overwrite)

    @errors_in_python()
    def encode(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> Encoded:
        """Encodes the picture as :meth:`save` does; returns the file and the names of metadata that it cannot hold."""
        copied = self.photo.file_as(format or self.photo.format, from_keywords(Save, locals()))
        if copied is None:
            return self.photo.encode(format, quality, subsampling)
        return Encoded(copied.data(), ())


def write_result(result: Result, target: Place, format: Format, save: Save, overwrite: bool) -> tuple[str, ...]:
    """Writes a picture as :meth:`Result.save` does, without checking the target first; it may also be behind a URL."""
    photo = result.photo
    copied = photo.file_as(format.name, save)
    if copied is None:
        assert isinstance(format, WrittenFormat)
        if isinstance(target, Path):
            return write_photo(photo, target, format, save, overwrite)
        file = photo.encode(format.name, save.quality, save.subsampling)
        write_place(file.data, target, overwrite)
        return file.left_out
    if not isinstance(target, Path):
        write_place(copied.data(), target, overwrite)
        return ()
    times_ns = photo.times_ns if save.keep_times else None
    mode_of = photo.opened and photo.opened.path
    with written_whole(target, overwrite, mode_of, times_ns) as part:
        copied.copy_to(part)
    return ()


@dataclass(frozen=True, repr=False)
class Rectified(Result):
    """A rectified photo, or one left unchanged because no sufficiently certain, visible motion was found.

    Attributes:
        photo: the new pixels with the metadata of the original; the original itself if it was left unchanged.
        motion: the motion that was undone, in the readout frame; zero if the photo was left unchanged.
        original: the photo as it was read.
        found: the motion that was found or given, undone or not.
        verdict: whether the motion was undone, and why not.
        edges: ``keep``, ``crop`` or ``fill``: how areas that the photo did not see were handled.
        whole: share of the photo's area that a crop leaves; None if no crop was computed.
        candidates: the motions that fit the photo, the default one first; empty if the motion was
            given. Their motions have the first row as the reference.
    """

    photo: Photo
    motion: Motion
    original: Photo
    found: Motion
    verdict: Verdict
    edges: Edges = "keep"
    whole: float | None = None
    candidates: tuple[Candidate, ...] = ()

    def __repr__(self) -> str:
        size = f"{self.photo.width}x{self.photo.height} {self.photo.format}"
        return f"Rectified({size}, {self.verdict.described() if self.changed else f'left unchanged: {self.reason}'})"

    @property
    def valid(self) -> np.ndarray:
        """Mask [H, W] bool of the pixels that the rolling-shutter photo shows (before any crop or fill)."""
        from unshutter.motion.warp import validity_mask

        return validity_mask(self.motion, self.verdict.upright)


# ---- from a photo and its motion to the result --------------------------------------------------------------


def undo(photo: Photo, motion: Motion, options: Undo, readout: str = "auto") -> Rectified:
    """Undoes a motion if :func:`judged` allows it; otherwise returns the photo unchanged, without decoding its pixels.

    The motion may be of another size if the aspect ratio fits. With ``auto``, its own readout direction counts.
    """
    check_size(photo.height, photo.width)
    return undo_judged(photo, *judged(motion, options, photo.height, photo.width, readout), options.edges)


def undo_judged(photo: Photo, motion: Motion, verdict: Verdict, edges: Edges) -> Rectified:
    """Carries out what :func:`judged` returned."""
    undone = verdict.undone(motion)
    if not verdict.changes:
        return Rectified(photo, undone, photo, motion, verdict)
    from unshutter.motion.warp import straighten

    result = straighten(photo.pixels, undone, edges, photo.masked, verdict.upright)
    return Rectified(photo.with_pixels(result.pixels), undone, photo, motion, verdict, result.edges, result.whole)


def judged(motion: Motion, options: Undo, height: int, width: int, readout: str = "auto") -> tuple[Motion, Verdict]:
    """Returns the motion to undo in a stored picture of height x width [px], and the verdict on whether to undo it."""
    motion = fitted(motion, height, width, readout)
    motion = motion.rereferenced(options.reference or motion.reference).scaled(options.strength)
    return motion, Verdict.of(motion, options)


def fitted(motion: Motion, height: int, width: int, readout: str = "auto") -> Motion:
    """Resizes a motion for a stored picture of height x width [px]."""
    if readout != "auto" and Camera(readout).direction != motion.readout:
        raise UsageError(f"the motion was made for readout {motion.readout}, not {readout}")
    return motion.resized(*motion.readout.frame_size(height, width))
