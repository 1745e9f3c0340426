"""Files as cameras and editors write them, made on the fly; and pictures turned as EXIF's orientations say."""

import io
import struct

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from support.drawn_photos import encoded

ORIENTATIONS = range(1, 9)
# Stored pixels of what a viewer is to show, by the EXIF standard: which of its sides are row 0 and column 0.
AS_STORED = {
    1: lambda upright: upright,
    2: lambda upright: upright[:, ::-1],
    3: lambda upright: upright[::-1, ::-1],
    4: lambda upright: upright[::-1],
    5: lambda upright: upright.swapaxes(0, 1),
    6: lambda upright: upright[:, ::-1].swapaxes(0, 1),  # row 0 is the right side, column 0 the top
    7: lambda upright: upright[::-1, ::-1].swapaxes(0, 1),
    8: lambda upright: upright[::-1].swapaxes(0, 1),  # row 0 is the left side, column 0 the bottom
}
MIRRORED = (2, 4, 5, 7)


def exif_blob(orientation=1, **tags):
    """An EXIF blob by Pillow, with tags of the first directory by number."""
    exif = Image.Exif()
    exif.update({0x010F: "Acme", 0x0112: orientation} | {int(tag): value for tag, value in tags.items()})
    return exif.tobytes()


ABOUT_CAMERA = {0x010F: "Acme", 0x0110: "Model 1", 0x0131: "1.0", 0x0132: "2024:05:06 07:08:09", 0x8298: "(c) me"}
ABOUT_EXPOSURE = {
    0x829A: IFDRational(1, 125),
    0x9003: "2024:05:06 07:08:09",
    0x9010: "+02:00",
    0x920A: IFDRational(425, 100),
    0x927C: b"Acme\0\1\2" + bytes(range(100)),
    0x9286: b"ASCII\0\0\0a comment",
    0xA405: 26,
    0xA434: "Lens 24-70 mm",
}
ABOUT_PLACE = {
    1: "N",
    2: (IFDRational(48), IFDRational(51), IFDRational(2949, 100)),
    3: "E",
    4: (IFDRational(2), IFDRational(17), IFDRational(4021, 100)),
    6: IFDRational(351, 10),
}


def full_exif(order="<", orientation=6):
    """An EXIF blob by Pillow, in either byte order, with the tags above."""
    tags = Image.Exif()
    tags.endian = order
    tags.update(ABOUT_CAMERA | {0x0112: orientation})
    tags.get_ifd(0x8769).update(ABOUT_EXPOSURE | {0xA002: 4000, 0xA003: 3000})  # EXIF
    tags.get_ifd(0x8825).update(ABOUT_PLACE)  # GPS
    blob = tags.tobytes()
    assert blob[6:8] == (b"II" if order == "<" else b"MM")
    return blob


def heic(pixels, orientation=1, exif=None, quality=95, chroma=444, **info):
    """A HEIC file of stored pixels, uint8 or uint16 (kept in 10 bits), whose boxes ask for an orientation."""
    encoder = pytest.importorskip("pillow_heif", reason="writing HEIC for the tests needs pillow-heif")
    pytest.importorskip("pi_heif", reason="reading HEIC needs the extra heic")
    mode = {1: "L", 3: "RGB", 4: "RGBA"}[pixels.shape[2] if pixels.ndim == 3 else 1]
    deep = pixels.dtype == np.uint16
    data = np.ascontiguousarray(pixels).tobytes()
    picture = encoder.from_bytes(mode + ";16" * deep, pixels.shape[1::-1], data)
    picture.info.update(info)
    stream = io.BytesIO()
    picture.save(stream, quality=quality, chroma=chroma, exif=exif or exif_blob(orientation))
    return stream.getvalue()


