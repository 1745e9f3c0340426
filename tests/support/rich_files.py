"""Photos in every format with all the metadata that each can have, written by other programs than unshutter."""

import io
import struct
from functools import cache

import cv2
import numpy as np
import pyvips
from PIL import Image, ImageCms
from PIL.PngImagePlugin import PngInfo

from support.camera_files import dng, heic, linear
from support.drawn_photos import drawn, encoded
from support.tagged_files import TITLE, image_resources, jpeg_with, small_jpeg
from unshutter.photo import Photo
from unshutter.photo.exif import add_to_tiff

HEIGHT, WIDTH = 96, 160
COLUMNS = {"JPEG": ".jpg", "PNG": ".png", "WebP": ".webp", "TIFF": ".tif", "AVIF": ".avif", "HEIC": ".heic"}
RAW = "raw (DNG)"
COLUMNS[RAW] = ".dng"

EXIF, GPS, ORIENTATION, MAKER_NOTE = 0x8769, 0x8825, 0x0112, 0x927C
NOTE = b"Acme\0" + bytes(range(200))
DATE = "2024:05:06 07:08:09"
ICC = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
RESOURCES = image_resources((1028, TITLE), (1036, bytes(28) + small_jpeg()))
XMP = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmp:Rating="4" tiff:ImageWidth="160"><xmp:Thumbnails>picture</xmp:Thumbnails>'
    b"</rdf:Description></rdf:RDF></x:xmpmeta>"
)

RAW_TAGS = {700: XMP, 33723: TITLE, 34377: RESOURCES}


def exif(orientation: int) -> Image.Exif:
    tags = Image.Exif()
    tags.update({0x010F: "Acme", 0x0132: DATE, ORIENTATION: orientation})
    tags.get_ifd(EXIF).update({0x9003: DATE, MAKER_NOTE: NOTE, 0xA002: WIDTH, 0xA003: HEIGHT})
    tags.get_ifd(GPS).update({1: "N", 2: (48.0, 51.0, 29.5)})
    return tags


def exif_with_thumbnail(orientation: int) -> bytes:
    """The same with a thumbnail in a second directory."""
    blob, thumbnail = exif(orientation).tobytes(), small_jpeg()
    order = {b"II": "<", b"MM": ">"}[blob[6:8]]
    (count,) = struct.unpack_from(order + "H", blob, 14)
    link, at = 16 + 12 * count, len(blob) - 6
    second = struct.pack(order + "HHHIHH", 3, 0x0103, 3, 1, 6, 0)
    second += struct.pack(order + "HHIIHHIII", 0x0201, 4, 1, at + 42, 0x0202, 4, 1, len(thumbnail), 0)
    return blob[:link] + struct.pack(order + "I", at) + blob[link + 4 :] + second + thumbnail


# ---- files that have everything ------------------------------------------------------------------------------


@cache
def rich_file(column: str, orientation: int = 6) -> bytes:
    """A photo with all the metadata that its format can have."""
    pixels, blob = drawn(HEIGHT, WIDTH), exif_with_thumbnail(orientation)
    if column == "JPEG":
        return jpeg_with(pixels, (0xED, b"Photoshop 3.0\0" + RESOURCES), exif=blob, icc_profile=ICC, xmp=XMP)
    if column == "PNG":
        texts = PngInfo()
        texts.add_itxt("XML:com.adobe.xmp", XMP.decode())
        texts.add_text("Creation Time", "© Müller")
        texts.add_text("Raw profile type iptc", f"\niptc\n{len(RESOURCES):8}\n{RESOURCES.hex()}\n", zip=True)
        return encoded(pixels, "PNG", exif=blob, icc_profile=ICC, pnginfo=texts)
    if column == "TIFF":
        tags = exif(orientation)
        own = {700: XMP, 33723: TITLE, 34377: RESOURCES, EXIF: dict(tags.get_ifd(EXIF)), GPS: dict(tags.get_ifd(GPS))}
        return encoded(pixels, "TIFF", icc_profile=ICC, tiffinfo=dict(tags) | own)
    if column == "HEIC":
        return heic(pixels, exif=blob, icc_profile=ICC, icc_profile_type="prof", xmp=XMP)
    if column == RAW:
        own = [(306, 2, 0, DATE, True), *((tag, 1, len(value), value, True) for tag, value in RAW_TAGS.items())]
        stream = io.BytesIO(dng(linear(pixels), orientation, tags=own))
        add_to_tiff(stream, blob, HEIGHT, WIDTH)
        return stream.getvalue()
    if column == "AVIF" and orientation == 1:  # Pillow loses the thumbnail
        return Photo.from_bytes(rich_file("JPEG", 1)).to_bytes("avif")
    return encoded(pixels, column.upper(), exif=blob, icc_profile=ICC, xmp=XMP)


def file_of(column: str, pixels: np.ndarray, **options) -> bytes | None:
    """A plain photo of such pixels; None where the format has no such."""
    bands, deep = pixels.shape[2], pixels.dtype == np.uint16
    if column == "HEIC":
        return None if bands == 2 else heic(pixels[..., 0] if bands == 1 else pixels, **options)
    if column == RAW:
        return dng(linear(pixels / 257)) if deep and bands == 3 else None
    if column == "AVIF" and deep:
        avif = pyvips.Image.new_from_array(pixels).copy(interpretation="rgb16")
        return avif.heifsave_buffer(compression="av1", **options)
    if (deep and column not in ("PNG", "TIFF")) or (column == "JPEG" and bands in (2, 4)):
        return None
    if deep:
        order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[bands]
        return cv2.imencode(COLUMNS[column], pixels[..., order])[1].tobytes()
    return encoded(pixels[..., 0] if bands == 1 else pixels, column.upper(), **options)
