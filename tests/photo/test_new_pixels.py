"""What must follow new pixels: thumbnails, sizes, orientation, wherever they are. And what must not move."""

import base64
import io

import numpy as np
import pytest
from PIL import Image, IptcImagePlugin
from PIL.JpegImagePlugin import get_sampling

from support.camera_files import (
    TITLE,
    blob_with_thumbnail,
    exif_blob,
    image_resources,
    jpeg_thumbnail,
    jpeg_with,
    small_jpeg,
)
from support.drawn_photos import drawn, encoded, textured
from unshutter.errors import UsageError
from unshutter.photo import Photo, containers, new_pixels, resources
from unshutter.photo.codecs import WRITTEN

FORMATS = tuple(WRITTEN)
EXIF = 0x8769


# ---- thumbnails ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("target", FORMATS)
def test_the_thumbnail_shows_the_new_pixels(target: str, order: str) -> None:
    before = drawn(300, 400)
    photo = Photo.from_bytes(encoded(before, "JPEG", quality=95, exif=blob_with_thumbnail(order)))
    after = np.ascontiguousarray(255 - before[20:220, 30:330])
    data = photo.with_pixels(after).to_bytes(target)
    assert small_jpeg()[-200:] not in data
    with Image.open(io.BytesIO(data)) as picture:
        exif = picture.info.get("exif")
    if target == "tiff":  # a TIFF's second directory is another page
        assert exif is None
        return
    shown = jpeg_thumbnail(exif)
    assert shown.size == (160, 107)
    expected = Image.fromarray(after).resize(shown.size, Image.Resampling.BOX)
    assert np.abs(np.asarray(shown).astype(int) - np.asarray(expected)).mean() < 4


@pytest.mark.parametrize("pixels", [drawn(bands=1), drawn(bands=4), drawn(bands=3, dtype=np.uint16)], ids=str)
def test_thumbnails_of_all_kinds_of_pixels(pixels: np.ndarray) -> None:
    photo = Photo.from_bytes(encoded(drawn(), "PNG", exif=blob_with_thumbnail()))
    data = photo.with_pixels(pixels).to_bytes("png")
    with Image.open(io.BytesIO(data)) as picture:
        picture.load()
        shown = jpeg_thumbnail(picture.info["exif"])
    assert shown.size == (80, 48)  # not enlarged
    assert abs(int(np.asarray(shown)[..., 0].mean()) - 128) < 40


def test_a_photo_that_is_only_copied_keeps_its_thumbnail() -> None:
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=blob_with_thumbnail()))
    assert small_jpeg() in photo.to_bytes() and small_jpeg() in photo.to_bytes("png")


def test_a_photo_without_a_thumbnail_gets_none() -> None:
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=exif_blob()))
    with Image.open(io.BytesIO(photo.with_pixels(~photo.pixels).to_bytes())) as picture:
        assert jpeg_thumbnail(picture.info["exif"]) is None


def test_where_there_is_no_room_the_thumbnail_goes() -> None:
    note = bytes(range(256)) * 240
    exif = Image.Exif()
    exif.get_ifd(EXIF)[0x927C] = note
    blob = new_pixels.exif_with_thumbnail(exif.tobytes(), small_jpeg())
    assert len(blob) < 65_000 and jpeg_thumbnail(blob) is not None
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=blob))
    changed = photo.with_pixels(np.random.default_rng(1).integers(0, 256, (200, 300, 3)).astype(np.uint8))
    with Image.open(io.BytesIO(changed.to_bytes())) as picture:
        assert jpeg_thumbnail(picture.info["exif"]) is None
        assert picture.getexif().get_ifd(EXIF)[0x927C] == note


