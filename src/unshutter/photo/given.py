"""What users of Python hand over as a photo, and pixels handed back in kind."""

from __future__ import annotations

import os
import sys
from typing import Any

from unshutter.errors import UnshutterError
from unshutter.photo.photo import Photo

_TAKEN = "a path, bytes, a file opened in binary mode, an array, a Pillow image or a Photo"
_PILLOW_MODES = ("L", "LA", "RGB", "RGBA", "I;16")


def opened(given: Any) -> Photo:
    """The photo that is meant.

    Args:
        given: a path; an encoded file as bytes, or open in binary mode; pixels [H, W] or [H, W, 1..4], uint8, uint16,
            or floating point from 0 to 1 (which become 16 bits); a Pillow image, of which only the pixels count; or
            a Photo.

    Raises:
        UnshutterError: something else, or no photo.
    """
    if isinstance(given, Photo):
        return given
    if isinstance(given, (str, os.PathLike)):
        return Photo.open(given)
    if is_bytes(given):
        return Photo.from_bytes(bytes(given))
    if is_stream(given):
        data = given.read()
        if not isinstance(data, bytes):
            raise UnshutterError("the file is open in text mode: open it in binary mode ('rb')")
        return Photo.from_bytes(data)
    return Photo.from_array(_pixels(given))


def is_bytes(given: Any) -> bool:
    """Whether it is an encoded file in memory."""
    return isinstance(given, (bytes, bytearray, memoryview))


def is_stream(given: Any) -> bool:
    """Whether it is an open file."""
    return callable(getattr(given, "read", None))


def is_file(given: Any) -> bool:
    """Whether it stands for a file, which has a name and a format, rather than for pixels."""
    return isinstance(given, (str, os.PathLike, Photo)) or is_stream(given)


def in_kind(given: Any, pixels: Any) -> Any:
    """New pixels as what the old ones came as.

    Args:
        given: an array or a Pillow image, see :func:`opened`.
        pixels: the new ones, [H, W] or [H, W, 1..4], uint8 or uint16; None: the old ones are unchanged.

    Returns:
        An array of the same type and number of dimensions, or a Pillow image of the same mode with the same ``info``.
    """
    import numpy as np

    if _is_pillow(given):
        if pixels is None:
            return given.copy()
        image = sys.modules["PIL.Image"].fromarray(pixels)
        image.info = dict(given.info)
        return image
    old = np.asarray(given)
    if pixels is None:
        return old.copy()
    if old.dtype.kind == "f":
        pixels = (pixels / 65535).astype(old.dtype)
    return pixels.reshape(*pixels.shape[:2], *old.shape[2:])


def _is_pillow(given: Any) -> bool:
    """Whether it is a Pillow image; who has one has imported Pillow."""
    module = sys.modules.get("PIL.Image")
    return module is not None and isinstance(given, module.Image)


def _pixels(given: Any) -> Any:
    """uint8 or uint16 pixels of an array or a Pillow image.

    Raises:
        UnshutterError: neither, an image of another mode, or floating point that is not from 0 to 1.
    """
    import numpy as np

    if _is_pillow(given):
        if given.mode not in _PILLOW_MODES:
            told = f"a Pillow image of mode {given.mode} is not taken: convert it first, image.convert('RGB')"
            raise UnshutterError(told)
        return np.asarray(given)
    array = np.asarray(given)
    if array.dtype == object or array.dtype.kind in "SU":
        raise UnshutterError(f"a photo is {_TAKEN}; got {type(given).__name__}")
    if array.dtype.kind != "f":
        return array
    if not (array.size and array.min() >= 0 and array.max() <= 1):  # not so for NaN either
        raise UnshutterError("pixels in floating point must lie between 0 and 1: scale them first, pixels / 255")
    return np.rint(array * 65535).astype(np.uint16)
