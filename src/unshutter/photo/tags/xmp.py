"""XMP: what must change in it along with the pixels.

Source: Adobe, XMP specification parts 1 and 3; Google, Motion Photo format 1.0 and Ultra HDR image format 1.1.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from unshutter.photo.tags.xmp_packet import Attribute, Element, Packet

TIFF_TAG = 0x02BC
# Packets without these names, which are most, have nothing that must follow new pixels, and are not even parsed.
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
_OLD_FILM_LENGTH = "GCamera:MicroVideoOffset"  # which is counted from the end of the file


class FilmPlace(NamedTuple):
    """Where a motion photo's film is in its file.

    Attributes:
        at: from the end of the picture to its beginning [bytes].
        length: of the film [bytes].
        to_end: from its beginning to the end of the file [bytes].
    """

    at: int
    length: int
    to_end: int


class Next(NamedTuple):
    """The picture that a packet is to be true of.

    Attributes:
        height, width: of the stored pixels [px].
        orientation: EXIF orientation 1-8; None: the packet's own is kept.
        is_new: whether the pixels are others than before, so that small pictures of the old ones go.
        film: of a motion photo, if it is still behind the picture. Gain maps, depth maps and other additional pictures
            never are.
    """

    height: int
    width: int
    orientation: int | None
    is_new: bool
    film: FilmPlace | None


def after(packet: bytes, picture: Next) -> bytes | None:
    """The packet adapted to the next picture; all else is kept byte by byte.

    None where it cannot be read, and may describe pictures that are gone.
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
    """What must follow of one property, which is an element or an attribute."""
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
    """Takes all but the picture and the film out of the list of what is in the file, and says where the film is."""
    for item in directory.below():
        meaning = _value(item, _SEMANTIC)
        if item.name == "rdf:li" and meaning not in (None, "Primary", "MotionPhoto"):
            packet.remove(item)
        if _PADDING in item.attributes:  # between this item's end and the next one
            packet.set_number(item.attributes[_PADDING], film.at if meaning == "Primary" else 0)
        length = item.attributes.get(_LENGTH)
        if meaning == "MotionPhoto" and length is not None and length.value != str(film.length):
            packet.set_number(length, film.to_end)  # Samsung's may reach to the file's end


# ---- further pictures and films ------------------------------------------------------------------------


def film_bytes(packet: bytes | None) -> int | None:
    """Length of a motion photo's film, which ends with the file; None where there is none."""
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
    """Names of additional pictures and films that the packet describes, and that the next file lacks."""
    film = not has_film and film_bytes(packet) is not None
    return ["gain map"] * has_gain_map(packet) + ["film"] * film


def has_gain_map(packet: bytes | None) -> bool:
    """Whether the packet describes a gain map."""
    return packet is not None and (b"GainMap" in packet or b"hdrgm:" in packet)


def _read(packet: bytes) -> Packet | None:
    from unshutter.photo.tags.xmp_packet import Packet, UnreadableError  # here: seldom needed

    try:
        return Packet(packet)
    except UnreadableError:
        return None


def _value(item: Element, name: str) -> str | None:
    """Value of an attribute of an item of a list, or of an element in it."""
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
