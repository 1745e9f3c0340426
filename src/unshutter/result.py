"""Rectified: a photo as a global shutter would have taken it, or as it was, and why."""

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
    """What became of a photo, by itself or with the help of its neighbours.

    Attributes:
        photo: the new pixels with the metadata of the original; the original itself where it was left unchanged.
        original: the photo as it was read.
        verdict: whether anything was undone, and why not.
    """

    photo: Photo
    original: Photo
    verdict: Verdict

    @property
    def changed(self) -> bool:
        """Whether anything was undone; if not, :attr:`reason` says why."""
        return self.verdict.changes

    @property
    def reason(self) -> str:
        """Why the photo was left unchanged, ``not sure: confidence 0.01``; empty where it was changed."""
        return self.verdict.sentence

    @property
    def pixels(self) -> np.ndarray:
        """The stored pixels [H, W, bands] (bands is 1 for grey), uint8 or uint16, not to be written to."""
        return self.photo.pixels

    def to_array(self) -> np.ndarray:
        """A copy of the stored pixels, [H, W] or [H, W, bands], uint8 or uint16."""
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
        """Writes the picture; the format is that of the file name's ending. See :meth:`Photo.save`.

        A photo that was left unchanged is copied byte for byte, unless it is to be another format, or coded otherwise.

        Returns:
            The metadata that such files have no place for, in words, as in ``("IPTC",)``.

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
        """The picture as an encoded file, and what of its metadata did not go in; else as :meth:`save`.

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
    """A rectified photo, or one that was left unchanged, since nothing sure was found that would be worth undoing.

    Attributes:
        photo: the new pixels with the metadata of the original; the original itself where it was left unchanged.
        motion: what was undone, in the readout frame: none at all where the photo was left unchanged.
        original: the photo as it was read.
        found: the motion that was found or given, undone or not.
        verdict: whether it was undone, and why not.
        edges: ``keep``, ``crop`` or ``fill``: what was done about places that the photo did not see.
        whole: share of the photo's area that a crop leaves; None where no crop was looked for.
        candidates: the motions that fit the photo, first the one that counts by default; empty where the motion was
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
        """[H, W] bool: where the rolling-shutter photo shows what belongs there (before any crop or fill)."""
        from unshutter.warp.pixels import validity_mask

        return validity_mask(self.motion)


# ---- from a photo and its motion to the result --------------------------------------------------------------


def undo(photo: Photo, motion: Motion, options: Undo, readout: str = "auto") -> Rectified:
    """The photo with a motion undone, where :func:`judged` allows it; else unchanged, and its pixels are not looked at.

    Args:
        photo: the photo.
        motion: its motion; of another size if the aspect fits.
        options: reference row, strength, edges, least confidence.
        readout: direction in which the stored pixels were read; ``auto``: the motion's.

    Raises:
        UsageError: another readout direction than the motion's.
        UnshutterError: another aspect, a motion that cannot be undone, a photo that is too small or damaged.
    """
    check_size(photo.height, photo.width)
    estimate, verdict = judged(motion, options, photo.height, photo.width, readout)
    if not verdict.changes:
        return Rectified(photo, verdict.left_alone(estimate), photo, estimate, verdict)
    from unshutter.warp.pixels import straighten

    result = straighten(photo.pixels, estimate, options.edges, photo.masked)
    return Rectified(photo.with_pixels(result.pixels), estimate, photo, estimate, verdict, result.edges, result.whole)


def judged(motion: Motion, options: Undo, height: int, width: int, readout: str = "auto") -> tuple[Motion, Verdict]:
    """A motion as it would be undone in a stored picture of height x width [px], and whether it is.

    Raises:
        UsageError: another readout direction than the motion's; UnshutterError: another aspect.
    """
    motion = fitted(motion, height, width, readout)
    motion = motion.rereferenced(options.reference or motion.reference).scaled(options.strength)
    return motion, Verdict.of(motion, options)


def fitted(motion: Motion, height: int, width: int, readout: str = "auto") -> Motion:
    """A motion resized for a stored picture of height x width [px].

    Raises:
        UsageError: another readout direction than the motion's; UnshutterError: another aspect.
    """
    if readout != "auto" and Camera(readout).direction != motion.readout:
        raise UsageError(f"the motion was made for readout {motion.readout}, not {readout}")
    return motion.resized(*motion.readout.frame_size(height, width))
