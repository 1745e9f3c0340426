"""XMP: a packet as a tree with positions, and updates of the properties that must change along with the pixels.

Changes are made in the packet's bytes, and the rest is left unchanged. The parser is Python's expat, restricted against
dangerous XML: a packet with a document type, which alone can define entities, is rejected, as is one with too many
elements. The time taken is proportional to the packet's size.

Source: W3C, XML 1.0 and Namespaces in XML; ISO 16684-1 (XMP); Adobe, XMP specification parts 1 and 3; Google, Motion
Photo format 1.0 and Ultra HDR image format 1.1.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple
from xml.parsers import expat

from unshutter.photo.parts import CONFIDENCE_MAP, DEPTH_MAP, GAIN_MAP, PICTURES, Found, further_picture

# Prefixes and their namespaces; packets that use them undeclared are accepted.
NAMESPACES = {
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "xmp": "http://ns.adobe.com/xap/1.0/",
    "xap": "http://ns.adobe.com/xap/1.0/",
    "xmpNote": "http://ns.adobe.com/xmp/note/",
    "tiff": "http://ns.adobe.com/tiff/1.0/",
    "exif": "http://ns.adobe.com/exif/1.0/",
    "hdrgm": "http://ns.adobe.com/hdr-gain-map/1.0/",
    "HDRGainMap": "http://ns.apple.com/HDRGainMap/1.0/",
    "GCamera": "http://ns.google.com/photos/1.0/camera/",
    "Container": "http://ns.google.com/photos/1.0/container/",
    "Item": "http://ns.google.com/photos/1.0/container/item/",
    "GDepth": "http://ns.google.com/photos/1.0/depthmap/",
    "GImage": "http://ns.google.com/photos/1.0/image/",
    "DynamicContainer": "http://ns.google.com/photos/dd/1.0/container/",
    "DynamicDepth": "http://ns.google.com/photos/dd/1.0/depthmap/",
    "GPano": "http://ns.google.com/photos/1.0/panorama/",
    "GFocus": "http://ns.google.com/photos/1.0/focus/",
    "crs": "http://ns.adobe.com/camera-raw-settings/1.0/",
    "drone-dji": "http://www.dji.com/drone-dji/1.0/",
    "mwg-rs": "http://www.metadataworkinggroup.com/schemas/regions/",
    "stDim": "http://ns.adobe.com/xap/1.0/sType/Dimensions#",
    "stArea": "http://ns.adobe.com/xmp/sType/Area#",
    "MP": "http://ns.microsoft.com/photo/1.2/",
    "MPRI": "http://ns.microsoft.com/photo/1.2/t/RegionInfo#",
    "MPReg": "http://ns.microsoft.com/photo/1.2/t/Region#",
    "acdsee-rs": "http://ns.acdsee.com/regions/",
    "acdsee-stDim": "http://ns.acdsee.com/sType/Dimensions#",
    "acdsee-stArea": "http://ns.acdsee.com/sType/Area#",
    "Iptc4xmpExt": "http://iptc.org/std/Iptc4xmpExt/2008-02-29/",
}
_PREFIX_OF = {uri: prefix for prefix, uri in reversed(NAMESPACES.items())}
_TAG_NAME = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"""\s*([^\s=/>]+)\s*=\s*("[^"]*"|'[^']*')""")
_TAG_END = re.compile(rb"\s*(/?)>")


_RDF = NAMESPACES["rdf"].encode()


class UnreadableError(Exception):
    """A packet that is not well-formed, or too dangerous to read."""


@dataclass(slots=True)
class Attribute:
    """An attribute: its value, and the positions of the whole attribute (with preceding space) and of the value."""

    value: str
    at: int
    end: int
    value_at: int
    value_end: int


@dataclass(slots=True)
class Element:
    """An element."""

    name: str  # with the usual prefix of its namespace, regardless of the packet's: ``tiff:Orientation``
    at: int  # start of the whole element
    content_at: int  # start of the content between its tags
    attributes: dict[str, Attribute]  # attributes by name, in the same form
    end: int = 0
    content_end: int = 0
    children: list[Element] = field(default_factory=list)  # direct child elements

    def below(self) -> Iterator[Element]:
        """Yields this element and all elements inside it."""
        waiting: list[Element] = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting.extend(reversed(element.children))


