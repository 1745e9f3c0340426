"""EXIF: the camera's record of a photo, in TIFF directories.

Every format except TIFF stores EXIF as one blob; TIFF stores it among its own tags. Blobs are changed in place or at
their end, so that nothing else moves: maker notes often contain offsets relative to the start of the blob.

Source: CIPA DC-008 (EXIF 2.32), sections 4.5 and 4.6.
"""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import BinaryIO

from unshutter.orientation import Orientation
from unshutter.photo import directories as tiff
from unshutter.photo import maker_notes
from unshutter.photo.placement import Placement
from unshutter.photo.regions import moved_subject

# Tags in a TIFF's first directory that describe the photo rather than the storage of its pixels: program, document and
# page, position on the page, page number, description, make, model, software, date, artist, computer, white point and
# primaries, ratings, copyright, Windows titles, print matching, unique name and serial number of the camera, lens.
_CAMERA_TAGS = frozenset(
    {
        0x000B,
        0x010D,
        0x010E,
        0x010F,
        0x0110,
        0x011D,
        0x011E,
        0x011F,
        0x0129,
        0x0131,
        0x0132,
        0x013B,
        0x013C,
        0x013E,
        0x013F,
    }
    | {0x4746, 0x4749, 0x8298, *range(0x9C9B, 0x9CA0), 0xC4A5, 0xC614, 0xC62F, 0xC630}
    | {0xC68B, 0xC763, 0xC764, 0xC772, 0xC789, 0xC7A1}  # DNG: name of the raw file; timecodes, frame rate, reel
)
# Geographic position of the picture (OGC GeoTIFF 1.1), with GDAL's additions.
_GEOTIFF = frozenset({0x830E, 0x8480, 0x8482, 0x85D8, 0x87AF, 0x87B0, 0x87B1, 0xA480, 0xA481})
RESOLUTION = (0x011A, 0x011B)
_RESOLUTION_UNIT = 0x0128
_INCH = 2
_IMAGE_WIDTH = 0x0100
_IMAGE_HEIGHT = 0x0101
COMPRESSION = 0x0103
PHOTOMETRIC = 0x0106
_ORIENTATION = 0x0112
_PIXEL_WIDTH = 0xA002
_PIXEL_HEIGHT = 0xA003
LENS_MODEL = 0xA434
FOCAL_35MM = 0xA405
_SUBJECT_PLACES = (0x9214, 0xA214)  # SubjectArea, SubjectLocation [px]
SOFTWARE = 0x0131
_ENTRY_BYTES = 12


_UNITS = {_INCH: (25.4, "in"), 3: (10.0, "cm")}  # length [mm], and name in libvips, by EXIF's number


# ---- reading -------------------------------------------------------------------------------------------


def read(blob: bytes | None) -> tiff.Tree:
    """Reads the directories of an EXIF blob, with or without its prefix; empty for None, or if nothing can be read."""
    tree = tiff.read_tree(io.BytesIO((blob or b"").removeprefix(tiff.EXIF_PREFIX)))
    return tree or tiff.Tree("<", [{}])


