"""Extended XMP of JPEGs, as far as it belongs to a depth map: what is too long for the first packet, in other segments.

Google's older depth photos have the map itself there, as text; its newer ones describe the map, which follows the
picture.

Source: Adobe, XMP specification part 3 (APP1); Google, Depthmap metadata; Google, Dynamic Depth 1.0.
"""

from __future__ import annotations

import binascii
import struct
from base64 import b64decode, b64encode
from collections.abc import Iterable, Mapping

from unshutter.photo import xmp
from unshutter.photo.parts import CONFIDENCE_MAP, DEPTH_MAP

PREFIX = b"http://ns.adobe.com/xmp/extension/\0"
_HEAD = struct.Struct(">32sII")  # digest, length of the packet, where this part of it begins
_LONGEST = 65_400  # bytes of a part
_ABOUT_DEPTH = (b"google.com/photos/1.0/depthmap/", b"google.com/photos/dd/1.0/")
PICTURES = {"GDepth:Data": DEPTH_MAP, "GDepth:Confidence": CONFIDENCE_MAP}  # names of maps, by their property
_LOST = ("GImage:Data",)  # the picture before its background was blurred


def assembled(segments: Iterable[bytes]) -> bytes | None:
    """Returns the packet about a depth map in the contents of segments; None if it is another, or incomplete."""
    parts = [(_HEAD.unpack_from(each, len(PREFIX)), each[len(PREFIX) + _HEAD.size :]) for each in segments]
    packet = b""
    for (digest, length, at), part in sorted(parts, key=lambda each: each[0][2]):
        if (digest, length, at) != (*parts[0][0][:2], len(packet)):
            return None
        packet += part
    is_whole = bool(parts) and len(packet) == parts[0][0][1]
    return packet if is_whole and any(each in packet for each in _ABOUT_DEPTH) else None


def pictures_in(packet: bytes) -> dict[str, bytes] | None:
    """Returns the files of the maps in a packet, by their property; None if it cannot be read."""
    try:
        read = xmp.Packet(packet)
    except xmp.UnreadableError:
        return None
    found = {}
    for element in read.root.below():
        for name, thing in ((element.name, element), *element.attributes.items()):
            if name in PICTURES:
                try:
                    found[name] = b64decode(read.text(thing))
                except (binascii.Error, ValueError):
                    return None
    return found


def completed(packet: bytes, files: Mapping[str, bytes]) -> bytes:
    """Returns a packet that :func:`pictures_in` can read with other files; maps without a file are removed."""
    read = xmp.Packet(packet)
    for element in read.root.below():
        for name, thing in ((element.name, element), *element.attributes.items()):
            if name in files:
                read.set_text(thing, b64encode(files[name]).decode())
            elif name in PICTURES or name in _LOST:
                read.remove(thing)
    return read.changed()


def digest(packet: bytes) -> str:
    """Returns what the first packet calls an extended one."""
    import hashlib  # imported here: reading a file does not need it

    return hashlib.md5(packet, usedforsecurity=False).hexdigest().upper()


def segments(packet: bytes) -> list[bytes]:
    """Returns the contents of the segments of a packet."""
    name = digest(packet).encode()
    places = range(0, len(packet), _LONGEST)
    return [PREFIX + _HEAD.pack(name, len(packet), at) + packet[at : at + _LONGEST] for at in places]
