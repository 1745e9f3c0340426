"""An XMP packet as a tree with positions: changes are made in its bytes, and the rest is left unchanged.

The parser is Python's expat, restricted against dangerous XML: a packet with a document type, which alone can define
entities, is rejected, as is one with too many elements. The time taken is proportional to the packet's size.

Source: W3C, XML 1.0 and Namespaces in XML; ISO 16684-1 (XMP).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

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
}
_PREFIX_OF = {uri: prefix for prefix, uri in reversed(NAMESPACES.items())}
_MOST_ELEMENTS = 100_000
_TAG_NAME = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"""\s*([^\s=/>]+)\s*=\s*("[^"]*"|'[^']*')""")
_TAG_END = re.compile(rb"\s*(/?)>")


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
    """An element.

    Attributes:
        name: name with the usual prefix of its namespace, regardless of the packet's: ``tiff:Orientation``.
        at, end: start and end of the whole element.
        content_at, content_end: start and end of the content between its tags.
        attributes: attributes by name, in the same form.
        children: direct child elements.
    """

    name: str
    at: int
    content_at: int
    attributes: dict[str, Attribute]
    end: int = 0
    content_end: int = 0
    children: list[Element] = field(default_factory=list)

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
        """Parses the packet.

        Raises:
            UnreadableError: it is not well-formed, or has a document type or too many elements.
        """
        self.data = data
        self.root = _Reader(data).root
        self._changes: list[tuple[int, int, bytes]] = []

    def remove(self, thing: Element | Attribute) -> None:
        """Removes an element with its content, or an attribute."""
        self._changes.append((thing.at, thing.end, b""))

    def set_number(self, thing: Element | Attribute, value: int) -> None:
        """Sets the text of an element or the value of an attribute, if it is an integer now."""
        is_element = isinstance(thing, Element)
        at, end = (thing.content_at, thing.content_end) if is_element else (thing.value_at, thing.value_end)
        old = self.data[at:end]
        if old.strip().isdigit():
            at += len(old) - len(old.lstrip())
            self._changes.append((at, at + len(old.strip()), b"%d" % value))

    def changed(self) -> bytes:
        """Returns the packet with all changes."""
        pieces, done = [], 0
        for at, end, new in sorted(self._changes, key=lambda change: (change[0], -change[1])):
            if at >= done:  # otherwise inside a removed part
                pieces += [self.data[done:at], new]
                done = end
        return b"".join([*pieces, self.data[done:]])


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
        if self._elements > _MOST_ELEMENTS:
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
