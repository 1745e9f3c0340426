"""Photo: what goes from file to file beside the pixels. Pillow is the independent reader and writer."""

import io
import struct

import numpy as np
import pytest
from PIL import Image, ImageCms, PngImagePlugin

from support.camera_files import ABOUT_CAMERA, ABOUT_EXPOSURE, ABOUT_PLACE, full_exif
from support.drawn_photos import drawn, encoded, textured
from unshutter.photo import Photo, containers
from unshutter.photo.codecs import WRITTEN

FORMATS = tuple(WRITTEN)
EXIF, GPS = 0x8769, 0x8825
XMP = (
    b'<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
    b'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"/></x:xmpmeta><?xpacket end="w"?>'
)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def tiff_with_exif(order, pixels):
    """A TIFF of grey pixels in either byte order with the tags of full_exif, put together by hand."""

    def value(content):
        if isinstance(content, str):
            return 2, content.encode() + b"\0"
        if isinstance(content, bytes):
            return 7, content
        if isinstance(content, int):
            return 4, struct.pack(order + "I", content)
        parts = content if isinstance(content, tuple) else (content,)
        return 5, b"".join(struct.pack(order + "II", part.numerator, part.denominator) for part in parts)

    def directory(tags, at):
        packed, values = struct.pack(order + "H", len(tags)), b""
        for tag, content in sorted(tags.items()):
            kind, data = value(content)
            count = len(data) // {2: 1, 4: 4, 5: 8, 7: 1}[kind]
            packed += struct.pack(order + "HHI", tag, kind, count)
            if len(data) <= 4:
                packed += data.ljust(4, b"\0")
            else:
                packed += struct.pack(order + "I", at + 2 + 12 * len(tags) + 4 + len(values))
                values += data + bytes(len(data) % 2)
        return packed + bytes(4) + values

    height, width = pixels.shape
    data = (b"II*\0" if order == "<" else b"MM\0*") + bytes(4) + pixels.tobytes()
    pointers = {}
    for tag, tags in ((EXIF, ABOUT_EXPOSURE), (GPS, ABOUT_PLACE)):
        data += bytes(len(data) % 2)
        pointers[tag] = len(data)
        data += directory(tags, len(data))
    picture = {256: width, 257: height, 258: 8, 259: 1, 262: 1, 273: 8, 277: 1, 278: height, 279: height * width}
    data += bytes(len(data) % 2)
    start = struct.pack(order + "I", len(data))
    data += directory(picture | ABOUT_CAMERA | {0x0112: 6} | pointers, len(data))
    return data[:4] + start + data[8:]


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


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("origin", FORMATS)
@pytest.mark.parametrize("target", FORMATS)
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


def test_tags_that_only_tiff_keeps_stay_there():
    tags = Image.Exif()
    tags.update(ABOUT_CAMERA | {0x4746: 4})
    tags.get_ifd(EXIF)[0xFE00] = b"of my own"
    photo = Photo.from_bytes(Photo.from_bytes(encoded(drawn(), "JPEG", exif=tags.tobytes())).to_bytes("tiff"))
    with Image.open(io.BytesIO(photo.to_bytes())) as picture:
        assert picture.getexif()[0x4746] == 4
        assert picture.getexif().get_ifd(EXIF)[0xFE00] == b"of my own"


@pytest.mark.parametrize("origin", ["jpeg", "png", "webp", "avif"])
@pytest.mark.parametrize("target", FORMATS)
def test_icc_and_xmp_go_from_every_format_to_every_other(origin, target):
    photo = Photo.from_bytes(source(origin))
    data = photo.with_pixels(photo.pixels[5:35, 3:63]).to_bytes(target)
    for _ in range(2):
        with Image.open(io.BytesIO(data)) as picture:
            assert picture.info["icc_profile"] == SRGB
            xmp = picture.info.get("xmp") or picture.info["XML:com.adobe.xmp"].encode()  # PNG: a text
            assert b"<x:xmpmeta" in xmp and b"22-rdf-syntax-ns" in xmp
        data = Photo.from_bytes(data).to_bytes()


