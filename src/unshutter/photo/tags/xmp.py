"""XMP: what must follow new pixels in it.

Source: Adobe, XMP specification parts 1 and 3.
"""

from __future__ import annotations

import re

TIFF_TAG = 0x02BC


def with_size(packet: bytes, height: int, width: int, orientation: int) -> bytes:
    """The packet with the sizes [px] and the orientation that it has set to these."""
    for names, value in (
        (b"exif:PixelXDimension|tiff:ImageWidth", width),
        (b"exif:PixelYDimension|tiff:ImageLength", height),
        (b"tiff:Orientation", orientation),
    ):
        told = b"\\g<1>%d" % value
        packet = re.sub(rb"(<(?:%s)\s*>\s*)\d+" % names, told, packet)
        packet = re.sub(rb"""((?:%s)\s*=\s*["'])\d+""" % names, told, packet)
    return packet


def without_pictures(packet: bytes) -> bytes:
    """The packet without embedded thumbnails, and without the link to more XMP that a JPEG may have elsewhere."""
    packet = re.sub(rb"<(xmp|xap):Thumbnails\b.*?</\1:Thumbnails\s*>", b"", packet, flags=re.DOTALL)
    return re.sub(rb"""\s+xmpNote:HasExtendedXMP\s*=\s*(["'])[^"']*\1""", b"", packet)
