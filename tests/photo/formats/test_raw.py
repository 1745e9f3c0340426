"""Raw files: developed plainly, tags found where each maker puts them."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from support.camera_files import dng, linear, soft
from support.drawn_photos import drawn, encoded, one_line
from support.tagged_files import (
    EXIF,
    GPS,
    RATED_XMP,
    check_rich_exif,
    rich_exif,
)
from unshutter.errors import UnshutterError
from unshutter.photo import Photo, exif
from unshutter.photo.directories import read_tree
from unshutter.photo.formats import raw
from unshutter.photo.libvips import Source


def test_raw_is_developed_plainly_in_16_bits() -> None:
    pixels = soft()
    photo = Photo.from_bytes(dng(linear(pixels)))
    assert (photo.format, photo.bands, photo.orientation) == ("raw", 3, 1)
    read = photo.pixels
    assert read.dtype == np.uint16 and np.any(read % 256)
    assert np.abs(read / 257 - pixels)[12:-4, 12:-4].mean() < 2.5
    dark = Photo.from_bytes(dng(linear(np.minimum(pixels, 100)))).pixels  # not brightened
    assert dark.max() < 110 * 257
    tiff = Photo.from_bytes(photo.to_bytes())
    assert tiff.format == "tiff" and np.array_equal(tiff.pixels, read)


def raw_with_exif(orientation=1) -> bytes:
    stream = io.BytesIO(dng(linear(soft()), orientation, tags=[(700, 1, len(RATED_XMP), RATED_XMP, True)]))
    exif.add_to_tiff(stream, rich_exif(), 120, 160)
    return stream.getvalue()


@pytest.mark.parametrize("target", ["jpeg", "tiff"])
def test_raw_gives_its_metadata_to_every_format(target: str) -> None:
    photo = Photo.from_bytes(raw_with_exif(8))
    data = photo.with_pixels(~photo.pixels).to_bytes(target)
    check_rich_exif(data)
    with Image.open(io.BytesIO(data)) as picture:
        assert ImageCms.ImageCmsProfile(io.BytesIO(picture.info["icc_profile"])).profile.profile_description
        assert b'xmp:Rating="4"' in (picture.info.get("xmp") or picture.info["XML:com.adobe.xmp"].encode())
        if target != "tiff":
            assert picture.getexif()[0x0112] == 8
    assert Photo.from_bytes(data).orientation == 8


def test_raw_of_too_many_pixels_is_refused_before_it_is_developed() -> None:
    with pytest.raises(UnshutterError, match="160x120 px"):
        Photo.from_bytes(dng(linear(soft())), max_pixels=10_000)


def test_broken_raw_is_refused(tmp_path: Path) -> None:
    data = dng(linear(soft()))
    for name, content in (("a.dng", data[:3000]), ("b.nef", b"no raw file at all" * 9), ("c.cr2", data[:100])):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UnshutterError, match="as a camera's raw file") as error:
            Photo.open(tmp_path / name).to_array()
        assert str(tmp_path / name) in one_line(error)


def box(name: bytes, *contents: bytes) -> bytes:
    return struct.pack(">I4s", 8 + sum(map(len, contents)), name) + b"".join(contents)


def test_dng_in_jpeg_xl_is_refused_with_what_to_do() -> None:
    """The tag says so; there is no such data in it."""
    data = bytearray(dng(linear(drawn(96, 160))))
    compression = struct.pack("<HHI", 0x0103, 3, 1)
    struct.pack_into("<H", data, data.index(compression) + len(compression), 52546)
    with pytest.raises(UnshutterError, match="JPEG XL, which LibRaw cannot decode: use the camera's JPEG") as error:
        Photo.from_bytes(bytes(data))
    one_line(error)


def test_exif_is_found_where_each_maker_puts_it() -> None:
    tiff = rich_exif().removeprefix(b"Exif\0\0")
    little = Image.Exif()
    little.endian = "<"
    little.update({0x010F: "Acme"})
    olympus = b"IIRO" + little.tobytes().removeprefix(b"Exif\0\0")[4:]
    jpeg = encoded(drawn(), "JPEG", exif=rich_exif())
    fuji = b"FUJIFILMCCD-RAW ".ljust(84, b"\0") + struct.pack(">II", 100, len(jpeg)) + bytes(8) + jpeg
    exif_only, gps_only = Image.Exif(), Image.Exif()
    exif_only.update({0x9003: "2024:05:06 07:08:09"})
    gps_only.update({1: "N"})
    parts = (exif.tobytes().removeprefix(b"Exif\0\0") for exif in (exif_only, gps_only))
    parts = [box(b"CMT1", tiff), *(box(name, part) for name, part in zip((b"CMT2", b"CMT4"), parts, strict=True))]
    canon = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
    cr3 = box(b"ftyp", b"crx \0\0\0\1crx isom") + box(b"moov", box(b"uuid", canon, *parts), box(b"trak"))
    for data in (tiff, olympus, fuji, cr3):
        tree = raw.read_tags(io.BytesIO(data))
        assert tree is not None and tree.data(0x010F) == b"Acme\0"
    tree = raw.read_tags(io.BytesIO(cr3))
    assert tree is not None
    again = Image.Exif()
    again.load(exif.of_tiff(tree))
    assert again.get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09" and again.get_ifd(GPS)[1] == "N"
    for broken in (b"", fuji[:90], cr3[:60], box(b"ftyp", b"crx \0\0\0\1")):
        assert raw.read_tags(io.BytesIO(broken)) is None


def test_what_a_raw_file_keeps_to_itself_is_named(tmp_path: Path) -> None:
    canon = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
    parts = box(b"CMT1", rich_exif().removeprefix(b"Exif\0\0")) + box(b"CMT3", b"a note")
    cr3 = box(b"ftyp", b"crx \0\0\0\1crx isom") + box(b"moov", box(b"uuid", canon, parts), box(b"trak"))
    cr3 += box(b"uuid", bytes.fromhex("be7acfcb97a942e89c71999491e3afac"), RATED_XMP)
    for data, expected in (
        (cr3, ["maker's note", "XMP"]),
        (cr3[:24], ["EXIF"]),
    ):
        stream = io.BytesIO(data)
        assert [found.name for found in raw._unread(stream, raw.read_tags(stream))] == expected
    private = dng(linear(soft()), tags=[(0xC634, 1, 5, b"Adobe", True)])
    (tmp_path / "a.dng").write_bytes(private)
    assert Photo.open(tmp_path / "a.dng").encode().left_out == ("other data",)
    assert Photo.from_bytes(dng(linear(soft()))).encode().left_out == ()
    of_shot = [(0xC68B, 2, 0, "A001.CR2", True), (0xC763, 1, 8, bytes(range(8)), True), (0xC789, 2, 0, "Reel 7", True)]
    result = Photo.from_bytes(dng(linear(soft()), tags=of_shot)).encode()
    kept = read_tree(io.BytesIO(result.data)).pages[0]
    assert kept.keys() >= {0xC68B, 0xC763, 0xC789} and 0xC621 not in kept  # the colour matrix is of the sensor's values


def with_longer_strip(raw_file: bytes, more: int) -> bytes:
    """A DNG whose table says that its only strip is longer than it is."""
    at = raw_file.index(struct.pack("<HH", 279, 4)) + 8
    changed = bytearray(raw_file)
    struct.pack_into("<I", changed, at, struct.unpack_from("<I", raw_file, at)[0] + more)
    return bytes(changed)


def panasonic_tags(jpeg: bytes) -> bytes:
    """The head of an RW2: a TIFF under another number, with a whole JPEG in one of its tags."""
    table = struct.pack("<H", 2)
    table += struct.pack("<HHII", 0x002E, 7, len(jpeg), 8 + 2 + 2 * 12 + 4)
    table += struct.pack("<HHI4s", 0x010F, 2, 4, b"Own\0")
    return b"IIU\0" + struct.pack("<I", 8) + table + bytes(4) + jpeg


@pytest.mark.parametrize("left", [0.0, 0.02, 0.5, 0.9, 0.9999])
def test_a_raw_that_was_cut_short_is_refused(left: float) -> None:
    """LibRaw would develop what is there, and the rest black."""
    data = dng(linear(soft()))
    start = len(data) - 120 * 160 * 2
    with pytest.raises(UnshutterError, match=r"incomplete|the file ends too early") as error:
        Photo.from_bytes(data[: start + int(left * 120 * 160 * 2)]).to_array()
    one_line(error)


def test_libraw_prints_nothing_of_its_own(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.dng"
    path.write_bytes(dng(linear(soft()))[:-400])
    with pytest.raises(UnshutterError, match="the file ends too early"):
        Photo.open(path).to_array()
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("missing", [2, 1000, 30_000])
def test_a_decoder_that_reads_on_behind_the_end_is_found_out(missing: int) -> None:
    data = np.random.default_rng(1).integers(1, 255, 40_000, np.uint8).tobytes()

    def decode(stream: io.BytesIO) -> np.ndarray:
        """The first 40,000 bytes, zeros where there are fewer."""
        return np.frombuffer(stream.read(40_000).ljust(40_000, b"\0"), np.uint8)

    assert raw.is_complete(Source(data), decode(io.BytesIO(data)), decode)
    cut = data[:-missing]
    assert not raw.is_complete(Source(cut), decode(io.BytesIO(cut)), decode)
    assert raw.is_complete(Source(cut), decode(io.BytesIO(cut)), lambda _: None)  # a kind read from its end
    assert not raw.is_complete(Source(data), np.zeros(9, np.uint16), lambda _: None)


def test_a_table_that_is_wrong_does_no_harm() -> None:
    """Panasonic's strips are said to be as long as they would be without compression."""
    data = dng(linear(soft()))
    odd = with_longer_strip(data, 100_000)
    assert raw.is_whole(io.BytesIO(data)) is True
    assert raw.is_whole(io.BytesIO(odd)) is None
    assert np.array_equal(Photo.from_bytes(odd).pixels, Photo.from_bytes(data).pixels)