class Packet:
    """A packet and the changes to be made in it."""

    def __init__(self, data: bytes) -> None:
        """Parses the packet."""
        self.data = data
        self.root = _Reader(data).root
        self._changes: list[tuple[int, int, bytes]] = []

    def remove(self, thing: Element | Attribute) -> None:
        """Removes an element with its content, or an attribute."""
        self._changes.append((thing.at, thing.end, b""))

    def text(self, thing: Element | Attribute) -> str:
        """Returns the text of an element or the value of an attribute."""
        at, end = _text_extent(thing)
        return self.data[at:end].decode(errors="replace")

    def set_text(self, thing: Element | Attribute, text: str) -> None:
        """Sets the text of an element or the value of an attribute."""
        self._changes.append((*_text_extent(thing), text.encode()))

    def set_number(self, thing: Element | Attribute, value: int) -> None:
        """Sets the text of an element or the value of an attribute, if it is an integer now."""
        at, end = _text_extent(thing)
        old = self.data[at:end]
        if old.strip().isdigit():
            at += len(old) - len(old.lstrip())
            self._changes.append((at, at + len(old.strip()), b"%d" % value))

    def changed(self) -> bytes:
        """Returns the packet with all changes."""
        pieces = []
        done = 0
        for at, end, new in sorted(self._changes, key=lambda change: (change[0], -change[1])):
            if at >= done:  # otherwise inside a removed part
                pieces += [self.data[done:at], new]
                done = end
        return b"".join([*pieces, self.data[done:]])


def _text_extent(thing: Element | Attribute) -> tuple[int, int]:
    is_element = isinstance(thing, Element)
    return (thing.content_at, thing.content_end) if is_element else (thing.value_at, thing.value_end)


class _Reader:
    """Handlers for expat, which reports where an element begins; its tag is parsed again for attribute positions."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._bound: dict[str, list[str]] = {}  # by prefix: namespaces, innermost declaration last
        self._declared: list[list[str]] = []  # prefixes declared by each open element
        self._open: list[Element] = []
        self._elements = 0
        parser = self._parser = expat.ParserCreate()
        parser.StartElementHandler = self._begin
        parser.EndElementHandler = self._finish
        parser.StartDoctypeDeclHandler = self._refuse
        try:
            parser.Parse(data.rstrip(b"\0"), True)
        except (expat.ExpatError, ValueError, LookupError) as error:
            raise UnreadableError(str(error)) from None
        finally:
            parser.StartElementHandler = parser.EndElementHandler = parser.StartDoctypeDeclHandler = None

    def _refuse(self, *_: object) -> None:
        raise UnreadableError("it has a document type")

    def _begin(self, name: str, values: dict[str, str]) -> None:
        self._elements += 1
        if self._elements > 100_000:
            raise UnreadableError("it has too many elements")
        prefixes = [key[6:] for key in values if key.startswith("xmlns:")]
        for prefix in prefixes:
            self._bound.setdefault(prefix, []).append(values[f"xmlns:{prefix}"])
        self._declared.append(prefixes)
        at = self._parser.CurrentByteIndex
        attributes, end, is_empty = self._tag(at, values)
        element = Element(self._usual(name), at, end, attributes, end if is_empty else 0, end)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _finish(self, _: str) -> None:
        element = self._open.pop()
        for prefix in self._declared.pop():
            self._bound[prefix].pop()
        if not element.end:
            element.content_end = self._parser.CurrentByteIndex
            element.end = self._data.index(b">", element.content_end) + 1

    def _tag(self, at: int, values: dict[str, str]) -> tuple[dict[str, Attribute], int, bool]:
        """Parses (attributes, end of the tag, whether the element is empty) from a tag that expat has accepted."""
        start = _TAG_NAME.match(self._data, at)
        place = start.end() if start else at
        attributes = {}
        while match := _ATTRIBUTE.match(self._data, place):
            place = match.end()
            name = match[1].decode(errors="replace")
            if not name.startswith("xmlns"):
                value = values.get(name, "")
                attributes[self._usual(name)] = Attribute(value, *match.span(), match.start(2) + 1, match.end(2) - 1)
        end = _TAG_END.match(self._data, place)
        if end is None:  # an encoding that does not include ASCII
            raise UnreadableError("it is not in UTF-8")
        return attributes, end.end(), bool(end[1])

    def _usual(self, name: str) -> str:
        """Returns a name with the usual prefix of its namespace."""
        prefix, colon, local = name.partition(":")
        bound = self._bound.get(prefix)
        uri = bound[-1] if bound else NAMESPACES.get(prefix, prefix)
        return f"{_PREFIX_OF.get(uri, uri)}:{local}" if colon else name


# ---- what follows the pixels ---------------------------------------------------------------------------

TIFF_TAG = 0x02BC
# Most packets contain none of these names; nothing in them depends on the pixels, and they are not even parsed.
_FOLLOWS = re.compile(
    rb"Image(?:Width|Length)|Pixel[XY]Dimension|Orientation|Thumbnails|HasExtendedXMP|MotionPhoto|MicroVideo"
    rb"|Container|[Gg]ain[Mm]ap|gain-map|depthmap|photos/1.0/image|GDepth|GImage|hdrgm|<!DOCTYPE"
)
_WIDTHS = ("exif:PixelXDimension", "tiff:ImageWidth", "GDepth:ImageWidth")
_HEIGHTS = ("exif:PixelYDimension", "tiff:ImageLength", "GDepth:ImageHeight")
_SMALL_OR_ELSEWHERE = ("xmp:Thumbnails", "xmpNote:HasExtendedXMP")
_VIDEO = re.compile("GCamera:(MotionPhoto|MicroVideo)")
_OF_GAIN_MAP = re.compile("(hdrgm|HDRGainMap):")
# what results lack, by prefix: Google's older and newer depth photos
_BESIDE = {"GDepth": DEPTH_MAP, "GImage": PICTURES, "DynamicContainer": PICTURES, "DynamicDepth": DEPTH_MAP}
# names by what a list of contents says
_AUXILIARY = {"GainMap": GAIN_MAP, "Depth": DEPTH_MAP, "DepthMap": DEPTH_MAP, "Confidence": CONFIDENCE_MAP}
_DIRECTORY = "Container:Directory"
_SEMANTIC = "Item:Semantic"
_LENGTH = "Item:Length"
_PADDING = "Item:Padding"
_MIME = "Item:Mime"
_OLD_VIDEO_LENGTH = "GCamera:MicroVideoOffset"  # relative to the end of the file


class VideoPlace(NamedTuple):
    """Position of a motion photo's video in its file."""

    at: int  # distance from the end of the picture to the video's start [bytes]
    length: int  # of the video [bytes]
    to_end: int  # distance from the video's start to the end of the file [bytes]


