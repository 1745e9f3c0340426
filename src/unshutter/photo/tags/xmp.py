"""XMP: updates properties that must change along with the pixels.

Source: Adobe, XMP specification parts 1 and 3; Google, Motion Photo format 1.0 and Ultra HDR image format 1.1.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from unshutter.photo.tags.xmp_packet import Attribute, Element, Packet

TIFF_TAG = 0x02BC
# Most packets contain none of these names; nothing in them depends on the pixels, and they are not even parsed.
_FOLLOWS = re.compile(
    rb"Image(?:Width|Length)|Pixel[XY]Dimension|Orientation|Thumbnails|HasExtendedXMP|MotionPhoto|MicroVideo"
    rb"|Container|[Gg]ain[Mm]ap|gain-map|depthmap|photos/1.0/image|GDepth|GImage|hdrgm|<!DOCTYPE"
)
_WIDTHS, _HEIGHTS = ("exif:PixelXDimension", "tiff:ImageWidth"), ("exif:PixelYDimension", "tiff:ImageLength")
_SMALL_OR_ELSEWHERE = ("xmp:Thumbnails", "xmpNote:HasExtendedXMP")
_FILM = re.compile("GCamera:(MotionPhoto|MicroVideo)")
_BESIDE = re.compile("(hdrgm|HDRGainMap|GDepth|GImage):")
_DIRECTORY = "Container:Directory"
_SEMANTIC, _LENGTH, _PADDING = "Item:Semantic", "Item:Length", "Item:Padding"
_OLD_FILM_LENGTH = "GCamera:MicroVideoOffset"  # relative to the end of the file


class FilmPlace(NamedTuple):
    """Position of a motion photo's film in its file.

    Attributes:
        at: distance from the end of the picture to the film's start [bytes].
        length: of the film [bytes].
        to_end: distance from the film's start to the end of the file [bytes].
    """

    at: int
    length: int
    to_end: int


class Next(NamedTuple):
    """The picture that a packet should describe.

    Attributes:
        height, width: size of the stored pixels [px].
        orientation: EXIF orientation 1-8; None: the packet's own is kept.
        is_new: whether the pixels have changed, so that thumbnails of the old ones are removed.
        film: film of a motion photo, if it still follows the picture. Gain maps, depth maps and other extra pictures
            never do.
    """

    height: int
    width: int
    orientation: int | None
    is_new: bool
    film: FilmPlace | None


def after(packet: bytes, picture: Next) -> bytes | None:
    """Adapts the packet to the next picture; everything else is kept byte for byte.

    Returns None if the packet cannot be read and may describe pictures that no longer exist.
    """
    if not _FOLLOWS.search(packet):
        return packet
    read = _read(packet)
    if read is None:
        is_stale = b"<!DOCTYPE" in packet or (picture.is_new and b"Thumbnails" in packet) or b"photos/1.0/" in packet
        return None if is_stale else packet
    directory = None
    for element in read.root.below():
        _follow(read, element, element.name, picture)
        for name, attribute in element.attributes.items():
            _follow(read, attribute, name, picture)
        if element.name == _DIRECTORY and directory is None:
            directory = element
    if directory is not None and picture.film is not None:
        _keep_film_alone(read, directory, picture.film)
    return read.changed()


def _follow(packet: Packet, thing: Element | Attribute, name: str, picture: Next) -> None:
    """Updates or removes one property, which is an element or an attribute."""
    if name in _WIDTHS:
        packet.set_number(thing, picture.width)
    elif name in _HEIGHTS:
        packet.set_number(thing, picture.height)
    elif name == "tiff:Orientation":
        if picture.orientation is None:
            return
        packet.set_number(thing, picture.orientation)
    elif name == _OLD_FILM_LENGTH and picture.film is not None:
        packet.set_number(thing, picture.film.to_end)
    elif (
        _BESIDE.match(name)
        or (picture.is_new and name in _SMALL_OR_ELSEWHERE)
        or (picture.film is None and (name == _DIRECTORY or _FILM.match(name)))
    ):
        packet.remove(thing)


def _keep_film_alone(packet: Packet, directory: Element, film: FilmPlace) -> None:
    """Reduces the list of the file's contents to picture and film, and updates the film's position."""
    for item in directory.below():
        meaning = _value(item, _SEMANTIC)
        if item.name == "rdf:li" and meaning not in (None, "Primary", "MotionPhoto"):
            packet.remove(item)
        if _PADDING in item.attributes:  # between the end of this item and the next one
            packet.set_number(item.attributes[_PADDING], film.at if meaning == "Primary" else 0)
        length = item.attributes.get(_LENGTH)
        if meaning == "MotionPhoto" and length is not None and length.value != str(film.length):
            packet.set_number(length, film.to_end)  # Samsung's may extend to the end of the file


# ---- further pictures and films ------------------------------------------------------------------------


def film_bytes(packet: bytes | None) -> int | None:
    """Returns the length of a motion photo's film, which ends with the file; None if there is none."""
    if packet is None or (b"MotionPhoto" not in packet and b"MicroVideo" not in packet):
        return None
    read = _read(packet)
    if read is None:
        return None
    length = None
    for element in read.root.below():
        if element.name == "rdf:li" and _value(element, _SEMANTIC) == "MotionPhoto":
            return _whole(_value(element, _LENGTH))
        if length is None:
            length = _whole(_own(read, element, _OLD_FILM_LENGTH))
    return length


def gone(packet: bytes, has_film: bool) -> list[str]:
    """Names additional pictures and films that the packet describes but the next file lacks."""
    film = not has_film and film_bytes(packet) is not None
    return ["gain map"] * has_gain_map(packet) + ["film"] * film


def has_gain_map(packet: bytes | None) -> bool:
    """Whether the packet describes a gain map."""
    return packet is not None and (b"GainMap" in packet or b"hdrgm:" in packet)


def _read(packet: bytes) -> Packet | None:
    from unshutter.photo.tags.xmp_packet import Packet, UnreadableError  # imported here: rarely needed

    try:
        return Packet(packet)
    except UnreadableError:
        return None


def _value(item: Element, name: str) -> str | None:
    """Returns the value of an attribute of a list item, or of an element in it."""
    return next(
        (element.attributes[name].value for element in (item, *item.children) if name in element.attributes), None
    )


def _own(packet: Packet, element: Element, name: str) -> str | None:
    if element.name == name:
        return packet.data[element.content_at : element.content_end].decode(errors="replace")
    return element.attributes[name].value if name in element.attributes else None


def _whole(text: str | None) -> int | None:
    text = (text or "").strip()
    return int(text) if text.isascii() and text.isdigit() and len(text) < 19 else None
