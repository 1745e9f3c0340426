"""Cameras' raw files, developed through LibRaw (package rawpy, extra ``raw``).

Developed plainly, so that photos of a series remain comparable: the camera's white balance, no brightening, sRGB, 16
bits. Rows remain rows of the sensor: LibRaw must not rotate the picture, and applies no lens corrections.

Most raw files are TIFFs, some of them with another magic number. Fuji's contains a JPEG with EXIF, Canon's newest
is a box file like HEIC with a TIFF for each directory. For other kinds, no tags are read.

LibRaw silently treats missing data as zeros: a truncated file becomes a picture that is black from some row on. A file
that is complete according to its own tables counts as complete. All others are decoded a second time with extra bytes
after its end: values that differ were missing.

Source: TIFF 6.0 (strips, tiles); TIFF/EP, DNG 1.6 (sub-directories); ISO/IEC 14496-12 (boxes); the public descriptions
of these formats by exiftool.org and github.com/lclevy/canon_cr3 (facts only).
"""

from __future__ import annotations

import io
import os
import re
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Lock
from typing import TYPE_CHECKING, BinaryIO, final

from unshutter import version
from unshutter.errors import UnshutterError
from unshutter.orientation import Orientation
from unshutter.photo import boxes, chunks, exif, maker_notes, xmp
from unshutter.photo.directories import EXIF, GPS, SUBFILE_TYPE, Directory, Entry, Tree, read_tree
from unshutter.photo.formats.picture_format import Coding, Format, Header, Metadata
from unshutter.photo.libvips import Source, libvips
from unshutter.photo.parts import OTHER, Found

if TYPE_CHECKING:
    import numpy as np
    import rawpy

_DNG_VERSION = 0xC612
_PRIVATE_DATA = 0xC634
_PANASONIC_JPEG = 0x002E
_OTHER_MAGIC = (b"IIRO", b"IIRS", b"MMOR", b"IIU\0")  # Olympus, Panasonic
_MAGIC = {b"II": b"II*\0", b"MM": b"MM\0*"}
_CANON = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
_CANON_XMP = bytes.fromhex("be7acfcb97a942e89c71999491e3afac")
_ORIENTATIONS = (1, 2, 4, 3, 5, 8, 6, 7)  # of EXIF, by LibRaw's flip
_COMPLAINT = rb"unknown file: (Unexpected end of file|data corrupted at .*)"  # LibRaw's, which rawpy cannot turn off