def dng(colours, orientation=1, tags=()):
    """A raw file that LibRaw develops: an uncompressed 12-bit Bayer mosaic (RGGB) of colours [H, W, 3] in 0 ... 1."""
    pytest.importorskip("rawpy", reason="reading raw files needs the extra raw")
    tifffile = pytest.importorskip("tifffile", reason="writing raw files for the tests needs tifffile")
    height, width = colours.shape[:2]
    row, col = np.mgrid[0:height, 0:width]
    mosaic = np.take_along_axis(colours, (row % 2 + col % 2)[..., None], axis=2)[..., 0]
    unit = (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1)
    # camera colours that are sRGB's: XYZ (D65) -> linear sRGB
    matrix = (32405, -15371, -4985, -9693, 18760, 416, 556, -2040, 10572)
    about = [
        (33421, 3, 2, (2, 2), True),  # CFA repeats every 2 x 2
        (33422, 1, 4, bytes([0, 1, 1, 2]), True),
        (50706, 1, 4, bytes([1, 4, 0, 0]), True),
        (50707, 1, 4, bytes([1, 1, 0, 0]), True),
        (50708, 2, 0, "Acme One", True),
        (50714, 3, 1, 0, True),  # black
        (50717, 4, 1, 4095, True),  # white
        (50721, 10, 9, sum(((value, 10000) for value in matrix), ()), True),
        (50728, 5, 3, unit[:2] * 3, True),  # neutral
        (50778, 3, 1, 21, True),  # D65
        (274, 3, 1, orientation, True),
        (271, 2, 0, "Acme", True),
        (272, 2, 0, "One", True),
        *tags,
    ]
    stream = io.BytesIO()
    picture = np.round(mosaic * 4095).astype(np.uint16)
    tifffile.imwrite(stream, picture, photometric=32803, extratags=about, metadata=None, software=False)
    return stream.getvalue()


def linear(pixels):
    """Light of sRGB values, uint8 -> 0 ... 1."""
    share = pixels / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def jpeg_thumbnail(exif):
    """The thumbnail that an EXIF blob holds, as a picture; None without one."""
    tiff = exif.removeprefix(b"Exif\0\0")
    order = {b"II": "<", b"MM": ">"}[tiff[:2]]
    (first,) = struct.unpack_from(order + "I", tiff, 4)
    (count,) = struct.unpack_from(order + "H", tiff, first)
    (second,) = struct.unpack_from(order + "I", tiff, first + 2 + 12 * count)
    if not second:
        return None
    (count,) = struct.unpack_from(order + "H", tiff, second)
    entries = (struct.unpack_from(order + "HHII", tiff, second + 2 + 12 * i) for i in range(count))
    tags = {tag: value for tag, _, _, value in entries}
    return Image.open(io.BytesIO(tiff[tags[0x0201] : tags[0x0201] + tags[0x0202]]))


def small_jpeg() -> bytes:
    """A thumbnail: red, which no picture here is."""
    stream = io.BytesIO()
    Image.new("RGB", (160, 120), (200, 10, 10)).save(stream, "JPEG")
    return stream.getvalue()


def blob_with_thumbnail(order: str = "<") -> bytes:
    """An EXIF blob, put together by hand, with a thumbnail in its second directory."""
    thumbnail = small_jpeg()
    first = struct.pack(order + "HHHIHHI", 1, 0x0112, 3, 1, 1, 0, 26)
    second = struct.pack(order + "HHHIHH", 3, 0x0103, 3, 1, 6, 0)
    second += struct.pack(order + "HHIIHHIII", 0x0201, 4, 1, 26 + 42, 0x0202, 4, 1, len(thumbnail), 0)
    head = b"II*\0" if order == "<" else b"MM\0*"
    return b"Exif\0\0" + head + struct.pack(order + "I", 8) + first + second + thumbnail


def image_resources(*kinds_and_data: tuple[int, bytes]) -> bytes:
    """Photoshop's image resource blocks."""
    blocks = (
        b"8BIM" + struct.pack(">HHI", kind, 0, len(data)) + data + bytes(len(data) % 2) for kind, data in kinds_and_data
    )
    return b"".join(blocks)


TITLE = b"\x1c\x02\x05\0\x06Street"  # an IPTC record


def jpeg_with(pixels: np.ndarray, *segments: tuple[int, bytes], **options) -> bytes:
    data = encoded(pixels, "JPEG", **options)
    added = (struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content for marker, content in segments)
    return data[:2] + b"".join(added) + data[2:]
