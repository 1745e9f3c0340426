"""Rectified: the outcome for one photo, with its new pixels or the reason why it was left unchanged."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UsageError
from unshutter.motion import Motion
from unshutter.motion.candidate import Candidate
from unshutter.motion.verdict import Verdict
from unshutter.options import Camera, Edges, PictureFormat, Save, Subsampling, Undo
from unshutter.photo import Photo
from unshutter.photo.argument import check_size
from unshutter.photo.encoding import Encoded
from unshutter.photo.formats import of_target
from unshutter.storage.files import check_target, written_whole

if TYPE_CHECKING:
    import numpy as np


class Result:
    """Outcome for a photo, processed by itself or with its neighbours.

    Attributes:
        photo: the new pixels with the metadata of the original; the original itself if it was left unchanged.
        original: the photo as it was read.
        verdict: whether anything was undone, and why not.
    """

    photo: Photo
    original: Photo
    verdict: Verdict

    @property
    def changed(self) -> bool:
        """Whether anything was undone; if not, :attr:`reason` explains why."""
        return self.verdict.changes

    @property
    def reason(self) -> str:
        """The reason why the photo was left unchanged, ``not sure: confidence 0.01``; empty if it was changed."""
        return self.verdict.sentence

    @property
    def pixels(self) -> np.ndarray:
        """The stored pixels [H, W, bands] (bands is 1 for grey), uint8 or uint16; treat as read-only."""
        return self.photo.pixels

    def to_array(self) -> np.ndarray:
        """Returns a copy of the stored pixels, [H, W] or [H, W, bands], uint8 or uint16."""
        return self.photo.to_array()

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

        Raises:
            UnshutterError: the file cannot be written, exists (without ``overwrite``) or is the original.
        """
        target, options = Path(path), Save(None, quality, subsampling, keep_times)
        times_ns = self.photo.times_ns if keep_times else None
        copied = self.photo.file_as(of_target(target).name, options)
        if copied is None:
            return self.photo.save(target, quality, overwrite, subsampling, keep_times)
        check_target(target, overwrite, self.original.path)
        with written_whole(target, overwrite, mode_of=self.original.path, times_ns=times_ns) as part:
            copied.copy_to(part)
        return ()

    def encode(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> Encoded:
        """Encodes the picture as :meth:`save` does; returns the file and the names of metadata that it cannot hold.

        Args:
            format, quality, subsampling: see :meth:`Photo.to_bytes`.

        Raises:
            UsageError, UnshutterError: see :meth:`Photo.to_bytes`.
        """
        copied = self.photo.file_as(format or self.photo.format, Save(format, quality, subsampling))
        if copied is None:
            return self.photo.encode(format, quality, subsampling)
        return Encoded(copied.data(), ())


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
        from unshutter.warp.pixels import validity_mask

        return validity_mask(self.motion)


# ---- from a photo and its motion to the result --------------------------------------------------------------


def undo(photo: Photo, motion: Motion, options: Undo, readout: str = "auto") -> Rectified:
    """Undoes a motion if :func:`judged` allows it; otherwise returns the photo unchanged, without decoding its pixels.

    Args:
        photo: the photo.
        motion: its motion; the size may differ if the aspect ratio fits.
        options: reference row, strength, edges, least confidence.
        readout: direction in which the stored pixels were read out; ``auto``: the motion's.

    Raises:
        UsageError: another readout direction than the motion's.
        UnshutterError: the aspect ratios differ, the motion cannot be undone, or the photo is too small or damaged.
    """
    check_size(photo.height, photo.width)
    estimate, verdict = judged(motion, options, photo.height, photo.width, readout)
    if not verdict.changes:
        return Rectified(photo, verdict.left_alone(estimate), photo, estimate, verdict)
    from unshutter.warp.pixels import straighten

    result = straighten(photo.pixels, estimate, options.edges, photo.masked)
    return Rectified(photo.with_pixels(result.pixels), estimate, photo, estimate, verdict, result.edges, result.whole)


def judged(motion: Motion, options: Undo, height: int, width: int, readout: str = "auto") -> tuple[Motion, Verdict]:
    """Returns the motion to undo in a stored picture of height x width [px], and the verdict on whether to undo it.

    Raises:
        UsageError: another readout direction than the motion's; UnshutterError: another aspect.
    """
    motion = fitted(motion, height, width, readout)
    motion = motion.rereferenced(options.reference or motion.reference).scaled(options.strength)
    return motion, Verdict.of(motion, options)


def fitted(motion: Motion, height: int, width: int, readout: str = "auto") -> Motion:
    """Resizes a motion for a stored picture of height x width [px].

    Raises:
        UsageError: another readout direction than the motion's; UnshutterError: another aspect.
    """
    if readout != "auto" and Camera(readout).direction != motion.readout:
        raise UsageError(f"the motion was made for readout {motion.readout}, not {readout}")
    return motion.resized(*motion.readout.frame_size(height, width))