class NextPicture(NamedTuple):
    """The picture that a packet should describe."""

    height: int
    width: int
    orientation: int | None  # EXIF orientation 1-8; None: the packet's own is kept
    is_new: bool  # whether the pixels have changed, so that thumbnails of the old ones are removed
    video: VideoPlace | None  # of a motion photo, if it still follows the picture
    # name and length [bytes] of the auxiliary pictures that follow it
    auxiliaries: tuple[tuple[str, int], ...] = ()
    extension: str | None = None  # digest of extended XMP about a depth map that it has

    @property
    def has_gain_map(self) -> bool:
        """Whether a gain map follows it."""
        return any(name == GAIN_MAP for name, _ in self.auxiliaries)


def updated(packet: bytes, picture: NextPicture) -> bytes | None:
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
        _update(read, element, element.name, picture)
        for name, attribute in element.attributes.items():
            _update(read, attribute, name, picture)
        if element.name == _DIRECTORY and directory is None:
            directory = element
    if directory is not None and (picture.video is not None or picture.auxiliaries):
        _update_contents(read, directory, picture)
    return read.changed()


def _update(packet: Packet, thing: Element | Attribute, name: str, picture: NextPicture) -> None:
    """Updates or removes one property, which is an element or an attribute."""
    is_beside = name.partition(":")[0] in _BESIDE
    if picture.extension is not None and name == "xmpNote:HasExtendedXMP":
        packet.set_text(thing, picture.extension)
    elif name in _WIDTHS:
        packet.set_number(thing, picture.width)
    elif name in _HEIGHTS:
        packet.set_number(thing, picture.height)
    elif name == "tiff:Orientation":
        if picture.orientation is not None:
            packet.set_number(thing, picture.orientation)
    elif name == _OLD_VIDEO_LENGTH and picture.video is not None:
        packet.set_number(thing, picture.video.to_end)
    elif (
        (is_beside and (picture.extension is None or name.startswith("GImage:")))
        or (_OF_GAIN_MAP.match(name) and not picture.has_gain_map)
        or (picture.is_new and name in _SMALL_OR_ELSEWHERE)
        or (picture.video is None and _VIDEO.match(name))
        or (picture.video is None and not picture.auxiliaries and name == _DIRECTORY)
    ):
        packet.remove(thing)


def _update_contents(packet: Packet, directory: Element, picture: NextPicture) -> None:
    """Reduces the list of the file's contents to what follows the picture, and updates lengths and positions."""
    video = picture.video
    before_video = 0 if video is None else video.at  # bytes between the end of the last picture and the video
    left = list(picture.auxiliaries)
    for item in (element for element in directory.below() if element.name == "rdf:li"):
        meaning = _text(packet, _property(item, _SEMANTIC)) or "Primary"
        following = next((each for each in left if each[0] == _AUXILIARY.get(meaning)), None)
        if meaning != "Primary" and not (meaning == "MotionPhoto" and video is not None) and following is None:
            packet.remove(item)
            continue
        mime = _property(item, _MIME)
        if mime is not None and packet.text(mime).startswith("image/"):
            packet.set_text(mime, "image/jpeg")  # it may come from a HEIC
        length = _property(item, _LENGTH)
        if following is not None and length is not None:
            packet.set_number(length, following[1])
            left.remove(following)
        elif video is not None and length is not None and packet.text(length) != str(video.length):
            packet.set_number(length, video.to_end)  # Samsung's may extend to the end of the file
        padding = _property(item, _PADDING)  # between the end of this item and the next one
        if padding is not None:
            is_before_video = not left and meaning != "MotionPhoto" and (following or not picture.auxiliaries)
            packet.set_number(padding, before_video if is_before_video else 0)


