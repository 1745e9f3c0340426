"""What the numbers of a gain map mean: from the metadata of its JPEG to those of ISO 21496-1 in AVIF.

Source: ISO 21496-1, C.2.2 (GainMapMetadata); Adobe, Gain map 1.0 (properties hdrgm in XMP); Apple, Applying Apple HDR
effect to your photos; ITU-R BT.709.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from unshutter.photo import maker_notes, xmp
from unshutter.photo.chunks import APP1, APP2, XMP_PREFIX

if TYPE_CHECKING:
    import numpy as np

ISO_PREFIX = b"urn:iso:std:iso:ts:21496"  # of the segment that says that there is a gain map, or what it means
ISO_IN_JPEG = b":-1\0"
SUPPORTED = bytes(2)  # first bytes, if readers of this version understand the rest
_BASE_COLOURS, _CHANNELS = 0x40, 0x80  # flags: computed in the base picture's colours; three channels
_HEADROOM, _GAIN = 33, 48  # tags of Apple's maker note
_MOST_STOPS = 8  # a greater number is damaged
_LARGEST = 1 << 20  # denominator
# properties of each channel in ISO's order, with the values that they have if absent
_PER_CHANNEL = (("GainMapMin", 0.0), ("GainMapMax", 1.0), ("Gamma", 1.0), ("OffsetSDR", 1 / 64), ("OffsetHDR", 1 / 64))


class Meaning(NamedTuple):
    """What the numbers of a gain map mean."""

    metadata: bytes  # GainMapMetadata
    stops: float | None = None  # that the greatest one adds, if they are Apple's; see :func:`in_logarithms`


def of_segments(segments: Iterable[tuple[int, bytes]], exif: bytes | None) -> Meaning | None:
    """Returns what a gain map means, given the segments of its JPEG and the photo's EXIF; None if unknown."""
    packet = b""
    for marker, content in segments:
        if marker == APP2 and content.startswith(ISO_PREFIX + ISO_IN_JPEG):
            stated = content.removeprefix(ISO_PREFIX + ISO_IN_JPEG)
            if stated.startswith(SUPPORTED):
                return Meaning(stated)
        if marker == APP1 and content.startswith(XMP_PREFIX):
            packet += content.removeprefix(XMP_PREFIX)
    if b"hdrgm:" in packet:
        metadata = _of_xmp(packet)
        return None if metadata is None else Meaning(metadata)
    stops = _apples_stops(packet, exif) if b"com:apple:photo:2020:aux:hdrgainmap" in packet else 0.0
    if not 0 < stops <= _MOST_STOPS:
        return None
    numbers = (0, stops, 0, stops, 1, 0, 0)  # headrooms, gains, gamma, offsets
    return Meaning(bytes(4) + bytes([_BASE_COLOURS]) + b"".join(map(_fraction, numbers)), stops)


def _apples_stops(packet: bytes, exif: bytes | None) -> float:
    """Returns by how many stops Apple's map makes white brighter at most, as its XMP or its maker note says; else 0."""
    stated = xmp.values(packet, "HDRGainMap:").get("HDRGainMap:HDRGainMapHeadroom")
    if stated:
        with suppress(ValueError):
            return math.log2(float(stated[0]))
    note = maker_notes.apple(exif)
    if not (note.numbers(_HEADROOM) and note.numbers(_GAIN)):
        return 0.0
    headroom, gain = note.numbers(_HEADROOM)[0], note.numbers(_GAIN)[0]
    if headroom < 1:
        return -20 * gain + 1.8 if gain <= 0.01 else -0.101 * gain + 1.601
    return -70 * gain + 3.0 if gain <= 0.01 else -0.303 * gain + 2.303


def in_logarithms(pixels: np.ndarray, stops: float) -> np.ndarray:
    """Converts an Apple's map, which is proportional to the light that it adds and coded as video is, to logarithms."""
    import numpy as np

    code = np.arange(256) / 255
    share = np.where(code < 0.081, code / 4.5, ((code + 0.099) / 1.099) ** (1 / 0.45))
    return np.rint(255 * np.log2(1 + (2**stops - 1) * share) / stops).astype(np.uint8)[pixels]


def _of_xmp(packet: bytes) -> bytes | None:
    """Converts Adobe's properties, logarithms to base 2 in both; None if they are damaged."""
    stated = xmp.values(packet, "hdrgm:")
    try:
        channels = [[float(each) for each in stated.get("hdrgm:" + name, [usual])] for name, usual in _PER_CHANNEL]
        headroom = [
            float(stated.get("hdrgm:HDRCapacity" + name, [usual])[0]) for name, usual in (("Min", 0), ("Max", 1))
        ]
        if stated.get("hdrgm:BaseRenditionIsHDR", ["False"])[0] == "True":
            headroom.reverse()
            channels[3:] = reversed(channels[3:])
        count = 1 if all(len(set(each)) == 1 for each in channels) else 3
        numbers = [each[at % len(each)] for at in range(count) for each in channels]
        flags = _BASE_COLOURS | (_CHANNELS if count == 3 else 0)
        return bytes(4) + bytes([flags]) + b"".join(map(_fraction, [*headroom, *numbers]))
    except (ValueError, IndexError, OverflowError, struct.error):
        return None


def _fraction(value: float) -> bytes:
    from fractions import Fraction  # imported here: reading a file does not need it

    if not math.isfinite(value):
        raise ValueError
    exact = Fraction(value).limit_denominator(_LARGEST)
    return struct.pack(">iI", exact.numerator, exact.denominator)
