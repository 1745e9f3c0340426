"""What a JPEG says in its segments, and that it goes along. Pillow is the independent writer and reader."""

import io
import time

import pytest
from PIL import Image, IptcImagePlugin
from PIL.JpegImagePlugin import get_sampling

from support.covering import thorough
from support.drawn_photos import drawn, encoded
from support.tagged_files import TITLE, exif_blob, full_exif, image_resources, jpeg_with
from unshutter.photo import Photo, chunks
from unshutter.photo.directories import EXIF, GPS, Entry, Tree, encoded_number
from unshutter.photo.exif import of_tiff
from unshutter.photo.formats import WRITTEN

PHOTOSHOP, ADOBE = b"Photoshop 3.0\0", b"http://ns.adobe.com/xap/1.0/\0"


def result(data: bytes, target=None, **options):
    photo = Photo.from_bytes(data)
    return photo.with_pixels(~photo.pixels).encode(target, **options)


def opened(data: bytes) -> Image.Image:
    return Image.open(io.BytesIO(data))


@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("dpi", [(300, 300), (72, 72), (300, 150)])
def test_density_is_kept(dpi, bands) -> None:
    pixels = drawn(bands=bands)
    file = result(encoded(pixels[..., 0] if bands == 1 else pixels, "JPEG", dpi=dpi))
    assert opened(file.data).info["dpi"] == dpi and opened(file.data).info["jfif_unit"] == 1
    assert file.left_out == ()


def test_density_goes_to_a_jpeg_from_other_formats() -> None:
    for format in ("PNG", "TIFF"):
        dpi = opened(result(encoded(drawn(), format, dpi=(300, 300)), "jpeg").data).info["dpi"]
        assert [round(number) for number in dpi] == [300, 300]


def test_no_density_is_made_up() -> None:
    assert b"JFIF" not in result(encoded(drawn(), "PNG"), "jpeg").data
    assert "dpi" not in opened(result(encoded(drawn(), "JPEG")).data).info


def test_comments_are_kept() -> None:
    file = result(jpeg_with(drawn(), (0xFE, b"by me"), (0xFE, b"\xff\0twice"), exif=exif_blob()))
    assert [content for name, content in opened(file.data).applist if name == "COM"] == [b"by me", b"\xff\0twice"]
    assert file.left_out == ()
    assert result(jpeg_with(drawn(), (0xFE, b"by me")), "webp").left_out == ("comment",)


def test_resources_in_several_segments_are_joined() -> None:
    """A block may begin in one segment and end in the next; the first may hold no IPTC at all."""
    blocks = image_resources((1060, bytes(range(256)) * 500), (1028, TITLE), (1061, b"last"))
    parts = [PHOTOSHOP + blocks[at : at + 60_000] for at in range(0, len(blocks), 60_000)]
    assert len(parts) == 3
    file = result(jpeg_with(drawn(), *((0xED, part) for part in parts)))
    assert file.left_out == ()
    kept = [content for name, content in opened(file.data).applist if name == "APP13"]
    assert b"".join(part.removeprefix(PHOTOSHOP) for part in kept) == blocks
    again = result(jpeg_with(drawn(), (0xED, PHOTOSHOP), (0xED, PHOTOSHOP + image_resources((1028, TITLE)))))
    assert IptcImagePlugin.getiptcinfo(opened(again.data)) == {(2, 5): b"Street"}
    assert IptcImagePlugin.getiptcinfo(opened(result(again.data, "tiff").data)) == {(2, 5): b"Street"}


@pytest.mark.parametrize(
    ("segment", "name"),
    [
        ((0xE1, b"http://ns.adobe.com/xmp/extension/\0" + bytes(40)), "XMP (beyond the first 64 kB)"),
        ((0xE2, b"MPF\0MM\0*\0\0\0\x08"), "further pictures"),
        ((0xE4, b"of a program"), "other data"),
        ((0xE1, exif_blob()), "other data"),
        ((0xE1, ADOBE + b"<b/>"), "other data"),
    ],
)
def test_what_no_result_gets_is_named(segment, name) -> None:
    assert result(jpeg_with(drawn(), (0xE1, exif_blob()), (0xE1, ADOBE + b"<a/>"), segment)).left_out == (name,)


@pytest.mark.parametrize("progressive", [False, True])
def test_data_behind_the_picture_are_named(progressive: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "_PIECE", 100)  # so that markers are cut in two
    data = encoded(drawn(), "JPEG", progressive=progressive, restart_marker_blocks=3)
    for fill in (b"", bytes(3000), b"\xff\xff", b"\r\n"):
        assert result(data + fill).left_out == ()
    for more, name in ((b"PK\3\4 of a program", "other data"), (data, "further pictures")):
        assert result(data + bytes(5) + more).left_out == (name,)
    for nothing in (data[:-2], data + bytes(6500) + b"PK"):  # nothing tells the end; 64 pieces are read, not gigabytes
        assert list(chunks.pieces_behind(io.BytesIO(nothing), len(nothing))) == []
    whole = data + bytes(7) + data + b"PK\3\4"
    assert list(chunks.pieces_behind(io.BytesIO(whole), len(whole))) == [
        (len(data) + 7, len(data)),
        (2 * len(data) + 7, 4),
    ]


