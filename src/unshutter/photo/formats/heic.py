"""HEIC: read through libheif (package pi-heif, extra ``heic``).

A HEIC file contains the pixels as read from the sensor; its boxes irot and imir state how a viewer should rotate and
mirror them. libheif always applies them while decoding, which is undone here.

Source: ISO/IEC 23008-12 (HEIF).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, BinaryIO, final

from unshutter import installation
from unshutter.errors import UnshutterError
from unshutter.photo.containers import boxes, items
from unshutter.photo.format import Coding, Format, Header
from unshutter.photo.libvips import in_plain_words, profile_of
from unshutter.photo.metadata import Metadata
from unshutter.photo.source import Source
from unshutter.photo.tags import exif

if TYPE_CHECKING:
    import numpy as np

_SIGNATURE = re.compile(rb"....ftyp(hevc|hevx|msf1|(....)*(hei[cxms]|mif1))", re.DOTALL)


@final
class Heic(Format):
    """HEIC: read-only."""

    name, written_as = "heic", "avif"
    suffixes = (".heic", ".heif", ".hif")

    def recognises(self, source: Source, head: bytes) -> bool:
        """See Format."""
        return _SIGNATURE.match(head) is not None

    def read_header(self, source: Source) -> Header:
        """See Format."""
        boxes.refuse_animation(source)
        picture = _primary(source)
        info = picture.info
        with source.stream() as stream:
            own, left_behind = boxes.read_coding(stream), items.extras_in_words(stream)
        height, width = own.orientation.size(*picture.size[::-1])
        profile, packet = info.get("icc_profile") or profile_of(*own.code_points, source), info.get("xmp")
        blob = info.get("exif")
        metadata = Metadata(
            exif=exif.without_loop(blob) if blob else None,
            icc=bytes(profile) if profile else None,
            xmp=bytes(packet) if packet else None,
            left_behind=(("EXIF (damaged)",) if blob and exif.has_loop(blob) else ()) + left_behind,
        )
        coding = Coding(subsampled=info.get("chroma") == 420, bits=info["bit_depth"])
        return Header(self, coding, height, width, len(_channels(picture)), own.orientation, metadata)

    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        pixels = header.orientation.stored(_upright_pixels(source))
        if pixels.shape != (header.height, header.width, header.bands):
            raise UnshutterError("{photo} is damaged: it holds another picture than it says", photo=source)
        return pixels


def _upright_pixels(source: Source) -> np.ndarray:
    """Decodes the primary picture, [H, W, bands] uint8 or uint16, rotated and mirrored as the file specifies."""
    import numpy as np

    picture = _primary(source)
    try:
        pixels = np.array(picture)  # copied, because pi-heif's pixels are freed with its picture
    except Exception as error:  # libheif's errors, in whichever class pi-heif raises them
        raise UnshutterError(f"{{photo}} is damaged or incomplete: {_cause(error)}", photo=source) from None
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    if _channels(picture).endswith("a"):  # colours are premultiplied
        top = np.iinfo(pixels.dtype).max
        opacity = np.maximum(pixels[..., -1:], 1) / top
        plain = np.minimum(np.round(pixels[..., :-1] / opacity), top).astype(pixels.dtype)
        pixels = np.concatenate([plain, pixels[..., -1:]], axis=2)
    pixels.setflags(write=False)
    return pixels


def _channels(picture: Any) -> str:
    """Returns one letter per channel."""
    return picture.mode.partition(";")[0]


def _primary(source: Source) -> Any:
    try:
        import pi_heif
    except ImportError:
        raise UnshutterError(
            f"{{photo}} is a HEIC photo: to read it, {installation.extra('heic')}", photo=source
        ) from None
    try:
        with source.stream() as stream:
            if not _item_names_are_text(stream):
                raise ValueError("names of its parts are not text")
            file = pi_heif.open_heif(stream, convert_hdr_to_8bit=False)
            if not len(file):
                raise ValueError("it holds no picture")
            return file[file.primary_index]
    except OSError as error:
        if error.strerror:
            raise
        raise UnshutterError(
            f"{{photo}} is a HEIC photo, damaged, incomplete or unusual: {_cause(error)}", photo=source
        ) from None
    except Exception as error:
        raise UnshutterError(
            f"{{photo}} is a HEIC photo, damaged, incomplete or unusual: {_cause(error)}", photo=source
        ) from None


def _item_names_are_text(file: BinaryIO) -> bool:
    """Whether the types of all items are ASCII; otherwise pi-heif crashes (1.4)."""
    try:
        iinf = dict(boxes.inside(boxes.top_level(file, b"meta")[4:]))[b"iinf"]
    except KeyError:
        return True  # reported elsewhere
    entries = (content for name, content in boxes.inside(iinf[6 if iinf[:1] == b"\0" else 8 :]) if name == b"infe")
    return all(byte < 128 for entry in entries for byte in entry[8:])


def _cause(error: Exception) -> str:
    return in_plain_words(" ".join(str(error).split())) or type(error).__name__
