"""The interface of a file format: how it is recognised, read and written. formats/ has one file for each."""

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
    """How a picture was encoded, to encode its successor alike.

    Attributes:
        quality: JPEG quality, 1 ... 100.
        subsampled: chroma at half resolution.
        lossless: WebP only.
        bits: of a sample.
        compression: TIFF's number of it.
        masked: the last of 2 or 4 channels is a mask or similar, of which the file does not say that it is
            transparency (TIFF only).
    """

    quality: int | None = None
    subsampled: bool = False
    lossless: bool = False
    bits: int = 8
    compression: int | None = None
    masked: bool = False


@dataclass(frozen=True)
class Header:
    """What is known of a picture that is not decoded yet.

    Attributes:
        format: of the file.
        coding: how it is encoded.
        height, width: of the stored pixels [px].
        bands: channels, alpha included.
        orientation: of the stored pixels.
        metadata: what goes to its successors.
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
    """A picture on its way into a file.

    Attributes:
        image: its pixels, without metadata.
        metadata: those that go along.
        orientation: of the pixels.
        coding: how its predecessor was encoded.
        quality: 1-100; None: like its predecessor's.
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
    """A file format that is read.

    Attributes:
        name: as in ``Photo.format``.
        suffixes: of its files, the usual one first.
        written_as: name of the format that results get: its own, or another where it is only read.
        shrinks: how many times smaller pictures can be decoded, for less work; from the largest down.
    """

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    written_as: ClassVar[str]
    shrinks: ClassVar[tuple[int, ...]] = ()

    @abstractmethod
    def recognises(self, source: Source, head: bytes) -> bool:
        """Whether a file is of this format, unless one that was asked before claims it, too.

        Args:
            source: the file.
            head: its first 64 bytes, which are enough for most; the ending of its name may lie.

        Raises:
            OSError: it cannot be read.
        """

    @abstractmethod
    def read_header(self, source: Source) -> Header:
        """Reads what a file says about its picture.

        Raises:
            UnshutterError: damaged, of a kind that unshutter does not take, or in need of an extra that is missing.
            OSError: it cannot be read.
        """

    @abstractmethod
    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """All stored pixels, decoded now.

        Args:
            source: what to decode.
            header: what :meth:`read_header` says of it.
            shrink: 1, or one of ``shrinks``: every so many rows and columns become one, rounded up.

        Returns:
            [H, W, bands] uint8 or uint16, not to be written to (very large pictures lie in a temporary file).

        Raises:
            UnshutterError: the data are damaged or end too early.
        """


class WrittenFormat(Format):
    """A file format that is written, too.

    Attributes:
        longest_side: [px] that it can hold.
        deep: whether it holds more than 8 bits.
        grey, alpha: whether it holds pictures of one channel, and transparency.
        masks: whether it holds a further channel that is not transparency.
        holds: attributes of ``Metadata`` that its files have a place for.
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
        """Encodes a picture into a file, or into bytes without ``path``; ``pyvips.Error`` on failure.

        Args:
            picture: pixels and metadata that the format can hold; of the metadata, those that libvips writes whole.
            path: the file.
        """

    @abstractmethod
    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """Adds EXIF, and the other metadata that libvips does not write well, to the file that :meth:`encode` wrote.

        libvips would take EXIF apart and rebuild it: tags that it does not know are lost, and makers' notes move,
        which breaks those that point to places counted from the blob's beginning.

        Args:
            file: seekable, open for reading and writing.
            picture: the one that was encoded.

        Returns:
            Names of metadata that the format ``holds``, but that did not fit after all, such as "maker's note".
        """