@pytest.mark.parametrize("target", FORMATS)
def test_thumbnails_of_photoshop_and_xmp_go_and_the_rest_stays(target: str) -> None:
    thumbnail = small_jpeg()
    blocks = image_resources((1028, TITLE), (1036, bytes(28) + thumbnail), (1033, thumbnail), (1060, b"last"))
    inside = base64.b64encode(thumbnail)
    xmp = (
        b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        b'<rdf:Description xmlns:xmp="http://ns.adobe.com/xap/1.0/" xmp:Rating="4" '
        b'xmpNote:HasExtendedXMP="0123456789ABCDEF"><xmp:Thumbnails><rdf:Alt><rdf:li rdf:parseType="Resource">'
        b"<xmpGImg:image>" + inside + b"</xmpGImg:image></rdf:li></rdf:Alt></xmp:Thumbnails>"
        b"<xmp:Label>Best</xmp:Label></rdf:Description></rdf:RDF></x:xmpmeta>"
    )
    app1, app13 = b"http://ns.adobe.com/xap/1.0/\0" + xmp, b"Photoshop 3.0\0" + blocks
    photo = Photo.from_bytes(jpeg_with(drawn(), (0xE1, app1), (0xED, app13)))
    data = photo.with_pixels(~photo.pixels).to_bytes(target)
    assert thumbnail[-100:] not in data and inside[-100:] not in data and b"HasExtendedXMP" not in data
    with Image.open(io.BytesIO(data)) as picture:
        kept = picture.info.get("xmp") or picture.info["XML:com.adobe.xmp"].encode()
    assert b'xmp:Rating="4"' in kept and b"<xmp:Label>Best</xmp:Label>" in kept
    assert (b"Street" in data) == (target in ("jpeg", "tiff"))  # IPTC, which the others have no place for


@pytest.mark.parametrize("origin", ["jpeg", "tiff", "tiff, IPTC alone"])
@pytest.mark.parametrize("target", ["jpeg", "tiff"])
def test_iptc_goes_between_jpeg_and_tiff(origin: str, target: str) -> None:
    blocks = image_resources((1028, TITLE), (1060, b"last"))
    tags = {33723: TITLE} | ({} if "alone" in origin else {34377: blocks})
    if origin == "jpeg":
        data = jpeg_with(drawn(), (0xED, b"Photoshop 3.0\0" + blocks))
    else:
        data = encoded(drawn(), "TIFF", tiffinfo=tags)
    photo = Photo.from_bytes(data)
    for written in (photo.to_bytes(target), photo.with_pixels(~photo.pixels).to_bytes(target)):
        with Image.open(io.BytesIO(written)) as picture:
            assert IptcImagePlugin.getiptcinfo(picture) == {(2, 5): b"Street"}
            if target == "tiff":
                assert picture.tag_v2[33723] == TITLE
                assert (b"8BIM\x04\x24" in written) == ("alone" not in origin)


def test_damaged_resources_stay_as_they_are() -> None:
    whole = image_resources((1028, TITLE), (1060, b"last"))
    for cut in range(len(whole)):
        assert resources.without_thumbnails(whole[:cut]) == whole[:cut]


# ---- sizes and orientation -----------------------------------------------------------------------------------


@pytest.mark.parametrize("target", FORMATS)
def test_sizes_are_those_of_the_new_pixels(target: str) -> None:
    exif = Image.Exif()
    exif.update({0x0100: 80, 0x0101: 48, 0x010F: "Acme"})
    exif.get_ifd(EXIF).update({0xA002: 80, 0xA003: 48})
    xmp = (
        b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        b'<rdf:Description tiff:ImageWidth="80" tiff:ImageLength=\'48\' tiff:Orientation="1" exif:PixelYDimension="48">'
        b"<exif:PixelXDimension>80</exif:PixelXDimension></rdf:Description></rdf:RDF></x:xmpmeta>"
    )
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=exif.tobytes(), xmp=xmp))
    data = photo.with_pixels(photo.pixels[4:40, 10:70]).to_bytes(target)
    with Image.open(io.BytesIO(data)) as picture:
        tags = picture.getexif()
        assert (tags[0x0100], tags[0x0101]) == (60, 36)
        assert (tags.get_ifd(EXIF)[0xA002], tags.get_ifd(EXIF)[0xA003]) == (60, 36)
        told = picture.info.get("xmp") or picture.info["XML:com.adobe.xmp"].encode()
    for expected in (b'tiff:ImageWidth="60"', b"tiff:ImageLength='36'", b'exif:PixelYDimension="36"'):
        assert expected in told
    assert b"<exif:PixelXDimension>60</exif:PixelXDimension>" in told and b'tiff:Orientation="1"' in told


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("told", [False, True])
def test_orientation_is_put_into_any_blob(order: str, told: bool) -> None:
    exif = Image.Exif()
    exif.endian = order
    exif.update({0x0132: "2024:05:06 07:08:09", 0x010F: "Acme"} | ({0x0112: 1} if told else {}))
    blob = new_pixels.exif_with_orientation(exif.tobytes(), 6)
    again = Image.Exif()
    again.load(blob)
    assert dict(again) == {0x0132: "2024:05:06 07:08:09", 0x010F: "Acme", 0x0112: 6}
    assert new_pixels.exif_with_orientation(None, 1) is None
    made = new_pixels.exif_with_orientation(None, 8)
    again = Image.Exif()
    again.load(made)
    assert dict(again) == {0x0112: 8}