def test_bytes_between_segments_are_passed_over_as_by_decoders() -> None:
    packet = b"<x:xmpmeta xmlns:x='adobe:ns:meta/'/>"
    data = jpeg_with(drawn(), (0xE1, b"http://ns.adobe.com/xap/1.0/\0" + packet))
    data = data[:2] + b"\xff\xee\0\x04\0\0" + bytes(16) + b"\xff\0" + data[2:]
    assert packet in result(data).data


@pytest.mark.parametrize("subsampling", ["4:4:4", "4:2:0"])
def test_bytes_that_fill_the_place_before_a_marker_change_nothing(subsampling) -> None:
    whole = encoded(drawn(), "JPEG", subsampling=subsampling, quality=61, exif=full_exif())
    filled = whole.replace(b"\xff\xc0\0\x11", b"\xff\xff\xff\xc0\0\x11").replace(b"\xff\xdb", b"\xff\xff\xff\xff\xdb")
    filled = filled[:2] + b"\xff" * 5 + filled[2:]
    assert len(filled) > len(whole) + 8
    before, after = result(whole).data, result(filled).data
    assert get_sampling(opened(after)) == get_sampling(opened(whole))
    assert opened(after).quantization == opened(before).quantization
    assert opened(after).info["exif"] == opened(before).info["exif"]


# ---- EXIF that is too much -----------------------------------------------------------------------------------


def long_exif(comment_bytes: int, note_bytes: int = 0) -> bytes:
    details = {0x9003: Entry(2, 20, b"2024:05:06 07:08:09\0"), 0x9286: Entry(7, comment_bytes, b"a" * comment_bytes)}
    if note_bytes:
        details[0x927C] = Entry(7, note_bytes, bytes(note_bytes))
    place = {1: Entry(2, 2, b"N\0")}
    blob = of_tiff(Tree("<", [{0x010F: Entry(2, 5, b"Acme\0"), EXIF: details, GPS: place}]))
    assert blob is not None
    return blob


def test_of_exif_that_is_too_long_for_a_jpeg_only_the_longest_tags_are_left_out() -> None:
    for blob, left_out in (
        (long_exif(1 << 20), ("long tags of EXIF",)),
        (long_exif(100, 70_000), ("maker's note",)),
        (long_exif(1 << 20, 100), ("maker's note", "long tags of EXIF")),
    ):
        file = result(encoded(drawn(), "PNG", exif=blob), "jpeg")
        assert file.left_out == left_out
        tags = opened(file.data).getexif()
        assert tags[0x010F] == "Acme" and tags.get_ifd(GPS)[1] == "N"
        assert tags.get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09"


@pytest.mark.parametrize("length", [thorough(length) if length % 8 else length for length in range(65_200, 65_500)])
def test_exif_about_as_long_as_a_segment_can_be_is_written_whole_or_named(length: int) -> None:
    file = Photo.from_bytes(encoded(drawn(8, 8), "PNG", exif=long_exif(length))).encode("jpeg")
    kept = len(opened(file.data).getexif().get_ifd(EXIF).get(0x9286, b""))
    assert kept == (0 if file.left_out else length)


@pytest.mark.parametrize("length", [59_999, 60_001, 65_504, 65_505])
def test_long_xmp_is_written_whole_or_named(length: int) -> None:
    packet = b"<x:xmpmeta xmlns:x='adobe:ns:meta/'/>".ljust(length)
    file = Photo.from_bytes(encoded(drawn(8, 8), "WEBP", xmp=packet)).encode("jpeg")
    assert file.left_out == (("XMP (too long for a JPEG)",) if length > 65_504 else ())
    assert (packet in file.data) == (length <= 65_504)


@pytest.mark.parametrize("target", ["jpeg", "png", "webp", "tiff", "avif"])
def test_much_exif_takes_no_time(target) -> None:
    source = encoded(drawn(), "PNG", exif=long_exif(9 << 20))
    start = time.process_time()
    file = result(source, target)
    assert time.process_time() - start < 5
    assert (len(file.data) > 9 << 20) == (target != "jpeg")


@pytest.mark.parametrize("format", ["JPEG", "PNG", "WEBP", "AVIF"])
def test_exif_whose_directories_go_round_in_circles_is_no_trap(format) -> None:
    blob = b"Exif\0\0II*\0" + b"\x08\0\0\0\1\0" + encoded_number("<", EXIF, 4, 8) + b"\x08\0\0\0"
    data = encoded(drawn(), format, exif=blob)
    assert WRITTEN[format.lower()].hidden_markers(io.BytesIO(data))  # libvips does not see it
    file = result(data)
    assert file.left_out == ("EXIF (damaged)",)
