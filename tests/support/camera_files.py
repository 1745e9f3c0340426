"""HEIC and raw files, made on the fly; and pictures turned as EXIF's orientations say."""

import io

import numpy as np
import pytest

from support.drawn_photos import drawn
from support.tagged_files import exif_blob

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


def soft(height=120, width=160) -> np.ndarray:
    """Soft colours with some white: LibRaw takes the brightest for white if it is near."""
    pixels = drawn(height, width)
    pixels[:8, :8] = 255
    return pixels
