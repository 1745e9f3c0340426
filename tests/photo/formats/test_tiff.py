"""TIFF: compression, pages, BigTIFF, IPTC and tags of its own."""

import io
import struct
from fractions import Fraction

import numpy as np
import pytest
import pyvips
from PIL import Image

from support.drawn_photos import drawn, encoded, textured
from support.tagged_files import (
    ABOUT_CAMERA,
    EXIF,
    GPS,
    TITLE,
    exif_blob,
    full_exif,
)
from unshutter import RowMotion, UnshutterError, rectify
from unshutter.photo import Photo, exif
from unshutter.photo.directories import Entry, in_classic
from unshutter.photo.formats import tiff


def test_tags_that_only_tiff_keeps_stay_there():
    tags = Image.Exif()
    tags.update(ABOUT_CAMERA | {0x4746: 4})
    tags.get_ifd(EXIF)[0xFE00] = b"of my own"
    photo = Photo.from_bytes(Photo.from_bytes(encoded(drawn(), "JPEG", exif=tags.tobytes())).to_bytes("tiff"))
    with Image.open(io.BytesIO(photo.to_bytes())) as picture:
        assert picture.getexif()[0x4746] == 4
        assert picture.getexif().get_ifd(EXIF)[0xFE00] == b"of my own"


def test_a_tiff_with_a_smaller_copy_of_itself_is_one_photo():
    stream = io.BytesIO()
    small = Image.fromarray(drawn(12, 20))
    small.encoderinfo = {"tiffinfo": {254: 1}}
    Image.fromarray(drawn()).save(stream, "TIFF", save_all=True, append_images=[small])
    np.testing.assert_array_equal(Photo.from_bytes(stream.getvalue()).to_array(), drawn())


def big_tiff() -> bytes:
    return pyvips.Image.new_from_array(drawn()).tiffsave_buffer(bigtiff=True)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_big_tiff_has_its_tags_as_others_do(order):
    stream = io.BytesIO(big_tiff())
    more = {33723: Entry(1, len(TITLE), TITLE)}
    assert exif.add_to_tiff(stream, full_exif(order), 48, 80, more)
    tifffile = pytest.importorskip("tifffile", reason="Pillow reads no EXIF of a BigTIFF")
    with tifffile.TiffFile(io.BytesIO(stream.getvalue())) as file:
        tags = file.pages[0].tags
        assert tags["Model"].value == ABOUT_CAMERA[0x0110]
        assert tags["ExifTag"].value["DateTimeOriginal"] == "2024:05:06 07:08:09"
        assert tags["GPSTag"].value["GPSLatitudeRef"] == "N"
        np.testing.assert_array_equal(file.pages[0].asarray(), drawn())
    photo = Photo.from_bytes(stream.getvalue())
    np.testing.assert_array_equal(photo.to_array(), drawn())
    result = photo.encode("jpeg")
    assert result.left_out == () and TITLE in result.data
    with Image.open(io.BytesIO(result.data)) as picture:
        tags = picture.getexif()
        assert tags[0x0110] == ABOUT_CAMERA[0x0110] and tags.get_ifd(GPS)[1] == "N"
        assert tags.get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09"


def test_what_becomes_a_big_tiff_keeps_its_tags(monkeypatch):
    monkeypatch.setattr("unshutter.photo.formats.tiff._CLASSIC_BYTES", 0)
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=full_exif()))
    result = photo.encode("tiff")
    assert result.data.startswith(b"II+\0") and result.left_out == ()
    again = Photo.from_bytes(result.data)
    np.testing.assert_array_equal(again.to_array(), photo.to_array())
    with Image.open(io.BytesIO(again.to_bytes("png"))) as picture:
        assert picture.getexif().get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09"


def test_numbers_of_64_bits_become_narrower_where_they_fit():
    wide = {1: Entry(16, 2, struct.pack(">2Q", 7, 9)), 2: Entry(17, 1, struct.pack(">q", -7))}
    tags = wide | {3: Entry(16, 1, struct.pack(">Q", 1 << 40)), 4: Entry(3, 1, b"\0\1"), EXIF: wide}
    narrow = {1: Entry(4, 2, struct.pack(">2I", 7, 9)), 2: Entry(9, 1, struct.pack(">i", -7))}
    assert in_classic(tags, ">") == narrow | {4: Entry(3, 1, b"\0\1"), EXIF: narrow}


@pytest.mark.parametrize("at", [1 << 20, (1 << 63) - 1, (1 << 64) - 1])
def test_a_big_tiff_that_points_nowhere_is_refused(at, tmp_path):
    path = tmp_path / "a.tif"
    path.write_bytes(b"II+\0\x08\0\0\0" + struct.pack("<Q", at) + bytes(100))
    with pytest.raises(UnshutterError, match="damaged, incomplete or unusual"):
        Photo.open(path)
    path.write_bytes(b"II+\0\x08\0\0\0" + struct.pack("<QQ", 16, at) + bytes(100))  # so many tags
    with pytest.raises(UnshutterError, match="damaged, incomplete or unusual"):
        Photo.open(path)


