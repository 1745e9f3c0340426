"""Pixels of arrays and Pillow images, which may be given instead of a photo."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TypeGuard

from unshutter.errors import UnshutterError

if TYPE_CHECKING:
    import numpy as np
    from PIL.Image import Image

_TYPES = "a path, bytes, a file opened in binary mode, an array, a Pillow image or a Photo"
_PILLOW_MODES = ("L", "LA", "RGB", "RGBA", "I;16")


def is_pillow(argument: object) -> TypeGuard[Image]:
    """Whether the argument is a Pillow image; if it is, Pillow has been imported already."""
    module = sys.modules.get("PIL.Image")
    return module is not None and isinstance(argument, module.Image)


def pixels_of(argument: object) -> tuple[np.ndarray, np.ndarray | Image]:
    """Returns uint8 or uint16 pixels of an array or a Pillow image, and that."""
    import numpy as np

    if is_pillow(argument):
        if argument.mode not in _PILLOW_MODES:
            message = f"a Pillow image of mode {argument.mode} is not supported: convert it first, image.convert('RGB')"
            raise UnshutterError(message)
        return np.asarray(argument), argument
    array = np.asarray(argument)
    if array.ndim == 0 or array.dtype == object or array.dtype.kind in "SU":
        raise UnshutterError(f"a photo is {_TYPES}; got {type(argument).__name__}")
    if array.dtype in (np.uint8, np.uint16):
        return array, array
    if array.dtype.kind != "f":
        allowed = "uint8, uint16, or floating point from 0 to 1"
        raise UnshutterError(f"a photo needs pixels of type {allowed}, got {array.dtype}")
    if not (array.size and array.min() >= 0 and array.max() <= 1):  # also raised for NaN
        raise UnshutterError("pixels in floating point must lie between 0 and 1: scale them first, pixels / 255")
    scaled = np.multiply(array, 65535, dtype=np.result_type(array, np.float32))  # not float16
    return np.rint(scaled).astype(np.uint16), array
