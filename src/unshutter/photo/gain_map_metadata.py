"""What the numbers of a gain map mean: from the metadata of its JPEG to those of ISO 21496-1 in AVIF.

Source: ISO 21496-1, C.2.2 (GainMapMetadata); Adobe, Gain map 1.0 (properties hdrgm in XMP).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable

from unshutter.photo import xmp
from unshutter.photo.chunks import APP1, APP2, XMP_PREFIX

ISO_PREFIX = b"urn:iso:std:iso:ts:21496"  # of the segment that says that there is a gain map, or what it means
ISO_IN_JPEG = b":-1\0"
SUPPORTED = bytes(2)  # first bytes, if readers of this version understand the rest
_BASE_COLOURS, _CHANNELS = 0x40, 0x80  # flags: computed in the base picture's colours; three channels
_LARGEST = 1 << 20  # denominator
# properties of each channel in ISO's order, with the values that they have if absent
_PER_CHANNEL = (("GainMapMin", 0.0), ("GainMapMax", 1.0), ("Gamma", 1.0), ("OffsetSDR", 1 / 64), ("OffsetHDR", 1 / 64))


def of_segments(segments: Iterable[tuple[int, bytes]]) -> bytes | None:
    """Returns GainMapMetadata of a gain map, given the segments of its JPEG; None if they do not state it."""
    packet = None
    for marker, content in segments:
        if marker == APP2 and content.startswith(ISO_PREFIX + ISO_IN_JPEG):
            stated = content.removeprefix(ISO_PREFIX + ISO_IN_JPEG)
            if stated.startswith(SUPPORTED):
                return stated
        if marker == APP1 and content.startswith(XMP_PREFIX) and b"hdrgm:" in content:
            packet = content.removeprefix(XMP_PREFIX)
    return None if packet is None else _of_xmp(packet)


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