# ---- channels beside the colours -----------------------------------------------------------------------


def with_mask(pixels: np.ndarray, mask: np.ndarray, told: bool = True) -> bytes:
    """A TIFF whose last channel is a mask, called unspecified or (not told) nothing at all."""
    data = bytearray(encoded(np.dstack([pixels, mask]), "TIFF"))
    at = 8 + 2 + 12 * [tag for tag, _ in entries(bytes(data))].index(338)
    assert struct.unpack_from("<HHIH", data, at) == (338, 3, 1, 2)
    if told:
        struct.pack_into("<H", data, at + 8, 0)
    else:
        struct.pack_into("<H", data, at, 339)  # the next tag: what numbers the samples are
        struct.pack_into("<H", data, at + 8, 1)
    return bytes(data)


def entries(data: bytes) -> list[tuple[int, bytes]]:
    """(tag, its twelve bytes) of the first directory of a little-endian TIFF."""
    (at,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, at)
    rows = [data[at + 2 + 12 * i : at + 14 + 12 * i] for i in range(count)]
    return [(struct.unpack_from("<H", row)[0], row) for row in rows]


@pytest.mark.parametrize("told", [True, False])
def test_a_mask_is_not_taken_for_transparency(told):
    """Colours under a mask of 0 stay, and the mask moves with them."""
    colours, mask = textured(64, 80), np.zeros((64, 80), np.uint8)
    mask[20:40, 30:60] = 255
    photo = Photo.from_bytes(with_mask(colours, mask, told))
    assert not photo.has_alpha and photo.masked
    motion = RowMotion(80, np.full(64, 2.0), np.zeros(64))
    result = rectify(photo, motion=motion, edges="fill").photo
    alone = rectify(colours, motion=motion, edges="fill").array
    np.testing.assert_array_equal(result.to_array()[..., :3], alone)
    np.testing.assert_array_equal(result.grey(), Photo.from_array(alone).grey())
    np.testing.assert_array_equal(photo.grey(), Photo.from_array(colours).grey())
    assert result.to_array()[30, 45, 3] == 255 and result.to_array()[5, 45, 3] == 0

    again = Photo.from_bytes(result.to_bytes())
    np.testing.assert_array_equal(again.pixels, result.pixels)
    assert again.masked
    for format in ("png", "jpeg", "webp", "avif"):
        file = result.encode(format)
        assert file.left_out == ("mask channel",) and Photo.from_bytes(file.data).bands == 3


def test_a_mask_of_a_big_tiff_is_not_taken_for_transparency():
    data = bytearray(pyvips.Image.new_from_array(drawn(bands=4)).tiffsave_buffer(bigtiff=True))
    at = data.index(struct.pack("<HHQH", 338, 3, 1, 2))
    struct.pack_into("<H", data, at + 12, 0)
    photo = Photo.from_bytes(bytes(data))
    assert photo.masked
    assert Photo.from_bytes(photo.to_bytes()).masked


def test_grey_with_several_channels_is_no_rgb():
    data = bytearray(encoded(drawn(), "TIFF"))
    at = data.index(struct.pack("<HHIH", 262, 3, 1, 2))
    struct.pack_into("<H", data, at + 8, 1)
    with pytest.raises(UnshutterError, match="2 channels in addition to grey"):
        Photo.from_bytes(bytes(data))


# ---- half read -----------------------------------------------------------------------------------------


def test_old_style_jpeg_is_refused():
    data = bytearray(encoded(drawn(), "TIFF", compression="jpeg"))
    at = data.index(struct.pack("<HHIH", 259, 3, 1, 7))
    struct.pack_into("<H", data, at + 8, 6)
    with pytest.raises(UnshutterError, match="old-style"):
        Photo.from_bytes(bytes(data))