def test_lengths_of_fuji_and_canon_are_believed() -> None:
    fuji = b"FUJIFILMCCD-RAW ".ljust(84, b"\0") + struct.pack(">6I", 108, 50, 158, 10, 168, 32) + bytes(92)
    cr3 = box(b"ftyp", b"crx \0\0\0\1crx isom") + box(b"mdat", bytes(100))
    for data in (fuji, cr3):
        assert raw.is_whole(io.BytesIO(data)) is True
        assert raw.is_whole(io.BytesIO(data[:-1])) is False


def test_panasonics_makers_note_is_found() -> None:
    note = b"Panasonic\0\0\0" + bytes(range(100))
    tags = Image.Exif()
    tags[0x010F] = "Acme"
    tags.get_ifd(EXIF)[0x927C] = note
    tree = raw.read_tags(io.BytesIO(panasonic_tags(encoded(drawn(), "JPEG", exif=tags))))
    assert tree is not None
    blob = raw.exif_of(tree)
    again = Image.Exif()
    again.load(blob)
    assert again[0x010F] == "Acme" and again.get_ifd(EXIF)[0x927C] == note
    for preview in (b"", b"no JPEG at all", encoded(drawn(), "JPEG")):
        tree = raw.read_tags(io.BytesIO(panasonic_tags(preview)))
        assert tree is not None
        again.load(raw.exif_of(tree))
        assert again[0x010F] == "Own"
