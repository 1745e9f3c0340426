"""The interface of a file format: recognising, reading and writing it. formats/ has one file per format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, ClassVar

from unshutter.geometry.readout import Orientation
from unshutter.options import PictureFormat
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source

if TYPE_CHECKING:
    import numpy as np
    import pyvips


@dataclass(frozen=True)
class Coding:
    """Encoding parameters of a picture, so that its successor can be encoded alike.

    Attributes:
        quality: JPEG quality, 1 ... 100.
        subsampled: whether chroma has half resolution.
        lossless: whether it is lossless (WebP only).
        bits: bits per sample.
        compression: TIFF's number of the compression.
        masked: whether the last of 2 or 4 channels is a mask or similar, not declared as transparency in the file
            (TIFF only).
    """

    quality: int | None = None
    subsampled: bool = False
    lossless: bool = False
    bits: int = 8
    compression: int | None = None
    masked: bool = False


@dataclass(frozen=True)
class Header:
    """Properties of a picture that has not been decoded yet.

    Attributes:
        format: format of the file.
        coding: how it is encoded.
        height, width: size of the stored pixels [px].
        bands: number of channels, including alpha.
        orientation: orientation of the stored pixels.
        metadata: metadata to copy to results.
    """

    format: Format
    coding: Coding
    height: int
    width: int
    bands: int
    orientation: Orientation
    metadata: Metadata


@dataclass(frozen=True)
class Picture:
    """A picture to be written to a file.

    Attributes:
        image: its pixels, without metadata.
        metadata: metadata to write.
        orientation: orientation of the pixels.
        coding: how the original was encoded.
        quality: 1-100; None: like the original.
    """

    image: pyvips.Image
    metadata: Metadata
    orientation: Orientation
    coding: Coding
    quality: int | None = None

    @property
    def masked(self) -> bool:
        """Whether the last channel is a mask rather than transparency."""
        return self.image.bands in (2, 4) and self.coding.masked

    @property
    def has_alpha(self) -> bool:
        """Whether the last channel is transparency."""
        return self.image.bands in (2, 4) and not self.coding.masked


class Format(ABC):
    """A file format that can be read.

    Attributes:
        name: its name, as in ``Photo.format``.
        suffixes: extensions of its files, the usual one first.
        written_as: name of the output format: its own, or another if the format is read-only.
        shrinks: factors by which pictures can be reduced during decoding to save work, in descending order.
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    written_as: ClassVar[str]
    shrinks: ClassVar[tuple[int, ...]] = ()

    @abstractmethod
    def recognises(self, source: Source, head: bytes) -> bool:
        """Whether a file has this format, unless a format checked earlier claims it.

        Args:
            source: the file.
            head: its first 64 bytes, which suffice for most formats; the extension may be wrong.

        Raises:
            OSError: the file cannot be read.
        """

    @abstractmethod
    def read_header(self, source: Source) -> Header:
        """Reads the header of a file.

        Raises:
            UnshutterError: the file is damaged, of an unsupported kind, or needs an extra that is missing.
            OSError: the file cannot be read.
        """

    @abstractmethod
    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """Decodes all stored pixels.

        Args:
            source: data to decode.
            header: result of :meth:`read_header`.
            shrink: 1, or one of ``shrinks``: factor by which rows and columns are reduced, rounding up.

        Returns:
            [H, W, bands] uint8 or uint16, read-only (very large pictures are kept in a temporary file).

        Raises:
            UnshutterError: the data are damaged or truncated.
        """


class WrittenFormat(Format):
    """A file format that can also be written.

    Attributes:
        longest_side: maximum side [px].
        deep: whether it supports more than 8 bits.
        grey, alpha: whether it supports pictures with one channel, and transparency.
        masks: whether it supports an extra channel that is not transparency.
        holds: attributes of ``Metadata`` that its files can hold.
    """

    name: ClassVar[PictureFormat]
    longest_side: ClassVar[int]
    deep: ClassVar[bool]
    grey: ClassVar[bool]
    alpha: ClassVar[bool]
    masks: ClassVar[bool] = False
    holds: ClassVar[frozenset[str]]

    @abstractmethod
    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """Encodes a picture to a file, or to bytes without ``path``; raises ``pyvips.Error`` on failure.

        Args:
            picture: pixels that the format can hold, and metadata, of which libvips writes those that it can preserve.
            path: the file.
        """

    @abstractmethod
    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """Adds EXIF and other metadata that libvips does not write well to the file written by :meth:`encode`.

        libvips would take EXIF apart and rebuild it: tags unknown to it would be lost, and maker notes would move,
        which breaks those whose offsets are relative to the start of the blob.

        Args:
            file: file, seekable, open for reading and writing.
            picture: picture that was encoded.

        Returns:
            Names of metadata that the format ``holds`` but that did not fit, such as "maker's note".
        """