@final
class Raw(Format):
    """Raw files of all makers that LibRaw supports: read-only, as 16-bit RGB."""

    signature = re.compile(
        rb"II\*\0....CR|IIRO|IIRS|MMOR|IIU\0|FUJIFILM|FOVb|\0MRM|......HEAPCCDR|....ftypcrx ", re.DOTALL
    )

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format. Raw files of many makers begin like a TIFF; some are identified only by their extension."""
        return super().recognises(source, head) or source.suffix in self.row.suffixes or _is_raw_tiff(source)

    def read_header(self, source: Source) -> Header:
        """See Format."""
        with source.stream() as stream:
            if _is_jpeg_xl(stream):
                raise UnshutterError(
                    "{photo} is compressed with JPEG XL, which LibRaw cannot decode: use the camera's JPEG or HEIC, or "
                    "convert it to an older DNG with Adobe DNG Converter",
                    photo=source,
                )
        with _opened(source) as raw:
            sizes = raw.sizes
        with source.stream() as stream:
            tree = read_tags(stream)
            found = tuple(_unread(stream, tree))
        metadata = Metadata(
            exif=exif_of(tree) if tree else None,
            icc=libvips().Image.profile_load("srgb"),
            xmp=(tree.data(xmp.TIFF_TAG) or None) if tree else None,
            resources=chunks.resources_of_tiff(tree) if tree else None,
            found=found,
        )
        orientation = Orientation(_ORIENTATIONS[sizes.flip & 7])
        return Header(self, Coding(bits=16), sizes.iheight, sizes.iwidth, 3, orientation, metadata)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        with _opened(source) as raw:
            with source.stream() as stream:
                whole = is_whole(stream)
            if whole is not False:
                with kept_back(_COMPLAINT):
                    raw.unpack()
            if whole is None:
                whole = is_complete(source, raw.raw_image, _sensor_values)
            if not whole:
                raise UnshutterError("{photo} is incomplete: the file ends too early", photo=source)
            pixels = raw.postprocess(
                user_flip=0, output_bps=16, use_camera_wb=True, no_auto_bright=True, gamma=(2.4, 12.92)
            )
        if pixels.shape != (header.height, header.width, 3):
            raise UnshutterError("{photo} cannot be developed: LibRaw turned or cut it", photo=source)
        return pixels


@contextmanager
def _opened(source: Source) -> Iterator[rawpy.RawPy]:
    try:
        import rawpy
    except ImportError:
        raise UnshutterError(
            f"{{photo}} is a camera's raw file: to read it, {version.extra('raw')}", photo=source
        ) from None
    try:
        with source.stream() as stream, rawpy.RawPy() as raw:
            with kept_back(_COMPLAINT):
                raw.open_buffer(stream)
            yield raw
    except rawpy.LibRawIOError:
        raise UnshutterError(
            "cannot read {photo} as a camera's raw file: the file ends too early", photo=source
        ) from None
    except (rawpy.LibRawError, rawpy.NotSupportedError, ValueError) as error:
        message = error.args[0] if error.args else type(error).__name__
        cause = message.decode(errors="replace") if isinstance(message, bytes) else str(message)
        raise UnshutterError(f"cannot read {{photo}} as a camera's raw file: {cause}", photo=source) from None


# ---- missing data ------------------------------------------------------------------------------------

_SUB_PICTURES = 0x014A
_TABLES = ((0x0111, 0x0117), (0x0144, 0x0145))  # starts and lengths of strips and tiles
_OF_SENSORS = ((32803,), (34892,))  # photometric interpretation: colour filter array, linear raw
_JPEG_XL = 52546  # compression, since DNG 1.7
_ENHANCED = 16  # kind of picture: by a program, from the sensor's values
_FUJI_TABLE = 84  # positions and lengths of the JPEG, the header and the data
_AFTER = b"\xa5" * 65_536  # unlike anything that a decoder substitutes for missing data


def is_whole(file: BinaryIO) -> bool | None:
    """Whether the file contains all data listed in its tables; None if there are no tables, or they may be wrong."""
    length = file.seek(0, io.SEEK_END)
    file.seek(0)
    head = file.read(_FUJI_TABLE + 24)
    if head[4:8] == b"ftyp":
        return max((end for _, _, end in boxes.top_level_extents(file)), default=0) <= length
    if head.startswith(b"FUJIFILM") and len(head) == _FUJI_TABLE + 24:
        places = struct.unpack_from(">6I", head, _FUJI_TABLE)
        return all(start + size <= length for start, size in zip(places[::2], places[1::2], strict=True))
    tree = read_tree(file)
    if tree is None:
        return None
    pictures = [*tree.pages, *_sub_pictures(file, tree)]
    sensors = _of_sensors(pictures, tree)
    if any(start >= length for picture in sensors for start, _ in _parts(picture, tree)):
        return False
    parts = [part for picture in pictures for part in _parts(picture, tree)]
    return True if parts and all(start + size <= length for start, size in parts) else None


def is_complete(source: Source, pixels: np.ndarray, decode: Callable[[BinaryIO], np.ndarray | None]) -> bool:
    """Whether a decoder needed no data beyond the end of the file to find the sensor's values.

    ``decode`` decodes another file; it returns None for an unknown kind, and no values if decoding fails later.
    """
    import numpy as np

    if pixels.min() == pixels.max():  # no sensor is so free of noise: all its data are missing
        return False
    with source.stream() as stream:
        again = decode(io.BytesIO(stream.read() + _AFTER))  # None for kinds read from the end, which skip this check
    return again is None or np.array_equal(again, pixels)


def _sensor_values(stream: BinaryIO) -> np.ndarray | None:
    """Decodes the sensor values; returns None for a kind unknown to LibRaw, no values if the data are damaged."""
    import numpy as np
    import rawpy

    is_known = False
    try:
        with kept_back(_COMPLAINT), rawpy.RawPy() as raw:
            raw.open_buffer(stream)
            is_known = True
            raw.unpack()
            return raw.raw_image.copy()
    except (rawpy.LibRawError, rawpy.NotSupportedError, ValueError):
        return np.empty(0, np.uint16) if is_known else None


def _sub_pictures(file: BinaryIO, tree: Tree) -> list[Directory]:
    """Returns the sub-directories of pages that are separate pictures."""
    offsets = [offset for page in tree.pages for offset in _numbers(page, _SUB_PICTURES, tree)]
    trees = (read_tree(file, most_pages=1, first_at=offset) for offset in offsets[:64])
    return [tree.pages[0] for tree in trees if tree is not None]


def _of_sensors(pictures: list[Directory], tree: Tree) -> list[Directory]:
    """Returns the pictures with a sensor's values, not previews."""
    return [each for each in pictures if _numbers(each, exif.PHOTOMETRIC, tree)[:1] in _OF_SENSORS]


def _is_jpeg_xl(file: BinaryIO) -> bool:
    """Whether a DNG's values of the sensor are compressed with JPEG XL; those of an enhanced copy may be."""
    tree = read_tree(file)
    if tree is None or _DNG_VERSION not in tree.pages[0]:
        return False
    sensors = _of_sensors([*tree.pages, *_sub_pictures(file, tree)], tree)
    own = [each for each in sensors if _numbers(each, SUBFILE_TYPE, tree)[:1] != (_ENHANCED,)]
    return any(_numbers(each, exif.COMPRESSION, tree)[:1] == (_JPEG_XL,) for each in own)


def _parts(picture: Directory, tree: Tree) -> list[tuple[int, int]]:
    """Returns (start, length) of the strips and tiles of a picture."""
    tables = ((_numbers(picture, starts, tree), _numbers(picture, sizes, tree)) for starts, sizes in _TABLES)
    return [part for starts, sizes in tables for part in zip(starts, sizes, strict=False)]