@pytest.mark.parametrize("target", FORMATS)
@pytest.mark.parametrize("orientation", range(1, 9))
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


@pytest.mark.parametrize("orientation", range(1, 9))
def test_avif_of_other_programs_is_read_as_stored(orientation):
    pixels = textured(48, 80)
    photo = Photo.from_bytes(encoded(pixels, "AVIF", quality=95, exif=full_exif(orientation=orientation)))
    assert photo.orientation == orientation and photo.to_array().shape == (photo.height, photo.width, photo.bands)
    assert np.abs(photo.to_array().astype(int) - pixels).mean() < 8
    grey = photo.grey(24)
    assert grey.shape == (24, 40)
    assert containers.box_coding(io.BytesIO(photo.to_bytes("jpeg"))) == containers.BoxCoding()  # not one


def test_grey_avif_stays_grey_inside():
    pixels = textured(48, 80, 1)[..., 0]
    photo = Photo.from_bytes(encoded(pixels, "AVIF", quality=95))
    assert photo.bands == 1 and photo.to_array().shape == (48, 80)
    assert np.abs(photo.to_array().astype(int) - pixels).mean() < 8


@pytest.mark.parametrize(("height", "width"), [(3000, 4000), (4000, 3000)])
def test_focal_length_is_that_of_the_full_frame_diagonal(height, width):
    photo = Photo.from_bytes(encoded(np.zeros((height, width), np.uint8), "JPEG", exif=full_exif()))
    assert photo.focal_px() == pytest.approx(26 * 5000 / 43.26662, rel=1e-6)
    assert Photo.from_bytes(encoded(drawn(), "JPEG")).focal_px() is None
    tags = Image.Exif()
    tags.get_ifd(EXIF)[0xA405] = 0  # EXIF's "unknown"
    assert Photo.from_bytes(encoded(drawn(), "JPEG", exif=tags.tobytes())).focal_px() is None


def test_nothing_is_made_up():
    for format in ("JPEG", "PNG", "WEBP", "AVIF", "TIFF"):
        photo = Photo.from_bytes(encoded(drawn(), format))
        for target in ("jpeg", "png", "webp", "avif"):
            with Image.open(io.BytesIO(photo.to_bytes(target))) as picture:
                assert dict(picture.getexif()) == {} and not picture.info.get("icc_profile")


def test_resolution_and_png_texts_are_kept():
    texts = PngImagePlugin.PngInfo()
    texts.add_text("Title", "Street")
    photo = Photo.from_bytes(encoded(drawn(), "PNG", pnginfo=texts, dpi=(300, 300)))
    changed = photo.with_pixels(drawn())
    with Image.open(io.BytesIO(changed.to_bytes())) as picture:
        assert picture.info["Title"] == "Street" and picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)
    with Image.open(io.BytesIO(photo.to_bytes("tiff"))) as picture:
        assert picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)


def linear_grey_profile():
    """An ICC profile of one channel whose tones are linear in light."""
    white = b"XYZ \0\0\0\0" + struct.pack(">iii", 0xF6D6, 0x10000, 0xD32D)
    curve = b"curv\0\0\0\0" + struct.pack(">I", 0)
    tags = [(b"wtpt", white), (b"kTRC", curve)]
    table, data = struct.pack(">I", len(tags)), b""
    for name, content in tags:
        table += struct.pack(">4sII", name, 128 + 4 + 12 * len(tags) + len(data), len(content))
        data += content
    head = struct.pack(">I4sI4s4s4s", 132 + len(tags) * 12 + len(data), bytes(4), 0x02100000, b"mntr", b"GRAY", b"XYZ ")
    head += bytes(12) + b"acsp" + bytes(28) + struct.pack(">iii", 0xF6D6, 0x10000, 0xD32D)
    return head.ljust(128, b"\0") + table + data