def test_damaged_jpeg_data_inside_are_refused():
    data = bytearray(encoded(textured(96, 128), "TIFF", compression="jpeg"))
    with Image.open(io.BytesIO(data)) as picture:
        at, length = picture.tag_v2[273][0], picture.tag_v2[279][0]
    data[at + length // 2 : at + length] = b"\xff" * (length - length // 2)
    photo = Photo.from_bytes(bytes(data))
    with pytest.raises(UnshutterError, match="damaged or incomplete"):
        photo.to_array()


# ---- tags of its own -----------------------------------------------------------------------------------

OWN_TAGS = {
    269: "a document",
    285: "a page",
    286: 1.5,
    287: 2.25,
    316: "a computer",
    318: (0.3127, 0.329),
    319: (0.64, 0.33, 0.3, 0.6, 0.15, 0.06),
    50735: "serial 12",
}
PLACE = {33550: (0.5, 0.5, 0.0), 33922: (0.0, 0.0, 0.0, 11.0, 48.0, 0.0), 34735: (1, 1, 0, 1, 1024, 0, 1, 2)}


def test_names_colours_serial_number_and_place_on_earth_are_kept():
    photo = Photo.from_bytes(encoded(drawn(), "TIFF", tiffinfo=OWN_TAGS | PLACE))
    result = photo.with_pixels(drawn()).encode()
    with Image.open(io.BytesIO(result.data)) as picture:
        for tag, value in (OWN_TAGS | PLACE).items():
            expected = value if isinstance(value, str) else pytest.approx(value)
            assert picture.tag_v2[tag] == expected, tag
    assert result.left_out == ()


def test_a_cropped_picture_is_not_where_the_whole_one_was():
    photo = Photo.from_bytes(encoded(drawn(), "TIFF", tiffinfo=OWN_TAGS | PLACE)).with_pixels(drawn()[5:, 5:].copy())
    result = photo.encode()
    with Image.open(io.BytesIO(result.data)) as picture:
        assert picture.tag_v2[269] == "a document" and not picture.tag_v2.keys() & PLACE.keys()
    assert result.left_out == ("GeoTIFF (the picture is cropped)",)


@pytest.mark.parametrize("unit", [1, 2, 3])
def test_resolution_keeps_its_unit(unit):
    photo = Photo.from_bytes(encoded(drawn(), "TIFF", tiffinfo={282: 300.0, 283: 150.0, 296: unit}))
    with Image.open(io.BytesIO(photo.to_bytes())) as picture:
        told = [picture.tag_v2[tag] for tag in (282, 283, 296)]
    assert told == [300, 150, unit]
    with Image.open(io.BytesIO(photo.to_bytes("jpeg"))) as picture:
        assert picture.info.get("jfif_density", (1, 1))[0] != 7620


@pytest.mark.parametrize("dpi", [72, 180, 230, 240, 300, 350])
def test_a_resolution_is_not_rounded(dpi, monkeypatch):
    """libvips makes 229.999 of 230."""
    given = encoded(drawn(), "TIFF", dpi=(dpi, 2 * dpi))
    for big in (False, True):
        monkeypatch.setattr(tiff, "_CLASSIC_BYTES", 0 if big else tiff._CLASSIC_BYTES)
        for photo in (Photo.from_bytes(given), Photo.from_bytes(encoded(drawn(), "PNG", dpi=(dpi, 2 * dpi)))):
            with Image.open(io.BytesIO(photo.to_bytes("tiff"))) as picture:
                per_inch = 1 if picture.tag_v2[296] == 2 else 2.54
                told = [Fraction(picture.tag_v2[tag].numerator, picture.tag_v2[tag].denominator) for tag in (282, 283)]
            error = 1e-9 if photo.format == "tiff" else 3e-4  # PNG counts whole pixels in a metre
            assert [float(each) * per_inch for each in told] == pytest.approx([dpi, 2 * dpi], rel=error)


def test_a_description_goes_along_as_exif_does():
    photo = Photo.from_bytes(encoded(drawn(), "TIFF", tiffinfo={270: "a street"}))
    for format in ("tiff", "jpeg", "png"):
        file = photo.encode(format)
        with Image.open(io.BytesIO(file.data)) as picture:
            assert picture.getexif()[270] == "a street" and file.left_out == ()


def test_tags_that_nobody_knows_are_named():
    photo = Photo.from_bytes(encoded(drawn(), "TIFF", tiffinfo={65000: "mine", 37724: b"layers"}))
    assert photo.encode().left_out == ("Photoshop's layers", "other data")
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=exif_blob(**{"37510": "misplaced", "59932": b"free"})))
    assert photo.encode("tiff").left_out == ("other data",) and photo.encode("png").left_out == ()


def test_colours_multiplied_by_their_opacity_are_divided_by_it():
    straight = drawn(bands=4)
    stored = straight.copy()
    stored[..., :3] = np.round(straight[..., :3] * (straight[..., 3:] / 255))
    data = bytearray(encoded(stored, "TIFF"))
    at = data.index(struct.pack("<HHIH", 338, 3, 1, 2))
    struct.pack_into("<H", data, at + 8, 1)
    photo = Photo.from_bytes(bytes(data))
    assert photo.has_alpha
    assert np.abs(photo.to_array().astype(int) - straight).max() <= 2
    np.testing.assert_array_equal(Photo.from_bytes(photo.to_bytes()).pixels, photo.pixels)
