"""XMP that states places in the picture: regions with faces and the like, crops, retouched areas, panoramas.

They are moved along with the pixels; those that cannot be are removed, and named.

Source: Metadata Working Group, guidelines 2.0 (regions; circles and points, too); Microsoft, people tagging; IPTC,
photo metadata standard (image regions); Google, photo sphere XMP; for ACDSee, Camera Raw and DJI, ExifTool's
description of these tags (facts only).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

from unshutter.photo.placement import Box, Placement
from unshutter.photo.xmp import Attribute, Element, Packet, UnreadableError

_Thing: TypeAlias = Element | Attribute
_Fields: TypeAlias = dict[str, _Thing]

_STATES_PLACES = re.compile(
    rb"mwg-rs:|schemas/regions/|MPRI:|photo/1\.2/|acdsee-rs:|acdsee\.com/regions|ImageRegion|Subject(?:Area|Location)"
    rb"|crs:|camera-raw-settings|GPano:|photos/1\.0/(?:panorama|focus)|GFocus:|OpticalCenter"
)
REGIONS = "regions"


class _Area(NamedTuple):
    """How a structure states one place."""

    names: tuple[str, str, str, str]  # of its fields: across, down, width, height
    centred: bool  # whether the first two are the centre of the rectangle rather than its upper left corner
    unit: str = ""  # field that says pixels, if it is not fractions
    diameter: str = ""  # field with the size of a circle instead of width and height, about its centre
    shape: str = ""  # field that says circle or polygon
    vertices: str = ""  # field with the corners of a polygon


class _Structure(NamedTuple):
    """A list of regions, and the size of the picture that they were made for."""

    size: str = ""  # its field with that size
    size_names: tuple[str, str] = ("", "")  # fields of that one: width and height


class _Flat(NamedTuple):
    """Simple properties that together state one place."""

    words: str  # names them if they are removed
    names: tuple[str, ...]  # sides of a box: left, top, right, bottom; or of a point: across, down
    in_pixels: bool = False
    has_size: bool = False  # the last two are width and height instead of right and bottom


_STRUCTURES = {
    "mwg-rs:Regions": _Structure("mwg-rs:AppliedToDimensions", ("stDim:w", "stDim:h")),
    "acdsee-rs:Regions": _Structure("acdsee-rs:AppliedToDimensions", ("acdsee-stDim:w", "acdsee-stDim:h")),
    "MP:RegionInfo": _Structure(),
    "Iptc4xmpExt:ImageRegion": _Structure(),
}
_ACDSEE = _Area(("acdsee-stArea:x", "acdsee-stArea:y", "acdsee-stArea:w", "acdsee-stArea:h"), centred=True)
_IPTC_POINT = ("Iptc4xmpExt:rbX", "Iptc4xmpExt:rbY")
_AREAS = {
    "mwg-rs:Area": _Area(("stArea:x", "stArea:y", "stArea:w", "stArea:h"), True, "stArea:unit", "stArea:d"),
    "acdsee-rs:DLYArea": _ACDSEE,
    "acdsee-rs:ALGArea": _ACDSEE,
    "Iptc4xmpExt:RegionBoundary": _Area(
        (*_IPTC_POINT, "Iptc4xmpExt:rbW", "Iptc4xmpExt:rbH"),
        False,
        "Iptc4xmpExt:rbUnit",
        "Iptc4xmpExt:rbRx",
        "Iptc4xmpExt:rbShape",
        "Iptc4xmpExt:rbVertices",
    ),
}
_RECTANGLE = "MPReg:Rectangle"  # a text: left, top, width, height
_LISTS = {"exif:SubjectArea": "subject area", "exif:SubjectLocation": "subject area"}  # in pixels
_FLAT = (
    _Flat("Camera Raw's crop", ("crs:CropLeft", "crs:CropTop", "crs:CropRight", "crs:CropBottom")),
    _Flat("focus point", ("GFocus:FocalPointX", "GFocus:FocalPointY")),
    _Flat(
        "panorama tags",
        tuple(f"GPano:LargestValidInteriorRect{name}" for name in ("Left", "Top", "Width", "Height")),
        in_pixels=True,
        has_size=True,
    ),
)
_RETOUCHING = re.compile(r"crs:(Retouch|RedEye|\w+BasedCorrections$|DepthMapInfo|LensBlur$)")
_APPLIED = "crs:AlreadyApplied"  # then Camera Raw's settings describe how these pixels were made
_ANGLE = "crs:CropAngle"
_PANORAMA = "GPano:CroppedArea"
_OPTICAL_CENTRE = ("drone-dji:CalibratedOpticalCenterX", "drone-dji:CalibratedOpticalCenterY")  # moved only by a crop
_STATED_SIZE = ("exif:PixelYDimension", "exif:PixelXDimension")
_PROJECTION = re.compile(rb"""GPano:ProjectionType\s*(?:=\s*["']|>)\s*(?:equirectangular|cylindrical)""")


def is_panorama(packet: bytes | None) -> bool:
    """Whether the packet describes a panorama, which was put together from several pictures."""
    return packet is not None and _PROJECTION.search(packet) is not None


def moved(packet: bytes, placement: Placement) -> tuple[bytes, list[str]]:
    """Moves the places that a packet states, and removes those that cannot be; returns the names of these, too."""
    if not _STATES_PLACES.search(packet):
        return packet, []
    try:
        mover = _Mover(Packet(packet), placement)
    except UnreadableError:
        return packet, []
    mover.move()
    return mover.packet.changed(), mover.removed


class _Mover:
    """Moves the places in one packet."""

    def __init__(self, packet: Packet, placement: Placement) -> None:
        self.packet = packet
        self.placement = placement
        self.removed: list[str] = []

    def move(self) -> None:
        """Moves or removes everything."""
        everything = list(self.packet.root.below())
        flat: _Fields = {}
        for element in everything:
            if element.name == "rdf:RDF":
                for description in element.children:
                    flat |= _own_fields(description)
        stated = self._numbers(flat, _STATED_SIZE)
        self.pixels = self.placement if stated is None else self.placement.framed(*stated)
        structures = [(element, _STRUCTURES[element.name]) for element in everything if element.name in _STRUCTURES]
        frames = [self._frame(_fields(element), kind) for element, kind in structures]
        shared = next(filter(None, frames), self.placement)  # programs state the same place in several ways
        for (element, kind), frame in zip(structures, frames, strict=True):
            self._move_structure(element, kind, frame if kind.size in _fields(element) else shared)
        for element in everything:
            if element.name in _LISTS:
                self._move_list(element, _LISTS[element.name])
        for row in _FLAT:
            self._move_flat(flat, row)
        self._remove_retouching(flat)
        self._move_optical_centre(flat)
        self._move_panorama(flat)

    def _remove(self, words: str, *things: _Thing) -> None:
        self.removed.append(words)
        for thing in things:
            self.packet.remove(thing)

    def _numbers(self, fields: _Fields, names: tuple[str, ...]) -> list[float] | None:
        """Returns the numbers in fields; None if one is missing or not a number."""
        try:
            return [float(self.packet.text(fields[name])) for name in names]
        except (KeyError, ValueError):
            return None

    def _put(self, thing: _Thing, value: float) -> None:
        """Replaces a number; an integer stays one, unless it is a fraction of the picture."""
        is_integer = self.packet.text(thing).strip().lstrip("+-").isdigit() and not 0 <= value <= 1
        self.packet.set_text(thing, str(round(value)) if is_integer else f"{value:.6f}".rstrip("0").rstrip("."))

    # ---- lists of regions ------------------------------------------------------------------------------

    def _frame(self, own: _Fields, kind: _Structure) -> Placement | None:
        """Returns the placement for the size that a structure states; None if there is none, or of another picture."""
        size = own.get(kind.size)
        stated = self._numbers(_fields(size), kind.size_names[::-1]) if isinstance(size, Element) else None
        return None if stated is None else self.placement.framed(*stated)

    def _move_structure(self, structure: Element, kind: _Structure, placement: Placement | None) -> None:
        size = _fields(structure).get(kind.size)
        if isinstance(size, Element) and placement is not None:
            for name, side in zip(kind.size_names, placement.new_size[::-1], strict=True):
                self._put(_fields(size)[name], side)
        items = list(_items(structure))
        gone = [item for item in items if placement is None or not self._move_item(item, placement)]
        if gone:
            self._remove(REGIONS, *([structure] if len(gone) == len(items) else gone))

    def _move_item(self, item: Element, placement: Placement) -> bool:
        """Moves the places of a region; returns whether that is possible."""
        for element in item.below():
            fields = _own_fields(element)
            if _RECTANGLE in fields and not self._move_rectangle(fields[_RECTANGLE], placement):
                return False
            area = _AREAS.get(element.name)
            if area is not None and not self._move_area(_fields(element), area, placement):
                return False
        return True

    def _move_rectangle(self, thing: _Thing, placement: Placement) -> bool:
        try:
            left, top, width, height = map(float, self.packet.text(thing).replace(",", " ").split())
        except ValueError:
            return False
        box = placement.box(Box(left, top, left + width, top + height))
        if box is not None:
            sides = (box.left, box.top, box.right - box.left, box.bottom - box.top)
            self.packet.set_text(thing, ", ".join(f"{side:.6f}" for side in sides))
        return box is not None

    def _move_area(self, fields: _Fields, area: _Area, placement: Placement) -> bool:
        unit = self.packet.text(fields[area.unit]) if area.unit in fields else ""
        in_pixels = unit.lower().startswith("pixel")
        before = placement.size if in_pixels else (1, 1)
        after = placement.new_size if in_pixels else (1, 1)
        vertices = fields.get(area.vertices)
        if isinstance(vertices, Element):
            return self._move_polygon(vertices, area, placement, before, after)
        place = self._numbers(fields, area.names[:2])
        extent = self._numbers(fields, area.names[2:])
        if place is None:
            return False
        x, y = place[0] / before[1], place[1] / before[0]
        if extent is None or area.diameter in fields:
            return self._move_circle(fields, area, placement, (x, y), in_pixels)
        width, height = extent[0] / before[1], extent[1] / before[0]
        left, top = (x - width / 2, y - height / 2) if area.centred else (x, y)
        box = placement.box(Box(left, top, left + width, top + height))
        if box is None:
            return False
        width, height = box.right - box.left, box.bottom - box.top
        x, y = (box.left + width / 2, box.top + height / 2) if area.centred else box[:2]
        for name, value, side in zip(area.names, (x, y, width, height), after[::-1] * 2, strict=True):
            self._put(fields[name], value * side)
        return True

    def _move_circle(
        self, fields: _Fields, area: _Area, placement: Placement, centre: tuple[float, float], in_pixels: bool
    ) -> bool:
        """Moves a circle, whose size in pixels remains, or a point."""
        moved = placement.point(*centre)
        if moved is None:
            return False
        height, width = placement.new_size if in_pixels else (1, 1)
        for name, value in zip(area.names[:2], (moved[0] * width, moved[1] * height), strict=True):
            self._put(fields[name], value)
        size = self._numbers(fields, (area.diameter,))
        if size is not None:
            shrunk = 1 if in_pixels else placement.size[1] / placement.new_size[1]
            self._put(fields[area.diameter], size[0] * placement.scale * shrunk)
        return True

    def _move_polygon(
        self,
        vertices: Element,
        area: _Area,
        placement: Placement,
        before: tuple[int, int],
        after: tuple[int, int],
    ) -> bool:
        corners = [_fields(item) for item in _items(vertices)]
        places = [self._numbers(corner, area.names[:2]) for corner in corners]
        known = [place for place in places if place is not None]
        moved = placement.points([x / before[1] for x, _ in known], [y / before[0] for _, y in known])
        if not known or len(known) < len(places) or moved is None:
            return False
        inside = [tuple(min(max(number, 0.0), 1.0) for number in point) for point in moved]
        if any(len({point[axis] for point in inside}) < 2 for axis in (0, 1)):  # all of it lies outside
            return False
        for corner, (x, y) in zip(corners, inside, strict=True):
            self._put(corner[area.names[0]], x * after[1])
            self._put(corner[area.names[1]], y * after[0])
        return True

    # ---- single places ---------------------------------------------------------------------------------

    def _move_list(self, element: Element, words: str) -> None:
        items = list(_items(element))
        numbers = self._numbers({str(k): item for k, item in enumerate(items)}, tuple(map(str, range(len(items)))))
        place = None if numbers is None or self.pixels is None else moved_subject(numbers, self.pixels)
        if place is None:
            self._remove(words, element)
        else:
            for item, number in zip(items, place, strict=True):
                self.packet.set_text(item, str(number))

    def _move_flat(self, flat: _Fields, row: _Flat) -> None:
        numbers = self._numbers(flat, row.names)
        if numbers is None or (row.names[0].startswith("crs:") and not self._has_own_crop(flat)):
            return
        placement = self.pixels if row.in_pixels else self.placement
        height, width = placement.size if placement is not None and row.in_pixels else (1, 1)
        numbers = [number / (height if k % 2 else width) for k, number in enumerate(numbers)]
        place: tuple[float, ...] | None = None
        if placement is not None and len(numbers) == 2:
            place = placement.point(numbers[0], numbers[1])
        elif placement is not None and not (row.names[0].startswith("crs:") and self._is_turned(flat)):
            left, top, right, bottom = numbers
            right, bottom = (left + right, top + bottom) if row.has_size else (right, bottom)
            box = placement.box(Box(left, top, right, bottom))
            size_or_end = box and ((box.right - box.left, box.bottom - box.top) if row.has_size else box[2:])
            place = box and size_or_end and (*box[:2], *size_or_end)
        if place is None or placement is None:
            self._remove(row.words, *(flat[name] for name in row.names))
            return
        height, width = placement.new_size if row.in_pixels else (1, 1)
        for k, (name, number) in enumerate(zip(row.names, place, strict=True)):
            self._put(flat[name], number * (height if k % 2 else width))

    def _says(self, flat: _Fields, name: str) -> bool:
        return name in flat and self.packet.text(flat[name]).strip().lower() == "true"

    def _has_own_crop(self, flat: _Fields) -> bool:
        """Whether Camera Raw would still cut the picture."""
        return self._says(flat, "crs:HasCrop") and not self._says(flat, _APPLIED)

    def _is_turned(self, flat: _Fields) -> bool:
        angle = self._numbers(flat, (_ANGLE,))
        return angle is not None and angle[0] != 0

    def _remove_retouching(self, flat: _Fields) -> None:
        if self._says(flat, _APPLIED):
            return
        things = [thing for name, thing in flat.items() if _RETOUCHING.match(name) and self.packet.text(thing).strip()]
        things = [thing for thing in things if isinstance(thing, Attribute) or any(_items(thing))]
        if things:
            self._remove("Camera Raw's retouching", *things)

    def _move_optical_centre(self, flat: _Fields) -> None:
        centre = self._numbers(flat, _OPTICAL_CENTRE)
        if centre is not None and self.placement.size != self.placement.new_size:
            if self.placement.position is None:
                self._remove("optical centre", *(flat[name] for name in _OPTICAL_CENTRE))
                return
            for name, number, begin in zip(_OPTICAL_CENTRE, centre, self.placement.corner[::-1], strict=True):
                self._put(flat[name], number - begin)

    def _move_panorama(self, flat: _Fields) -> None:
        """Updates the part of a panorama that a crop leaves."""
        placement = self.placement
        own = {name: thing for name, thing in flat.items() if name.startswith("GPano:")}
        if not own or placement.size == placement.new_size:
            return
        names = tuple(_PANORAMA + name for name in ("TopPixels", "LeftPixels", "ImageHeightPixels", "ImageWidthPixels"))
        area = self._numbers(own, names)
        if area is None or tuple(area[2:]) != placement.size or placement.orientation != 1 or not placement.position:
            self._remove("panorama tags", *own.values())
            return
        starts = (begin + cut for begin, cut in zip(area[:2], placement.corner, strict=True))
        for name, number in zip(names, (*starts, *placement.new_size), strict=True):
            self.packet.set_text(own[name], str(round(number)))


def moved_subject(numbers: list[float], placement: Placement) -> list[int] | None:
    """Moves EXIF's subject area: a point, a circle (centre, diameter) or a rectangle (centre, width, height) [px]."""
    if not 2 <= len(numbers) <= 4:
        return None
    height, width = placement.size
    x, y = numbers[0] / width, numbers[1] / height
    new_height, new_width = placement.new_size
    if len(numbers) < 4:
        point = placement.point(x, y)
        size = [number * placement.scale for number in numbers[2:]]
        values = None if point is None else [point[0] * new_width, point[1] * new_height, *size]
    else:
        half_width, half_height = numbers[2] / width / 2, numbers[3] / height / 2
        box = placement.box(Box(x - half_width, y - half_height, x + half_width, y + half_height))
        values = box and [
            (box.left + box.right) / 2 * new_width,
            (box.top + box.bottom) / 2 * new_height,
            (box.right - box.left) * new_width,
            (box.bottom - box.top) * new_height,
        ]
    return None if values is None else [round(value) for value in values]


def _own_fields(element: Element) -> _Fields:
    """Returns an element's attributes and child elements by name."""
    return {**element.attributes, **{child.name: child for child in element.children}}


def _fields(element: Element) -> _Fields:
    """Returns the fields of a structure, which may be wrapped in a description."""
    fields = _own_fields(element)
    for child in element.children:
        if child.name == "rdf:Description":
            fields |= _own_fields(child)
    return fields


def _items(element: Element) -> Iterator[Element]:
    """Yields the items of the lists in an element, but not those of lists inside items."""
    for child in element.children:
        if child.name == "rdf:li":
            yield child
        else:
            yield from _items(child)