def has_loop(blob: bytes) -> bool:
    """Whether the directories of a blob contain a loop; such a blob is not given to libraries."""
    data = blob.removeprefix(tiff.EXIF_PREFIX)
    order = tiff.BYTE_ORDERS.get(data[:4])
    if order is None or len(data) < 8:
        return False
    waiting = list(struct.unpack_from(order + "I", data, 4))
    visited = set()
    while waiting:
        at = waiting.pop()
        if at in visited or len(visited) > 1000:
            return True
        visited.add(at)
        (count,) = struct.unpack_from(order + "H", data, at) if at + 2 <= len(data) else (0,)
        end = at + 2 + _ENTRY_BYTES * count
        entries = data[at + 2 : end]
        entries = entries[: len(entries) // _ENTRY_BYTES * _ENTRY_BYTES]
        for tag, _, _, value in struct.iter_unpack(order + "HHII", entries):
            if tag in tiff.SUB_DIRECTORIES:
                waiting.append(value)
        if end + 4 <= len(data) and (following := struct.unpack_from(order + "I", data, end)[0]):
            waiting.append(following)
    return False


def orientation(blob: bytes | None) -> Orientation | None:
    """Returns the orientation in an EXIF blob; None if it is missing or meaningless."""
    number = read(blob).number(_ORIENTATION)
    return Orientation(number) if number in tuple(Orientation) else None


def of_software(name: str) -> bytes | None:
    """Creates EXIF with only the name of the program that wrote the picture."""
    text = name.encode("ascii") + b"\0"
    return of_tiff(tiff.Tree("<", [{SOFTWARE: tiff.Entry(2, len(text), text)}]))


def resolution(blob: bytes | None) -> tuple[float, float, str] | None:
    """Returns resolution across and down [px/mm], and its unit as named by libvips; None without resolution or unit."""
    tree = read(blob)
    if (unit := _UNITS.get(tree.number(_RESOLUTION_UNIT) or _INCH)) is None:
        return None
    mm, name = unit
    across, down = (next(iter(tree.numbers(tag)), 0.0) / mm for tag in RESOLUTION)
    return (across, down, name) if across > 0 and down > 0 else None


def with_header(blob: bytes | None) -> bytes | None:
    """Restores the TIFF header of a blob whose first four bytes are missing; returns None if it is not EXIF.

    Some files contain EXIF without the number that should precede it, but decoders skip four bytes nevertheless.
    """
    if blob is None or blob.removeprefix(tiff.EXIF_PREFIX)[:4] in tiff.BYTE_ORDERS:
        return blob
    for mark, order in tiff.BYTE_ORDERS.items():
        whole = mark + blob
        if blob[:4] == struct.pack(order + "I", 8) and read(whole):
            return tiff.EXIF_PREFIX + whole
    return None


def focal_px(blob: bytes | None, height: int, width: int) -> float | None:
    """Returns the focal length [px] from the 35 mm equivalent, which EXIF defines by the diagonal; None if unknown."""
    focal_mm = read(blob).number(FOCAL_35MM, tiff.EXIF)
    return focal_mm * math.hypot(height, width) / math.hypot(36, 24) if focal_mm else None


# ---- conversion between blobs and TIFF files -----------------------------------------------------------


def of_tiff(tree: tiff.Tree) -> bytes | None:
    """Returns the EXIF blob of a TIFF's first page: camera tags, EXIF, GPS; None if it has none of them.

    The byte order is kept, because maker notes often use that of their file.
    """
    camera_tags = _of_the_camera(tree)
    return _blob_of(camera_tags, tree) if camera_tags else None


def _blob_of(directory: tiff.Directory, tree: tiff.Tree) -> bytes:
    """Encodes a directory from a tree as a blob."""
    head = struct.pack(tree.order + "2sHI", b"II" if tree.order == "<" else b"MM", 42, 8)
    return tiff.EXIF_PREFIX + head + maker_notes.in_place(tiff.encoded(directory, 8, tree.order), 8, directory, tree)


def add_to_tiff(
    file: BinaryIO, blob: bytes | None, height: int, width: int, more: Mapping[int, tiff.Entry] = MappingProxyType({})
) -> bool:
    """Appends camera tags, EXIF and GPS of a blob to a finished TIFF of one page; returns whether there was room.

    The page's own tags take precedence, except for a resolution without a unit. The pixel size repeated in EXIF is set
    to that of the picture [px]. A file too long for more changes nothing. ``more`` are further tags, in the byte order
    of the page, which they replace.
    """
    tree = read(blob)
    target = tiff.read_tree(file)
    end = file.seek(0, io.SEEK_END)
    length = len(blob or b"") + sum(len(entry.data) for entry in more.values())
    # with room for directories, in addition to the values
    if target is None or (target.layout is tiff.CLASSIC and end + length + 65_536 >= 1 << 32):
        return False
    added = _of_the_camera(tree)
    maker_notes.complete(added, tree, (blob or b"").removeprefix(tiff.EXIF_PREFIX))
    added = added if tree.order == target.order else tiff.in_other_order(added)
    details = added.get(tiff.EXIF)
    if isinstance(details, dict):
        for tag, size in ((_PIXEL_WIDTH, width), (_PIXEL_HEIGHT, height)):
            if tag in details:
                details[tag] = tiff.Entry(4, 1, struct.pack(target.order + "I", size))
    winning = {tag: added[tag] for tag in (*RESOLUTION, _RESOLUTION_UNIT) if tag in added}
    start = end + end % 2  # directories begin at even offsets
    file.seek(end)
    whole = added | target.pages[0] | dict(more) | winning
    layout = target.layout
    written = tiff.encoded(whole, start, target.order, layout)
    file.write(bytes(end % 2) + maker_notes.in_place(written, start, added, tree))
    file.seek(layout.header)
    file.write(struct.pack(target.order + layout.offset, start))
    return True


def _of_the_camera(tree: tiff.Tree) -> tiff.Directory:
    first = tree.pages[0]
    camera_tags = {tag: value for tag, value in first.items() if is_carried(tag)}
    if has_no_resolution_unit(tree):
        camera_tags |= {tag: first[tag] for tag in (*RESOLUTION, _RESOLUTION_UNIT) if tag in first}
    return camera_tags if tree.layout is tiff.CLASSIC else tiff.in_classic(camera_tags, tree.order)


def is_carried(tag: int) -> bool:
    """Whether a tag of a TIFF's first directory is copied to results with EXIF."""
    return tag in _CAMERA_TAGS or tag in _GEOTIFF or tag in tiff.SUB_DIRECTORIES


def has_no_resolution_unit(tree: tiff.Tree) -> bool:
    """Whether the resolution is only a ratio of width to height."""
    return tree.number(_RESOLUTION_UNIT) == 1


def without_geotiff(blob: bytes | None) -> bytes | None:
    """Rewrites the blob without the picture's geographic position; returns the blob itself if it has none."""
    tree = read(blob)
    if not tree.pages[0].keys() & _GEOTIFF:
        return blob
    for tag in _GEOTIFF & tree.pages[0].keys():
        del tree.pages[0][tag]
    return of_tiff(tree)


def shortened(blob: bytes, most: int) -> tuple[bytes | None, list[str]]:
    """Returns the blob, without its longest tags if it exceeds this number of bytes; None if nothing can be saved.

    The maker note, which may contain previews, is removed first. Also returns the names of what is left out.
    """
    if len(blob) <= most:
        return blob, []
    tree = read(blob)
    camera_tags = _of_the_camera(tree)
    if not camera_tags:
        return None, ["EXIF"]
    details = camera_tags.get(tiff.EXIF)
    note = details.pop(tiff.MAKER_NOTE, None) if isinstance(details, dict) else None
    left_out = ["maker's note"] if note is not None else []
    if len(_blob_of(camera_tags, tree)) > most:
        left_out.append("long tags of EXIF")
    while len(shorter := _blob_of(camera_tags, tree)) > most:
        excess = len(shorter) - most
        by_size = sorted(_entries(camera_tags), key=lambda item: -len(item[2].data))
        for directory, tag, entry in by_size:
            del directory[tag]
            excess -= len(entry.data) + _ENTRY_BYTES
            if excess <= 0:
                break
    return shorter, left_out


def _entries(directory: tiff.Directory) -> Iterator[tuple[tiff.Directory, int, tiff.Entry]]:
    """Yields all entries with the directories that contain them."""
    for tag, value in directory.items():
        if isinstance(value, dict):
            yield from _entries(value)
        else:
            yield directory, tag, value


# ---- updates for new pixels ----------------------------------------------------------------------------


def with_size(blob: bytes, height: int, width: int) -> bytes:
    """Returns the blob with its existing size tags updated [px]."""
    editor = _Editor(blob)
    for entries, tags in (
        (editor.first, (_IMAGE_WIDTH, _IMAGE_HEIGHT)),
        (editor.directory(editor.at_pointer(editor.first, tiff.EXIF)), (_PIXEL_WIDTH, _PIXEL_HEIGHT)),
    ):
        for tag, size in zip(tags, (width, height), strict=True):
            if tag in entries:
                editor.put(entries[tag], size)
    return bytes(editor.data)


def with_subject_moved(blob: bytes, placement: Placement) -> tuple[bytes, list[str]]:
    """Moves the subject's place in the picture; removes and names it if that is impossible."""
    editor = _Editor(blob)
    details_at = editor.at_pointer(editor.first, tiff.EXIF)
    details = editor.directory(details_at)
    stated = [editor.numbers(details[tag]) for tag in (_PIXEL_HEIGHT, _PIXEL_WIDTH) if tag in details]
    known = placement.framed(*(side[0] for side in stated)) if len(stated) == 2 and all(stated) else placement
    removed = []
    for at, entries in ((editor.first_at, editor.first), (details_at, details)):
        for slot in sorted((entries[tag] for tag in _SUBJECT_PLACES if tag in entries), reverse=True):
            new = known and moved_subject([float(number) for number in editor.numbers(slot)], known)
            if new is None or max(new) > 0xFFFF:
                editor.remove(at, slot)
                removed.append("subject area")
            else:
                editor.put_numbers(slot, new)
    return bytes(editor.data), removed


def with_orientation(blob: bytes | None, orientation: int) -> bytes | None:
    """Returns the blob with an orientation; created if missing, unless 1 (the default)."""
    if blob is None:
        if orientation == 1:
            return None
        blob = tiff.EXIF_PREFIX + b"II*\0" + struct.pack("<IHI", 8, 0, 0)
    editor = _Editor(blob)
    if _ORIENTATION in editor.first:
        editor.put(editor.first[_ORIENTATION], orientation)
    elif orientation != 1:
        editor.add_to_first(_ORIENTATION, orientation)
    return bytes(editor.data)


def has_thumbnail(blob: bytes | None) -> bool:
    """Whether the blob has a second directory, which is the thumbnail's."""
    return blob is not None and _Editor(blob).second_at != 0


def with_thumbnail(blob: bytes, jpeg: bytes | None, orientation: int = 1) -> bytes:
    """Erases the blob's thumbnail and adds another one, except for None or if there is no room."""
    editor = _Editor(blob)
    if editor.second_at:
        editor.wipe_thumbnail()
    # a JPEG's EXIF is limited to 65,527 bytes
    if jpeg is not None and editor.link_at and len(editor.data) + len(jpeg) + 100 <= 65_000:
        start = editor.end()
        order = editor.order
        tags = ((COMPRESSION, 3, 6), (_ORIENTATION, 3, orientation))  # 6: JPEG
        tags += ((tiff.THUMBNAIL, 4, start + 2 + 12 * 4 + 4), (tiff.THUMBNAIL_LENGTH, 4, len(jpeg)))
        directory = struct.pack(order + "H", len(tags)) + b"".join(tiff.encoded_number(order, *tag) for tag in tags)
        editor.data += directory + bytes(4) + jpeg
        struct.pack_into(order + "I", editor.data, editor.link_at, start)
    return bytes(editor.data)


class _Editor:
    """An EXIF blob with the positions of its entries; a damaged blob appears to have none."""

    def __init__(self, blob: bytes) -> None:
        self.data = bytearray(blob)
        self.start = len(tiff.EXIF_PREFIX) if blob.startswith(tiff.EXIF_PREFIX) else 0
        self.order = tiff.BYTE_ORDERS.get(blob[self.start : self.start + 4], "")
        self.first: dict[int, tiff.Slot] = {}
        self.first_at = self.link_at = self.second_at = 0
        if self.order and len(blob) >= self.start + 8:
            self.first_at = first_at = self._place(self.start + 4)
            listed = self.slots_at(first_at)
            self.first = self._by_tag(listed)
            link_at = first_at + 2 + 12 * len(listed)
            if first_at > self.start and link_at + 4 <= len(blob):
                self.link_at = link_at
                self.second_at = self._place(link_at)

    def _place(self, at: int) -> int:
        """Converts the offset stored at a position to a position; 0 if invalid."""
        (offset,) = struct.unpack_from(self.order + "I", self.data, at)
        return self.start + offset if 0 < offset < len(self.data) - self.start else 0

    def slots_at(self, at: int) -> list[tiff.Slot]:
        """Returns the entries of the directory at a position; tags may be duplicated."""
        if not 0 < at <= len(self.data) - 2:
            return []
        (count,) = struct.unpack_from(self.order + "H", self.data, at)
        if at + 2 + 12 * count > len(self.data):
            return []
        return list(tiff.slots(self.data, self.order, at + 2, count))

    @staticmethod
    def _by_tag(listed: list[tiff.Slot]) -> dict[int, tiff.Slot]:
        return {slot.tag: slot for slot in reversed(listed)}

    def at_pointer(self, entries: dict[int, tiff.Slot], tag: int) -> int:
        """Returns the position of a sub-directory; 0 without one."""
        return self._place(entries[tag].value_at) if tag in entries else 0

    def directory(self, at: int) -> dict[int, tiff.Slot]:
        """Returns the entries of the directory at a position by tag."""
        return self._by_tag(self.slots_at(at))

    def _values(self, slot: tiff.Slot) -> tuple[str, int]:
        """Returns the form of an entry's SHORT or LONG values and their position; nothing for others."""
        form = f"{self.order}{slot.count}{'H' if slot.kind == 3 else 'I'}"
        if slot.kind not in (3, 4) or not 0 < slot.count <= 4:
            return "", 0
        at = slot.value_at if struct.calcsize(form) <= 4 else self._place(slot.value_at)
        return (form, at) if 0 < at <= len(self.data) - struct.calcsize(form) else ("", 0)

    def numbers(self, slot: tiff.Slot) -> tuple[int, ...]:
        """Returns the up to four numbers of an entry; empty for others."""
        form, at = self._values(slot)
        return struct.unpack_from(form, self.data, at) if form else ()

    def put_numbers(self, slot: tiff.Slot, numbers: list[int]) -> None:
        """Replaces the numbers of an entry, as many as there are."""
        form, at = self._values(slot)
        struct.pack_into(form, self.data, at, *numbers)

    def remove(self, directory_at: int, slot: tiff.Slot) -> None:
        """Removes an entry from the directory at a position; nothing else moves."""
        (count,) = struct.unpack_from(self.order + "H", self.data, directory_at)
        end = directory_at + 2 + _ENTRY_BYTES * count + 4
        self.data[slot.at : end] = self.data[slot.at + _ENTRY_BYTES : end] + bytes(_ENTRY_BYTES)
        struct.pack_into(self.order + "H", self.data, directory_at, count - 1)

    def put(self, slot: tiff.Slot, value: int) -> None:
        number = tiff.encoded_number(self.order, slot.tag, 3 if value < 1 << 16 else 4, value)
        self.data[slot.at : slot.at + len(number)] = number

    def end(self) -> int:
        """Pads to an even offset, and returns it."""
        self.data += bytes((len(self.data) - self.start) % 2)
        return len(self.data) - self.start

    def add_to_first(self, tag: int, value: int) -> None:
        """Rewrites the first directory at the end of the blob, with one more entry."""
        if not self.link_at:
            return
        count = (self.link_at - first_at - 2) // 12 if (first_at := self._place(self.start + 4)) else 0
        old = [
            bytes(self.data[slot.at : slot.at + 12]) for slot in tiff.slots(self.data, self.order, first_at + 2, count)
        ]
        link = bytes(self.data[self.link_at : self.link_at + 4])
        added = tiff.encoded_number(self.order, tag, 3, value)
        new = sorted([*old, added], key=lambda entry: struct.unpack(self.order + "H", entry[:2]))
        struct.pack_into(self.order + "I", self.data, self.start + 4, self.end())
        self.data += struct.pack(self.order + "H", len(new)) + b"".join(new) + link

    def wipe_thumbnail(self) -> None:
        """Overwrites the thumbnail and the link to its directory with zeros."""
        listed = self.slots_at(self.second_at)
        places = [self._place(slot.value_at) for slot in listed if slot.tag == tiff.THUMBNAIL]
        lengths = [slot.value_at for slot in listed if slot.tag == tiff.THUMBNAIL_LENGTH]
        for at, length_at in zip(places, lengths, strict=False):
            (length,) = struct.unpack_from(self.order + "I", self.data, length_at)
            length = min(length, len(self.data) - at)
            if at > self.start + 8:
                self.data[at : at + length] = bytes(length)
        self.data[self.link_at : self.link_at + 4] = bytes(4)
        self.second_at = 0
