"""What goes from every format to every other beside the pixels. Pillow is the independent reader and writer."""

import base64
import io

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from support.covering import covering
from support.drawn_photos import drawn, encoded, textured
from support.tagged_files import (
    ABOUT_CAMERA,
    ABOUT_EXPOSURE,
    ABOUT_PLACE,
    EXIF,
    GPS,
    SRGB,
    TITLE,
    full_exif,
    image_resources,
    jpeg_with,
    small_jpeg,
    tiff_with_exif,
)
from unshutter.photo import Photo
from unshutter.photo.formats import WRITTEN

XMP = (
    b'<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
    b'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"/></x:xmpmeta><?xpacket end="w"?>'
)


def source(format, order="<"):
    """A file in each format that has everything (TIFF: but colour and XMP), not made by the code under test."""
    if format == "tiff":
        return tiff_with_exif(order, drawn(bands=1)[..., 0])
    if format == "png":
        texts = PngImagePlugin.PngInfo()
        texts.add_itxt("XML:com.adobe.xmp", XMP.decode())
        return encoded(drawn(), "PNG", exif=full_exif(order), icc_profile=SRGB, pnginfo=texts)
    return encoded(drawn(), format.upper(), exif=full_exif(order), icc_profile=SRGB, xmp=XMP)


def check_tags(data, height, width):
    with Image.open(io.BytesIO(data)) as picture:
        tags = picture.getexif()
        assert ABOUT_CAMERA.items() <= dict(tags).items()
        exposure, place = tags.get_ifd(EXIF), tags.get_ifd(GPS)
    assert ABOUT_EXPOSURE.items() <= exposure.items()
    assert exposure.get(0xA002, width) == width and exposure.get(0xA003, height) == height
    assert ABOUT_PLACE.items() <= place.items()
    assert tags.get(0x0112, 6) == 6


@pytest.mark.parametrize(
    ("origin", "target", "order"), covering([*WRITTEN], [*WRITTEN][1:] + [*WRITTEN][:1], ["<", ">"])
)
def test_exif_goes_from_every_format_to_every_other(origin, target, order):
    photo = Photo.from_bytes(source(origin, order))
    assert (photo.height, photo.width) == (48, 80)
    check_tags(photo.to_bytes(target), 48, 80)
    changed = photo.with_pixels(photo.pixels[5:35, 3:63])
    data = changed.to_bytes(target)
    check_tags(data, 30, 60)
    back = Photo.from_bytes(data)
    assert (back.height, back.width, back.orientation) == (30, 60, 6)
    assert back.focal_px() == pytest.approx(26 / 43.2666 * np.hypot(30, 60), rel=1e-4)
    if origin != "tiff" or target == "tiff":
        check_tags(back.to_bytes("tiff"), 30, 60)  # and once more


@pytest.mark.parametrize("origin", ["jpeg", "png", "webp", "avif"])
@pytest.mark.parametrize("target", WRITTEN)
def test_icc_and_xmp_go_from_every_format_to_every_other(origin, target):
    photo = Photo.from_bytes(source(origin))
    data = photo.with_pixels(photo.pixels[5:35, 3:63]).to_bytes(target)
    for _ in range(2):
        with Image.open(io.BytesIO(data)) as picture:
            assert picture.info["icc_profile"] == SRGB
            xmp = picture.info.get("xmp") or picture.info["XML:com.adobe.xmp"].encode()  # PNG: a text
            assert b"<x:xmpmeta" in xmp and b"22-rdf-syntax-ns" in xmp
        data = Photo.from_bytes(data).to_bytes()


@pytest.mark.parametrize("target", WRITTEN)
@pytest.mark.parametrize("orientation", [1, 3, 5, 6])
def test_orientation_is_kept_and_pixels_are_never_turned(orientation, target):
    pixels = textured(48, 80)
    photo = Photo.from_bytes(encoded(pixels, "PNG", exif=full_exif(orientation=orientation)))
    np.testing.assert_array_equal(photo.to_array(), pixels)
    data = photo.to_bytes(target, quality=95)
    back = Photo.from_bytes(data)
    assert back.orientation == orientation and (back.height, back.width) == (48, 80)
    assert np.abs(back.to_array().astype(int) - pixels).mean() < 8
    if target != "tiff":  # Pillow's AVIF reader gives the orientation that the boxes say
        with Image.open(io.BytesIO(data)) as picture:
            assert picture.getexif()[0x0112] == orientation and picture.size == (80, 48)


def test_nothing_is_made_up_and_nothing_named_that_was_never_there():
    for format in ("JPEG", "PNG", "WEBP", "AVIF", "TIFF"):
        photo = Photo.from_bytes(encoded(drawn(), format))
        for target in WRITTEN:
            file = photo.encode(target)
            assert file.left_out == ()
            with Image.open(io.BytesIO(file.data)) as picture:
                assert target == "tiff" or (dict(picture.getexif()) == {} and not picture.info.get("icc_profile"))


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


@pytest.mark.parametrize("target", WRITTEN)
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


@pytest.mark.parametrize("target", WRITTEN)
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


@pytest.mark.parametrize(("height", "width"), [(3000, 4000), (4000, 3000)])
def test_focal_length_is_that_of_the_full_frame_diagonal(height, width):
    photo = Photo.from_bytes(encoded(np.zeros((height, width), np.uint8), "JPEG", exif=full_exif()))
    assert photo.focal_px() == pytest.approx(26 * 5000 / 43.26662, rel=1e-6)
    assert Photo.from_bytes(encoded(drawn(), "JPEG")).focal_px() is None
    tags = Image.Exif()
    tags.get_ifd(EXIF)[0xA405] = 0  # EXIF's "unknown"
    assert Photo.from_bytes(encoded(drawn(), "JPEG", exif=tags.tobytes())).focal_px() is None


@pytest.mark.parametrize("origin", ["jpeg", "webp", "avif"])
def test_a_tiff_gets_the_resolution_of_exif(origin):
    tags = Image.Exif()
    tags.update({0x010F: "Acme", 0x011A: 300.0, 0x011B: 150.0, 0x0128: 2})
    photo = Photo.from_bytes(encoded(drawn(), origin.upper(), exif=tags.tobytes()))
    with Image.open(io.BytesIO(photo.to_bytes("tiff"))) as picture:
        assert picture.info["dpi"] == (300, 150)
