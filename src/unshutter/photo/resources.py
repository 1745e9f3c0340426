"""Photoshop's image resources that are places in the picture: paths, guides, slices and counted points.

Source: Adobe, Photoshop File Formats (image resources, path records); ExifTool's list of them (facts only).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

from unshutter.photo.chunks import RESOURCES_PREFIX, resource_blocks
from unshutter.photo.placement import Placement

_GUIDES = 1032
_SLICES = 1050
_COUNTS = 1080
_PATHS = frozenset({1025, *range(2000, 2998)})
_PATH_RECORD = 26  # bytes
_KNOTS = (1, 2, 4, 5)  # kinds of records of a path with three points (down, across) in 1 / 2**24 of the sides
_UNIT = 1 << 24
_MOST = 127.0  # largest number that a path can hold
_SLICE_COUNT = re.compile(rb"slicesVlLs(....)", re.DOTALL)
_SLICE_SIDES = (b"Btomlong", b"Rghtlong")

# the content of a resource -> that for the new picture; None if it cannot be moved
_Move = Callable[[bytes, Placement], bytes | None]


def moved(resources: bytes, placement: Placement) -> tuple[bytes, list[str]]:
    """Moves the places that resources state, and removes those that cannot be; returns the names of these, too."""
    prefix = RESOURCES_PREFIX if resources.startswith(RESOURCES_PREFIX) else b""
    blocks = resources.removeprefix(prefix)
    kept = []
    removed = []
    end = 0
    for kind, content, block in resource_blocks(blocks):
        end += len(block)
        words, move = _PLACES.get(kind, ("", None))
        new = content if move is None else move(content, placement)
        if new is None:
            removed.append(words)
        else:
            kept.append(block if new == content else _with_content(block, content, new))
    return prefix + b"".join(kept) + blocks[end:], removed


def _with_content(block: bytes, content: bytes, new: bytes) -> bytes:
    """Replaces the content of a block by one of the same length."""
    at = len(block) - len(content) - len(content) % 2
    return block[:at] + new + block[at + len(content) :]


def _moved_path(content: bytes, placement: Placement) -> bytes | None:
    changed = bytearray(content)
    for at in range(0, len(content) - _PATH_RECORD + 1, _PATH_RECORD):
        (kind,) = struct.unpack_from(">H", content, at)
        if kind in _KNOTS:
            numbers = [number / _UNIT for number in struct.unpack_from(">6i", content, at + 2)]
            points = placement.points(numbers[1::2], numbers[::2])
            if points is None or max(abs(number) for point in points for number in point) > _MOST:
                return None
            values = (round(number * _UNIT) for x, y in points for number in (y, x))
            struct.pack_into(">6i", changed, at + 2, *values)
    return bytes(changed)


def _without_guides(content: bytes, _: Placement) -> bytes | None:
    """Keeps a grid without guides: straight lines would be bent."""
    has_guides = len(content) >= 16 and struct.unpack_from(">I", content, 12)[0] > 0
    return None if has_guides else content


def _single_slice(content: bytes, placement: Placement) -> bytes | None:
    """Keeps the slice that every picture has, with the new size."""
    if content[:4] == bytes((0, 0, 0, 6)) and len(content) >= 28:
        name = struct.unpack_from(">I", content, 20)[0]
        found = content[24 + 2 * name : 28 + 2 * name]
    else:
        match = _SLICE_COUNT.search(content)
        found = match[1] if match else b""
    if int.from_bytes(found, "big") > 1:
        return None
    (height, width), (new_height, new_width) = placement.size, placement.new_size
    for old, new in (
        ((0, 0, height, width), (0, 0, new_height, new_width)),
        ((0, 0, width, height), (0, 0, new_width, new_height)),
    ):
        content = content.replace(struct.pack(">4i", *old), struct.pack(">4i", *new))
    for name, old, new in zip(_SLICE_SIDES, placement.size, placement.new_size, strict=True):
        content = content.replace(name + struct.pack(">i", old), name + struct.pack(">i", new))
    return content


def _dropped(_: bytes, __: Placement) -> None:
    return None


_PLACES: dict[int, tuple[str, _Move]] = {
    **dict.fromkeys(_PATHS, ("paths", _moved_path)),
    _GUIDES: ("guides", _without_guides),
    _SLICES: ("slices", _single_slice),
    _COUNTS: ("counted points", _dropped),
}