# ---- further pictures and videos ------------------------------------------------------------------------


def video_bytes(packet: bytes | None) -> int | None:
    """Returns the length of a motion photo's video, which ends with the file; None if there is none."""
    if packet is None or (b"MotionPhoto" not in packet and b"MicroVideo" not in packet):
        return None
    read = _read(packet)
    if read is None:
        return None
    length = None
    for element in read.root.below():
        if element.name == "rdf:li" and _text(read, _property(element, _SEMANTIC)) == "MotionPhoto":
            return _integer(_text(read, _property(element, _LENGTH)))
        if length is None:
            length = _integer(_text_of(read, element, _OLD_VIDEO_LENGTH))
    return length


def names_by_length(packet: bytes | None) -> dict[int, list[str]]:
    """Names the further pictures that the packet lists, by their length [bytes], in their order."""
    read = _read(packet) if packet is not None and b"Semantic" in packet else None
    if read is None:
        return {}
    names: dict[int, list[str]] = {}
    for item in read.root.below():
        meaning = _text(read, _property(item, _SEMANTIC)) if item.name == "rdf:li" else None
        length = _integer(_text(read, _property(item, _LENGTH)))
        if meaning not in (None, "Primary", "MotionPhoto") and length is not None:
            names.setdefault(length, []).append(_AUXILIARY.get(meaning, PICTURES))
    return names


def values(packet: bytes, prefix: str) -> dict[str, list[str]]:
    """Returns the texts of the properties whose names begin with a prefix, several of a list; none if damaged."""
    read = _read(packet)
    found: dict[str, list[str]] = {}
    for element in read.root.below() if read is not None else ():
        found.update((name, [each.value]) for name, each in element.attributes.items() if name.startswith(prefix))
        if read is not None and element.name.startswith(prefix):
            texts = [each for each in element.below() if not each.children]
            found[element.name] = [read.text(each).strip() for each in texts]
    return found


def with_description(packet: bytes | None, attributes: bytes, content: bytes = b"") -> bytes:
    """Adds properties to a packet, as attributes with their namespaces, and as elements."""
    packet = packet or b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="%s"/></x:xmpmeta>' % _RDF
    added = b'<rdf:Description xmlns:rdf="%s" rdf:about="" %s>%s</rdf:Description>' % (_RDF, attributes, content)
    packet = re.sub(rb"<(\w+:RDF)\b([^>]*)/>", rb"<\1\2></\1>", packet, count=1)
    return re.sub(rb"(</\w+:RDF\s*>)", added.replace(b"\\", rb"\\") + rb"\1", packet, count=1)


def lost(packet: bytes, has_video: bool, known: Collection[str]) -> Iterator[Found]:
    """Yields the additional pictures and videos that the packet describes but the next file lacks.

    Args:
        known: names of those that are listed already.
    """
    if GAIN_MAP not in known and has_gain_map(packet):
        yield further_picture(GAIN_MAP)
    read = _read(packet) if _FOLLOWS.search(packet) else None
    names = {name for element in read.root.below() for name in (element.name, *element.attributes)} if read else ()
    beside = {_BESIDE[prefix] for name in names if (prefix := name.partition(":")[0]) in _BESIDE}
    yield from map(further_picture, sorted(beside.difference(known)))
    if not has_video and video_bytes(packet) is not None:
        yield Found("film")


def has_gain_map(packet: bytes | None) -> bool:
    """Whether the packet describes a gain map."""
    return packet is not None and (b"GainMap" in packet or b"hdrgm:" in packet)


def _read(packet: bytes) -> Packet | None:
    try:
        return Packet(packet)
    except UnreadableError:
        return None


def _property(item: Element, name: str) -> Element | Attribute | None:
    """Returns a property of a list item, which is an attribute or an element in it or in its only element."""
    level = [item]
    for _ in range(3):
        for element in level:
            if name in element.attributes:
                return element.attributes[name]
            if element.name == name:
                return element
        level = [child for element in level for child in element.children]
    return None


def _text(packet: Packet, thing: Element | Attribute | None) -> str | None:
    return None if thing is None else packet.text(thing)


def _text_of(packet: Packet, element: Element, name: str) -> str | None:
    if element.name == name:
        return packet.data[element.content_at : element.content_end].decode(errors="replace")
    return element.attributes[name].value if name in element.attributes else None


def _integer(text: str | None) -> int | None:
    text = (text or "").strip()
    return int(text) if text.isascii() and text.isdigit() and len(text) < 19 else None
