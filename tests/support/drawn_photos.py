"""Pictures and files that the tests draw for themselves."""

import io

import cv2
import numpy as np
from PIL import Image


def drawn(height=48, width=80, bands=3, dtype=np.uint8):
    """Smooth colours, from dark to bright; alpha from half to opaque."""
    row, col = np.mgrid[0:height, 0:width]
    waves = [np.sin(row / 9 + k) * np.cos(col / (11 + k)) for k in range(bands)]
    picture = np.stack(waves, axis=-1) * 0.45 + 0.5
    if bands in (2, 4):
        picture[..., -1] = 0.5 + 0.5 * col / width
    top = np.iinfo(dtype).max
    return np.round(picture * top).astype(dtype).reshape(height, width, bands)


def encoded(pixels, format, **options):
    """A file of uint8 pixels, by Pillow."""
    stream = io.BytesIO()
    mode = {"CMYK": "CMYK"}.get(options.pop("mode", None))
    picture = Image.frombytes(mode, pixels.shape[1::-1], pixels.tobytes()) if mode else Image.fromarray(pixels)
    picture.save(stream, format, **options)
    return stream.getvalue()


def textured(height, width, bands=3, dtype=np.uint8):
    """Soft blobs of all sizes down to a few pixels, as photos have."""
    random = np.random.default_rng(3)
    picture = np.zeros((height, width, bands))
    for cells in (4, 16, 64):
        noise = random.normal(size=(cells, cells * 2, bands)).astype(np.float32)
        picture += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC).reshape(picture.shape) / cells**0.5
    picture = (picture - picture.min()) / (picture.max() - picture.min())
    return np.round(picture * np.iinfo(dtype).max).astype(dtype)


def one_line(error):
    """The message of a caught error, which is to be one line."""
    message = str(error.value)
    assert message and "\n" not in message and "Traceback" not in message
    return message
