"""Makers' notes that move with their TIFF: what they point to is found again."""

import io
import struct

import pytest

from support.drawn_photos import drawn, encoded
from support.maker_notes import directory
from unshutter.photo import Photo, exif, maker_notes
from unshutter.photo.directories import EXIF, EXIF_PREFIX, MAKER_NOTE, Entry, Tree, read_tree

NIKON = b"Nikon\0\2\x10\0\0"
PLACE = 8 + 2 + 2 * 12 + 4 + len("Acme Optics\0") + 2 + 12 + 4  # of a note in the EXIF below
VALUES = {7: b"lens 24-70 mm\0", 9: b"serial number 0123456789\0", 12: struct.pack("<9H", *range(9))}


def note_at(place: int, order: str, name: bytes = b"", footer: bool = False) -> bytes:
    """A note that stands at a place: a name, and a directory whose offsets are counted from where the place is."""
    table = struct.pack(order + "H", len(VALUES) + 1) + struct.pack(order + "HHII", 1, 4, 1, 0xABCDEF)
    values, at = b"", place + len(name) + 2 + 12 * (len(VALUES) + 1) + 4
    for tag, value in VALUES.items():
        table += struct.pack(order + "HHII", tag, 7, len(value), at + len(values))
        values += value
    end = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", place) if footer else b""
    return name + table + bytes(4) + values + end


def jpeg_with_note(order: str, name: bytes, footer: bool) -> bytes:
    """A JPEG whose EXIF has a note of that kind."""
    return jpeg_with_note_bytes(note_at(PLACE, order, name, footer), order)


def jpeg_with_note_bytes(note: bytes, order: str = "<") -> bytes:
    tags = {0x010F: Entry(2, 12, b"Acme Optics\0"), EXIF: {MAKER_NOTE: Entry(7, len(note), note)}}
    blob = exif.of_tiff(Tree(order, [tags]))
    assert blob is not None and blob.index(note) == len(EXIF_PREFIX) + PLACE
    return encoded(drawn(), "JPEG", exif=blob)


def values_in(data: bytes, name: bytes, order: str) -> tuple[int, dict[int, bytes]]:
    """Where the note of a TIFF structure stands, and what it points to."""
    tree = read_tree(io.BytesIO(data))
    assert tree is not None and tree.note_at is not None
    at = tree.note_at + len(name)
    (count,) = struct.unpack_from(order + "H", data, at)
    rows = (struct.unpack_from(order + "HHII", data, at + 2 + 12 * i) for i in range(count))
    return tree.note_at, {tag: data[offset : offset + size] for tag, _, size, offset in rows if size > 4}


def test_an_entry_without_values_does_not_hide_the_others() -> None:
    """Exiv2 leaves such entries when it removes a preview; Canon's owner may be one."""
    values = [(1, 7, bytes(range(60))), (0x2001, 7, b""), (0x2002, 7, bytes(range(60, 160)))]
    note = b"SONY DSC \0\0\0" + directory("<", PLACE + 12, *values)
    photo = Photo.from_bytes(jpeg_with_note_bytes(note))
    _, found = values_in(photo.encode("tiff").data, b"SONY DSC \0\0\0", "<")
    assert found == {1: bytes(range(60)), 0x2002: bytes(range(60, 160))}


def test_a_note_with_its_own_header_is_never_adjusted() -> None:
    note = b"OLYMPUS\0II\3\0" + directory("<", 12, (1, 7, bytes(range(60)))) + bytes(300)
    for was_at in (0, 20, 200):  # its offset might also be one from the start of EXIF
        assert maker_notes.move_note(note, "<", was_at, 5000) == note


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("name", [b"", b"Acme\0\0\1\0", b"SONY DSC \0\0\0"])
@pytest.mark.parametrize("footer", [False, True])
def test_what_a_note_points_to_moves_along(order: str, name: bytes, footer: bool) -> None:
    tiff = Photo.from_bytes(jpeg_with_note(order, name, footer)).encode("tiff")
    assert tiff.left_out == ()
    at, values = values_in(tiff.data, name, order)
    assert values == VALUES
    assert note_at(at, order, name, footer) in tiff.data  # the footer, too, tells where it stands now
    jpeg = Photo.from_bytes(tiff.data).to_bytes("jpeg")
    at, values = values_in(jpeg[jpeg.index(EXIF_PREFIX) + 6 :], name, order)
    assert values == VALUES


@pytest.mark.parametrize(
    "note",
    [
        b"",
        b"Acme\0" + bytes(range(200)),
        note_at(0, "<"),  # counted from its own beginning
        note_at(0, "<", b"Acme\0\0\1\0"),
        note_at(5000, "<"),  # counted from somewhere else
        note_at(700, "<")[:40],
    ],
)
def test_other_notes_stay_as_they_are(note: bytes) -> None:
    assert maker_notes.move_note(note, "<", 700, 90_000) == note
    assert maker_notes.move_note(note, ">", 700, 90_000) == note


