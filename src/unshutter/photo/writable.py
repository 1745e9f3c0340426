"""Writes pictures: as an encoded file in memory, or to a file on disc."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from pathlib import Path

from unshutter.options import PictureFormat, Save, Subsampling
from unshutter.photo import encoding
from unshutter.photo.encoding import Encoded
from unshutter.photo.format import Picture, WrittenFormat
from unshutter.photo.formats import FORMATS, WRITTEN, of_target
from unshutter.storage.files import Times, check_target, written_whole


class Writable(ABC):
    """A picture with metadata that can be written in any output format."""

    format: str
    path: Path | None

    @property
    @abstractmethod
    def times_ns(self) -> Times:
        """Access and modification time of its file [ns since 1970].

        Raises:
            UsageError: the picture does not come from a file.
        """

    @abstractmethod
    def _picture_for(self, format: WrittenFormat, save: Save) -> tuple[Picture, tuple[str, ...]]:
        """Returns the picture as a format can hold it, and the names of what it cannot hold."""

    def to_bytes(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> bytes:
        """Encodes the photo.

        Args:
            format: ``jpeg``, ``png``, ``webp``, ``tiff`` or ``avif``; its own by default
                (PNG for arrays, AVIF for HEIC, TIFF for raw).
            quality: 1-100 for JPEG, WebP and AVIF; by default like the input's, else 95, 90 and 80.
            subsampling: chroma subsampling of JPEG and AVIF, ``4:4:4`` (none) or ``4:2:0``; by default like the input's
                (4:4:4 for anything in between).

        Raises:
            UsageError: unknown format, quality or subsampling; UnshutterError: the format cannot hold the picture.
        """
        return self._encoded(Save(format, quality, subsampling)).data

    def encode(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> Encoded:
        """Encodes the photo like :meth:`to_bytes`, and names the metadata that the format cannot hold."""
        return self._encoded(Save(format, quality, subsampling))

    def _encoded(self, save: Save) -> Encoded:
        own = "png" if self.format == "array" else FORMATS[self.format].written_as
        target = WRITTEN[save.format or own]
        picture, left_out = self._picture_for(target, save)
        file = encoding.to_bytes(picture, target)
        return Encoded(file.data, left_out + file.left_out)

    def save(
        self,
        path: str | os.PathLike[str],
        quality: int | None = None,
        overwrite: bool = False,
        subsampling: Subsampling | None = None,
        keep_times: bool = False,
    ) -> tuple[str, ...]:
        """Writes the photo atomically: to a temporary file next to ``path`` that is renamed when complete.

        It gets the permissions of the file from which the photo was read.

        Args:
            path: file to write; its extension determines the format: .jpg .jpeg .png .webp .tif .tiff .avif.
            quality: see :meth:`to_bytes`.
            overwrite: whether an existing file may be replaced; never the photo's own or the target of a link.
            subsampling: see :meth:`to_bytes`.
            keep_times: whether it also gets the access and modification time that the photo's file had when it was
                opened, as far as the file system supports them.

        Returns:
            The names of metadata that the format cannot hold, such as ``("IPTC",)``.

        Raises:
            UsageError: unknown extension, quality or subsampling, or ``keep_times`` for a photo not from a file;
            UnshutterError: the file exists, is a link or the photo's own, its folder is missing or read-only, the disc
                is full, or the photo is damaged.
        """
        target, options = Path(path), Save(None, quality, subsampling, keep_times)
        times_ns = self.times_ns if options.keep_times else None
        format = of_target(target)
        check_target(target, overwrite, self.path)
        picture, left_out = self._picture_for(format, options)  # decodes: damage is found before writing
        with written_whole(target, overwrite, mode_of=self.path, times_ns=times_ns) as part:
            left_out += encoding.to_file(picture, format, part, target)
        return left_out