# ---- what must not move --------------------------------------------------------------------------------------


@pytest.mark.parametrize("target", ["jpeg", "png", "webp", "avif"])
def test_exif_is_the_same_byte_for_byte_but_for_the_sizes(target: str) -> None:
    """Makers' notes point to places counted from the blob's beginning; some tags are known to their maker alone."""
    exif = Image.Exif()
    exif.update({0x0112: 6, 0x010F: "SONY", 0xE000: b"of a maker"})
    exif.get_ifd(EXIF).update({0x927C: b"SONY DSC " + bytes(range(200)), 0xFE00: b"unknown", 0xA002: 80, 0xA003: 48})
    blob = exif.tobytes()
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", exif=blob))
    for changed in (photo, photo.with_pixels(~photo.pixels)):
        with Image.open(io.BytesIO(changed.to_bytes(target))) as picture:
            picture.load()
            assert picture.info["exif"].removeprefix(b"Exif\0\0") == blob.removeprefix(b"Exif\0\0")


@pytest.mark.parametrize("target", FORMATS)
def test_exif_too_long_for_a_jpeg_loses_the_makers_note_there_and_only_there(target: str) -> None:
    exif = Image.Exif()
    exif.update({0x010F: "Acme"})
    exif.get_ifd(EXIF).update({0x927C: bytes(80_000), 0x9003: "2024:05:06 07:08:09"})
    exif.get_ifd(0x8825).update({1: "N", 2: (48.0, 51.0, 29.5)})
    data = Photo.from_bytes(encoded(drawn(), "PNG", exif=exif.tobytes())).to_bytes(target)
    with Image.open(io.BytesIO(data)) as picture:
        tags = picture.getexif()
        assert tags[0x010F] == "Acme" and tags.get_ifd(0x8825)[2] == (48.0, 51.0, 29.5)
        assert tags.get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09"
        assert (0x927C in tags.get_ifd(EXIF)) == (target != "jpeg")


# ---- chroma subsampling --------------------------------------------------------------------------------------


@pytest.mark.parametrize("given", ["4:4:4", "4:2:0"])
@pytest.mark.parametrize("told", ["4:4:4", "4:2:0", None])
def test_subsampling_is_the_inputs_unless_told(given: str, told) -> None:
    photo = Photo.from_bytes(encoded(textured(48, 80), "JPEG", subsampling=given))
    with Image.open(io.BytesIO(photo.to_bytes(subsampling=told))) as picture:
        assert get_sampling(picture) == {"4:4:4": 0, "4:2:0": 2}[told or given]
    avif = io.BytesIO(photo.to_bytes("avif", subsampling=told))
    assert containers.box_coding(avif).subsampled == ((told or given) == "4:2:0")


def test_unknown_subsampling_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match="choose one of 4:4:4, 4:2:0"):
        Photo.from_array(drawn()).to_bytes("jpeg", subsampling="4:1:0")  # pyright: ignore[reportArgumentType]