def test_what_lies_outside_the_note_is_left_there() -> None:
    note = note_at(700, "<")
    at = 2 + 12 + 8
    struct.pack_into("<I", changed := bytearray(note), at, 12)  # the first of three
    after = maker_notes.move_note(bytes(changed), "<", 700, 90_000)
    struct.pack_into("<I", expected := bytearray(note_at(90_000, "<")), at, 12)
    assert after == bytes(expected)


def test_a_note_near_the_beginning_of_exif_is_not_mistaken_for_one_that_counts_from_itself() -> None:
    """Where all offsets make sense in both ways of counting, values begin where the directory ends."""
    place = 300
    note = note_at(place, "<")
    note += bytes(1000)  # so that the offsets lie in the note, counted from its own beginning, too
    assert maker_notes.move_note(note, "<", place, 9000) == note_at(9000, "<") + bytes(1000)
    own = note_at(0, "<") + bytes(1000)
    assert maker_notes.move_note(own, "<", 8, 9000) == own


def test_a_note_that_another_program_has_moved_is_found_by_its_footer() -> None:
    """As with a Canon EOS REBEL T3i: its offsets hold for the position in the footer, not for that of the note."""
    for was_at in (700, 900):
        assert maker_notes.move_note(note_at(900, "<", footer=True), "<", was_at, 5000) == note_at(
            5000, "<", footer=True
        )


def test_an_entry_that_a_camera_left_empty_does_no_harm() -> None:
    table = struct.pack("<HHHIIHHII", 2, 7, 7, 9, 700 + 2 + 24 + 4, 0, 0, 0, 0) + bytes(4)
    after = maker_notes.move_note(table + b"some text", "<", 700, 9000)
    assert struct.unpack_from("<I", after, 10) == (9000 + 2 + 24 + 4,)


def test_values_elsewhere_in_exif_are_brought_into_a_note_that_moves() -> None:
    """As with an Olympus C720UZ, whose note ends behind the directory."""
    whole = note_at(48, "<")  # behind the header, the first directory, EXIF's
    cut = len(whole) - sum(map(len, VALUES.values()))
    directory = {EXIF: {MAKER_NOTE: Entry(7, cut, whole[:cut])}}
    blob = exif.of_tiff(Tree("<", [directory]))
    assert blob is not None and blob.index(whole[:cut]) == len(EXIF_PREFIX) + 8 + 18 + 18
    moved = note_at(44, "<")
    blob = blob.replace(whole[:cut], moved[:cut]) + moved[cut:]
    tiff = Photo.from_bytes(encoded(drawn(), "JPEG", exif=blob)).encode("tiff")
    assert values_in(tiff.data, b"", "<")[1] == VALUES and tiff.left_out == ()


def test_parts_of_a_note_that_a_tiff_has_elsewhere_are_named() -> None:
    def left_out(note: bytes) -> tuple[str, ...]:
        """Of a TIFF whose note is that, and is written again."""
        details = {MAKER_NOTE: Entry(7, len(note), note)}
        stream = io.BytesIO(encoded(drawn(), "TIFF"))
        assert exif.add_to_tiff(stream, exif.of_tiff(Tree("<", [{EXIF: details}])), 48, 80)
        return Photo.from_bytes(stream.getvalue()).encode().left_out

    def preview_at(place: int) -> bytes:
        """A note of Nikon's with a preview of 99 bytes."""
        first = struct.pack("<HHHIII", 1, 0x0011, 4, 1, 26, 0)
        second = struct.pack("<HHHIIHHIII", 2, 0x0201, 4, 1, place, 0x0202, 4, 1, 99, 0)
        return NIKON + b"II*\0" + struct.pack("<I", 8) + first + second + bytes(99)

    assert left_out(preview_at(26 + len(struct.pack("<HHHIIHHIII", *range(10))))) == ()
    assert left_out(preview_at(5000)) == ("parts of the maker's note",)


def tiff_from_jpeg_with(note: Entry) -> Tree:
    """EXIF of a TIFF that is made of a JPEG with a maker's name and such a note."""
    directory = {0x010F: Entry(2, 12, b"Acme Optics\0"), EXIF: {MAKER_NOTE: note}}
    blob = exif.of_tiff(Tree("<", [directory]))
    assert blob is not None
    cut = blob[: len(EXIF_PREFIX) + 8 + 2 + 2 * 12 + 4 + len("Acme Optics\0") + 2 + 12 + 4 + min(len(note.data), 100)]
    tree = read_tree(io.BytesIO(Photo.from_bytes(encoded(drawn(), "JPEG", exif=cut)).to_bytes("tiff")))
    assert tree is not None and tree.text(0x010F) == "Acme Optics"
    return tree


def test_a_note_that_is_cut_off_is_left_out_of_a_tiff_that_is_whole_otherwise() -> None:
    assert tiff_from_jpeg_with(Entry(7, 200, bytes(200))).entry(MAKER_NOTE, EXIF) is None


def test_a_note_that_is_a_text_remains_one() -> None:
    note = Entry(2, 20, b"made on a sunny day\0")
    assert tiff_from_jpeg_with(note).entry(MAKER_NOTE, EXIF) == note