def _numbers(directory: Directory, tag: int, tree: Tree) -> tuple[int, ...]:
    """Returns the values of a SHORT or LONG tag."""
    entry = directory.get(tag)
    if not isinstance(entry, Entry) or entry.kind not in (3, 4, 13):
        return ()
    return struct.unpack(f"{tree.order}{entry.count}{'H' if entry.kind == 3 else 'I'}", entry.data)


# ---- tags --------------------------------------------------------------------------------------------


def _is_raw_tiff(source: Source) -> bool:
    """Whether a file is a DNG, or begins with a preview like the raw files of Nikon and Sony."""
    with source.stream() as stream:
        tree = read_tree(stream, most_pages=1)
    return tree is not None and (_DNG_VERSION in tree.pages[0] or bool((tree.number(SUBFILE_TYPE) or 0) & 1))


def read_tags(file: BinaryIO) -> Tree | None:
    """Reads the directories of a raw file; returns None if there are none that can be read."""
    file.seek(0)
    head = file.read(96)
    if head[:4] in _OTHER_MAGIC:
        file.seek(4)
        return read_tree(io.BytesIO(_MAGIC[head[:2]] + file.read()))
    if head.startswith(b"FUJIFILM") and len(head) == 96:
        start, length = struct.unpack_from(">II", head, 84)
        file.seek(start)
        return exif.read(chunks.exif_of(io.BytesIO(file.read(length)))) or None
    if head[4:12] == b"ftypcrx ":
        return _canon_tags(file)
    return read_tree(file)


def exif_of(tree: Tree) -> bytes | None:
    """Returns EXIF from a raw file's tags; Panasonic stores it all, including the maker note, in a JPEG in one tag."""
    return _whole_exif(tree) or exif.of_tiff(tree)


def _whole_exif(tree: Tree) -> bytes | None:
    """Returns the EXIF of the JPEG that Panasonic stores in a tag; None without one."""
    preview = tree.data(_PANASONIC_JPEG)
    whole = chunks.exif_of(io.BytesIO(preview)) if preview and preview.startswith(b"\xff\xd8") else None
    return whole if exif.read(whole) else None


def _unread(file: BinaryIO, tree: Tree | None) -> Iterator[Found]:
    """Yields the metadata in a raw file that cannot be read here; all the rest is of the sensor and its previews."""
    if tree is None:
        yield Found("EXIF")
    elif _PRIVATE_DATA in tree.pages[0]:
        yield Found(OTHER)
    if tree is not None and _whole_exif(tree) is None and maker_notes.is_incomplete(tree):
        yield Found("parts of the maker's note")
    file.seek(0)
    if file.read(12)[4:] == b"ftypcrx ":
        extents = list(boxes.top_level_extents(file))
        if any(name == b"CMT3" for name, _ in boxes.inside(_canon_box(file))):
            yield Found("maker's note")
        for name, start, _ in extents:
            file.seek(start)
            if name == b"uuid" and file.read(16) == _CANON_XMP:
                yield Found("XMP")


def _canon_box(file: BinaryIO) -> bytes:
    """Returns Canon's own box in a CR3; empty if there is none."""
    try:
        own = dict(boxes.inside(boxes.top_level(file, b"moov"))).get(b"uuid", b"")
    except KeyError:
        return b""
    return own[16:] if own.startswith(_CANON) else b""


def _canon_tags(file: BinaryIO) -> Tree | None:
    """Combines a CR3's separate trees for the first directory, EXIF and GPS into one; the maker note is not read."""
    parts = dict(boxes.inside(_canon_box(file)))
    first, details, place = (read_tree(io.BytesIO(parts.get(name, b""))) for name in (b"CMT1", b"CMT2", b"CMT4"))
    if first is None:
        return None
    more: Directory = {
        tag: tree.pages[0]
        for tag, tree in ((EXIF, details), (GPS, place))
        if tree is not None and tree.order == first.order
    }
    return Tree(first.order, [first.pages[0] | more])


# ---- LibRaw's complaints -----------------------------------------------------------------------------

_STANDARD_ERROR = 2
_turn = Lock()  # there is only one standard error


@contextmanager
def kept_back(pattern: bytes) -> Iterator[None]:
    """Removes complete lines that match a pattern from standard error; other output there is delayed to the end.

    For libraries whose output cannot be disabled. Threads wait for each other here.
    """
    with _turn, tempfile.TemporaryFile() as held:
        try:
            shown = os.dup(_STANDARD_ERROR)
        except OSError:  # closed: nobody would see the output
            yield
            return
        _flush()
        os.dup2(held.fileno(), _STANDARD_ERROR)
        try:
            yield
        finally:
            _flush()
            os.dup2(shown, _STANDARD_ERROR)
            held.seek(0)
            lines = b"".join(line for line in held if not re.fullmatch(pattern, line.rstrip()))
            with suppress(OSError):
                os.write(shown, lines)
            os.close(shown)


def _flush() -> None:
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.flush()
