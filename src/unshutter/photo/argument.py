"""Converts the photo argument of Python functions to a Photo, and resulting pixels back to the argument's type."""

from __future__ import annotations

import os
import sys
from typing import Any

from unshutter.errors import UnshutterError
from unshutter.photo.photo import Photo

SMALLEST_SIDE = 64  # px
_TYPES = "a path, bytes, a file opened in binary mode, an array, a Pillow image or a Photo"
_PILLOW_MODES = ("L", "LA", "RGB", "RGBA", "I;16")


def open_photo(argument: Any) -> Photo:
    """Opens the photo that an argument represents.

    Args:
        argument: a path; an encoded file as bytes, or open in binary mode; pixels [H, W] or [H, W, 1..4], uint8,
            uint16, or floating point from 0 to 1 (converted to 16 bits); a Pillow image, of which only the pixels
            are used; or a Photo.

    Raises:
        UnshutterError: the argument is none of these, or not a photo.
    """
    if isinstance(argument, Photo):
        return argument
    if isinstance(argument, (str, os.PathLike)):
        return Photo.open(argument)
    if is_bytes(argument):
        return Photo.from_bytes(bytes(argument))
    if is_stream(argument):
        data = argument.read()
        if not isinstance(data, bytes):
            raise UnshutterError("the file is open in text mode: open it in binary mode ('rb')")
        return Photo.from_bytes(data)
    return Photo.from_array(_pixels(argument))


def check_size(height: int, width: int, subject: str = "the photo", **files: object) -> None:
    """Checks that a picture is large enough to find or undo a motion.

    Args:
        height, width: size of the picture [px].
        subject: name of the picture in the message, with fields in braces for files.

    Raises:
        UnshutterError: the picture is too small.
        files: see :class:`unshutter.UnshutterError`.
    """
    if min(height, width) < SMALLEST_SIDE:
        size = f"{width}x{height} px"
        raise UnshutterError(f"{subject} is {size}; both sides must be at least {SMALLEST_SIDE} px", **files)


def is_bytes(argument: Any) -> bool:
    """Whether the argument is an encoded file in memory."""
    return isinstance(argument, (bytes, bytearray, memoryview))


def is_stream(argument: Any) -> bool:
    """Whether the argument is an open file."""
    return callable(getattr(argument, "read", None))


def is_file(argument: Any) -> bool:
    """Whether the argument stands for a file, which has a name and a format, rather than for pixels."""
    return isinstance(argument, (str, os.PathLike, Photo)) or is_stream(argument)


def in_kind(argument: Any, pixels: Any) -> Any:
    """Converts new pixels to the type of the original argument.

    Args:
        argument: an array or a Pillow image, see :func:`open_photo`.
        pixels: new pixels, [H, W] or [H, W, 1..4], uint8 or uint16; None: the pixels are unchanged.

    Returns:
        An array of the same type and number of dimensions, or a Pillow image of the same mode with the same ``info``.
    """
    import numpy as np

    if _is_pillow(argument):
        if pixels is None:
            return argument.copy()
        image = sys.modules["PIL.Image"].fromarray(pixels)
        image.info = dict(argument.info)
        return image
    old = np.asarray(argument)
    if pixels is None:
        return old.copy()
    if old.dtype.kind == "f":
        pixels = (pixels / 65535).astype(old.dtype)
    return pixels.reshape(*pixels.shape[:2], *old.shape[2:])


def _is_pillow(argument: Any) -> bool:
    """Whether the argument is a Pillow image; if it is, Pillow has been imported already."""
    module = sys.modules.get("PIL.Image")
    return module is not None and isinstance(argument, module.Image)


def _pixels(argument: Any) -> Any:
    """Returns uint8 or uint16 pixels of an array or a Pillow image.

    Raises:
        UnshutterError: it is neither, an image of another mode, or floating point outside 0 to 1.
    """
    import numpy as np

    if _is_pillow(argument):
        if argument.mode not in _PILLOW_MODES:
            message = f"a Pillow image of mode {argument.mode} is not taken: convert it first, image.convert('RGB')"
            raise UnshutterError(message)
        return np.asarray(argument)
    array = np.asarray(argument)
    if array.dtype == object or array.dtype.kind in "SU":
        raise UnshutterError(f"a photo is {_TYPES}; got {type(argument).__name__}")
    if array.dtype.kind != "f":
        return array
    if not (array.size and array.min() >= 0 and array.max() <= 1):  # also raised for NaN
        raise UnshutterError("pixels in floating point must lie between 0 and 1: scale them first, pixels / 255")
    return np.rint(array * 65535).astype(np.uint16)
