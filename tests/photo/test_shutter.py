"""The shutter that a camera states decides how long its readout may take."""

import struct

import pytest

from unshutter.photo import exif, readout_times
from unshutter.photo.directories import EXIF, MAKER_NOTE, Entry, Tree
from unshutter.readout_time import ReadoutSource

MAKE, MODEL = 0x010F, 0x0110
MECHANICAL, ELECTRONIC = ReadoutSource.FOCAL_PLANE, ReadoutSource.ELECTRONIC


def entry(order: str, tag: int, kind: int, *numbers: int, at: int = 0) -> bytes:
    """An entry of a directory; values that do not fit stand at a position."""
    values = struct.pack(f"{order}{len(numbers)}{ {1: 'B', 3: 'H', 4: 'I', 13: 'I'}[kind] }", *numbers)
    place = values.ljust(4, b"\0") if len(values) <= 4 else struct.pack(f"{order}I", at)
    return struct.pack(f"{order}HHI", tag, kind, len(numbers)) + place


def note(start: bytes, order: str, *entries: bytes) -> bytes:
    return start + struct.pack(f"{order}H", len(entries)) + b"".join(entries) + bytes(4)


def photo(make: str, model: str, own: bytes) -> bytes:
    """EXIF of a camera with a maker's note."""
    texts = {MAKE: make, MODEL: model}
    page: dict = {tag: Entry(2, len(text) + 1, text.encode() + b"\0") for tag, text in texts.items()}
    blob = exif.of_tiff(Tree("<", [{**page, EXIF: {MAKER_NOTE: Entry(7, len(own), own)}}]))
    assert blob is not None
    return blob


def olympus(start: bytes, *drive: int) -> bytes:
    below = len(start) + 2 + 12 + 4
    values = below + 2 + 12 + 4
    inner = struct.pack("<H", 1) + entry("<", 0x0600, 3, *drive, at=values) + bytes(4)
    return note(start, "<", entry("<", 0x2020, 13, below)) + inner + struct.pack(f"<{len(drive)}H", *drive)


FUJI = b"FUJIFILM" + struct.pack("<I", 12)
NIKON = b"Nikon\0\x02\x11\0\0" + b"MM\0*" + struct.pack(">I", 8)


@pytest.mark.parametrize(
    ("make", "model", "own", "source"),
    [
        ("FUJIFILM", "X-T3", note(FUJI, "<", entry("<", 0x1050, 3, 0)), MECHANICAL),
        ("FUJIFILM", "X-T3", note(FUJI, "<", entry("<", 0x1050, 3, 1)), ELECTRONIC),
        ("Panasonic", "DC-GH6", note(b"Panasonic\0\0\0", "<", entry("<", 0x9F, 3, 2)), MECHANICAL),
        ("Panasonic", "DC-GH6", note(b"Panasonic\0\0\0", "<", entry("<", 0x9F, 3, 1)), ELECTRONIC),
        ("PENTAX", "PENTAX KP", note(b"AOC\0MM", ">", entry(">", 0x87, 1, 1)), ELECTRONIC),
        ("RICOH IMAGING COMPANY, LTD.", "PENTAX KF", note(b"PENTAX \0II", "<", entry("<", 0x87, 1, 0)), MECHANICAL),
        ("NIKON CORPORATION", "NIKON Z 6", note(NIKON, ">", entry(">", 0x34, 3, 48)), MECHANICAL),
        ("NIKON CORPORATION", "NIKON D700", note(NIKON, ">", entry(">", 0x34, 3, 16)), ELECTRONIC),
        ("OLYMPUS CORPORATION", "E-M1MarkII", olympus(b"OLYMPUS\0II\3\0", 0, 0, 0, 0, 4), ELECTRONIC),
        ("OM Digital Solutions", "OM-1", olympus(b"OM SYSTEM\0\0\0II\4\0", 0, 0, 0, 0, 2, 17), MECHANICAL),
        ("OLYMPUS CORPORATION", "E-M1MarkII", olympus(b"OLYMPUS\0II\3\0", 0, 0), ReadoutSource.EITHER),  # not stated
        ("FUJIFILM", "X-T3", note(FUJI, "<", entry("<", 0x1050, 3, 9)), ReadoutSource.EITHER),
        ("FUJIFILM", "X-T3", FUJI + b"\xff\xff", ReadoutSource.EITHER),  # cut off
        ("SONY", "ILCE-9M3", b"SONY DSC \0\0\0", ReadoutSource.GLOBAL),
        ("SONY", "ILCE-9M2", b"SONY DSC \0\0\0", ReadoutSource.EITHER),
    ],
)
def test_makers_notes(make: str, model: str, own: bytes, source: ReadoutSource) -> None:
    time = readout_times.readout_time(photo(make, model, own))
    assert time.source is source
    assert time.longest_s == {MECHANICAL: 0.01, ReadoutSource.GLOBAL: 0.0}.get(source, 0.3)


@pytest.mark.parametrize(("mode", "source"), [(1, MECHANICAL), (2, ELECTRONIC)])
def test_canons_mode_is_one_of_many_numbers(mode: int, source: ReadoutSource) -> None:
    numbers = [0] * 23 + [mode, 0]
    own = note(b"", "<", entry("<", 0x93, 3, *numbers)) + struct.pack("<25H", *numbers)
    blob = photo("Canon", "Canon EOS R5", own)
    at = blob.index(own) - blob.index(b"II*\0")  # its offset is one in EXIF
    own = note(b"", "<", entry("<", 0x93, 3, *numbers, at=at + 18)) + struct.pack("<25H", *numbers)
    assert readout_times.readout_time(photo("Canon", "Canon EOS R5", own)).source is source


@pytest.mark.parametrize(
    "text", ['<d drone-dji:ShutterType="{}"/>', "<drone-dji:ShutterType>{}</drone-dji:ShutterType>"]
)
def test_a_drones_mechanical_shutter_is_in_its_lens(text: str) -> None:
    blob = photo("DJI", "M3E", b"")
    assert readout_times.readout_time(blob, text.format("Mechanical").encode()).longest_s == 0
    assert readout_times.readout_time(blob, text.format("Electronic").encode()).source is ReadoutSource.DRONE
    assert readout_times.readout_time(blob, b"").source is ReadoutSource.DRONE
