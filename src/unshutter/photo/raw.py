"""Cameras' raw files, developed through LibRaw (package rawpy, extra ``raw``).

Developed plainly, so that photos of a series stay comparable: the camera's white balance, no brightening, sRGB, 16
bits. Rows stay rows of the sensor: LibRaw is kept from turning the picture, and knows no lens corrections.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.photo import metadata, resources
from unshutter.photo.codecs import Codec, Coding, Source
from unshutter.photo.header import Header
from unshutter.photo.libvips import empty_image, libvips, set_blob
from unshutter.photo.raw_tags import read_tags

if TYPE_CHECKING:
    import numpy as np

# LibRaw's flip (1: left-right, 2: top-bottom, 4: then transposed) -> EXIF orientation
_ORIENTATION = {0: 1, 1: 2, 2: 4, 3: 3, 4: 5, 5: 8, 6: 6, 7: 7}
_SRGB_CURVE = (2.4, 12.92)


def read_header(source: Source, codec: Codec) -> Header:
    """What a raw file says about its picture.

    Raises:
        UnshutterError: rawpy is not installed, or LibRaw does not know the file's kind.
    """
    with _open(source) as raw:
        sizes = raw.sizes
    orientation = _ORIENTATION.get(sizes.flip, 1)
    with source.stream() as stream:
        tree = read_tags(stream)
    about = empty_image()
    set_blob(about, "icc-profile-data", libvips().Image.profile_load("srgb"))
    if tree is not None and (xmp := tree.data(metadata.XMP)):
        set_blob(about, "xmp-data", xmp)
    if tree is not None and (blocks := resources.of_tiff(tree)) is not None:
        set_blob(about, "iptc-data", blocks)
    exif = metadata.exif_of_tiff(tree) if tree else None
    return Header(codec, Coding(bits=16), sizes.iheight, sizes.iwidth, 3, orientation, about, exif)


def developed(source: Source, height: int, width: int) -> np.ndarray:
    """[H, W, 3] uint16 of the sensor's rows.

    Raises:
        UnshutterError: damaged or incomplete.
    """
    import rawpy

    with _open(source) as raw:
        raw.unpack()
        pixels = raw.postprocess(
            rawpy.Params(
                user_flip=0,
                output_bps=16,
                use_camera_wb=True,
                no_auto_bright=True,
                gamma=_SRGB_CURVE,
                output_color=rawpy.ColorSpace.sRGB,
            )
        )
    if pixels.shape != (height, width, 3):
        raise UnshutterError(f"{source} cannot be developed: LibRaw turned or cut it")
    return pixels


@contextmanager
def _open(source: Source) -> Iterator[Any]:
    try:
        import rawpy
    except ImportError:
        raise UnshutterError(f"{source} is a camera's raw file: to read it, pip install 'unshutter[raw]'") from None
    try:
        with source.stream() as stream, rawpy.RawPy() as raw:
            raw.open_buffer(stream)
            yield raw
    except (rawpy.LibRawError, rawpy.NotSupportedError, ValueError) as error:
        told = error.args[0] if error.args else type(error).__name__
        cause = told.decode(errors="replace") if isinstance(told, bytes) else str(told)
        raise UnshutterError(f"cannot read {source} as a camera's raw file: {cause}") from None