@pytest.mark.parametrize("alpha", [False, True])
def test_grey_with_a_profile_keeps_its_tones_where_only_colour_fits(alpha):
    levels = np.linspace(0, 1, 256)[None].repeat(16, 0)
    pixels = np.round(levels * 255).astype(np.uint8)
    pixels = np.dstack([pixels, 255 - pixels]) if alpha else pixels
    picture = Image.fromarray(pixels, "LA") if alpha else Image.fromarray(pixels)
    stream = io.BytesIO()
    picture.save(stream, "PNG", icc_profile=linear_grey_profile())
    photo = Photo.from_bytes(stream.getvalue())
    with Image.open(io.BytesIO(photo.to_bytes("png"))) as kept:
        assert kept.info["icc_profile"] == linear_grey_profile() and kept.mode == ("LA" if alpha else "L")
    coloured = Photo.from_bytes(photo.to_bytes("webp", quality=100))
    srgb = np.where(levels <= 0.0031308, 12.92 * levels, 1.055 * levels ** (1 / 2.4) - 0.055) * 255
    seen = (levels > 0.05) & (levels < 0.98)
    assert np.abs(coloured.to_array()[..., 1] - srgb)[seen].max() < 5 and coloured.has_alpha == alpha
    with Image.open(io.BytesIO(photo.to_bytes("webp"))) as picture:
        assert picture.info["icc_profile"][16:20] == b"RGB "


@pytest.mark.parametrize("target", FORMATS)
def test_a_profile_of_other_channels_is_dropped(target):
    photo = Photo.from_bytes(encoded(drawn(bands=1)[..., 0], "JPEG", icc_profile=SRGB))
    data = photo.to_bytes(target)
    with Image.open(io.BytesIO(data)) as picture:
        profile = picture.info.get("icc_profile")
    assert profile is None or profile[16:20] == (b"GRAY" if Photo.from_bytes(data).bands < 3 else b"RGB ")


# ---- coding like the input's ---------------------------------------------------------------------------


@pytest.mark.parametrize("quality", [5, 30, 49, 50, 75, 87, 92, 96, 100])
@pytest.mark.parametrize(("subsampling", "expected"), [("4:4:4", 0), ("4:2:2", 0), ("4:2:0", 2)])
def test_jpeg_is_saved_in_the_quality_it_came_in(quality, subsampling, expected):
    from PIL.JpegImagePlugin import get_sampling

    data = encoded(textured(48, 80), "JPEG", quality=quality, subsampling=subsampling)
    photo = Photo.from_bytes(data)
    saved = [Image.open(io.BytesIO(d)) for d in (data, photo.to_bytes(), photo.to_bytes(quality=60))]
    before, after, told = (picture.quantization for picture in saved)
    assert after == before and told != before
    assert get_sampling(saved[1]) == expected


def test_jpeg_quality_of_every_file_pillow_writes():
    for quality in range(1, 101):
        data = encoded(drawn(8, 8), "JPEG", quality=quality)
        assert containers.jpeg_coding(io.BytesIO(data)).quality == quality
    assert containers.jpeg_coding(io.BytesIO(b"\xff\xd8\xff\xda\0\4")) == (None, False)


@pytest.mark.parametrize("lossless", [False, True])
@pytest.mark.parametrize("extended", [False, True])  # with an ICC profile the coding is behind other chunks
def test_lossless_webp_stays_lossless(lossless, extended):
    more = {"icc_profile": SRGB + bytes(1 - len(SRGB) % 2)} if extended else {}  # of odd length: padded
    photo = Photo.from_bytes(encoded(textured(48, 80), "WEBP", lossless=lossless, **more))
    changed = photo.with_pixels(~photo.pixels)
    assert np.array_equal(Photo.from_bytes(changed.to_bytes()).to_array(), changed.to_array()) == lossless
    assert not np.array_equal(Photo.from_bytes(changed.to_bytes(quality=50)).to_array(), changed.to_array())


@pytest.mark.parametrize(("compression", "expected"), [("raw", 1), ("tiff_lzw", 5), ("packbits", 8), ("jpeg", 8)])
def test_tiff_stays_uncompressed_or_lzw(compression, expected):
    photo = Photo.from_bytes(encoded(textured(48, 80), "TIFF", compression=compression))
    with Image.open(io.BytesIO(photo.to_bytes())) as picture:
        assert picture.tag_v2[259] == expected
        np.testing.assert_array_equal(np.asarray(picture), photo.to_array())
