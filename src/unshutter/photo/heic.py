"""HEIC photos, through libheif (package pi-heif, extra ``heic``).

A HEIC file holds the pixels as the sensor was read; its boxes irot and imir say how a viewer is to turn and mirror
them. libheif does that while decoding and cannot be told not to: what it gives is turned back here.

Source: ISO/IEC 23008-12 (HEIF).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.photo import colours, containers
from unshutter.photo.codecs import Codec, Coding, Source
from unshutter.photo.header import Header
from unshutter.photo.libvips import empty_image, set_blob

if TYPE_CHECKING:
    import numpy as np


def read_header(source: Source, codec: Codec) -> Header:
    """What a HEIC file says about its primary picture.

    Raises:
        UnshutterError: pi-heif is not installed, the file is damaged, or its colours are those of HDR.
    """
    picture = _primary(source)
    info = picture.info
    with source.stream() as stream:
        coding = containers.box_coding(stream)
    orientation = coding.orientation
    width, height = picture.size[::-1] if orientation >= 5 else picture.size
    about = empty_image()
    profile = info.get("icc_profile") or colours.profile_of(source, *coding.code_points)
    for name, data in (("icc-profile-data", profile), ("xmp-data", info.get("xmp"))):
        if data:
            set_blob(about, name, bytes(data))
    bands = len(picture.mode.partition(";")[0])
    own = Coding(subsampled=info.get("chroma") == 420, bits=info["bit_depth"], orientation=orientation)
    return Header(codec, own, height, width, bands, orientation, about, info.get("exif"))


def turned_pixels(source: Source) -> np.ndarray:
    """[H, W, bands] uint8 or uint16 of the primary picture, turned and mirrored as the file asks.

    Raises:
        UnshutterError: damaged or incomplete.
    """
    import numpy as np

    picture = _primary(source)
    try:
        pixels = np.array(picture)  # copied: what pi-heif gives goes with its picture
    except Exception as error:  # libheif's, by whatever class pi-heif gives them
        raise UnshutterError(f"{source} is damaged or incomplete: {_cause(error)}") from None
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    if picture.mode.partition(";")[0].endswith("a"):
        top = np.iinfo(pixels.dtype).max
        opacity = np.maximum(pixels[..., -1:], 1) / top
        colours = np.minimum(np.round(pixels[..., :-1] / opacity), top).astype(pixels.dtype)
        pixels = np.concatenate([colours, pixels[..., -1:]], axis=2)
    pixels.setflags(write=False)
    return pixels


def _primary(source: Source) -> Any:
    try:
        import pi_heif
    except ImportError:
        raise UnshutterError(f"{source} is a HEIC photo: to read it, pip install 'unshutter[heic]'") from None
    try:
        with source.stream() as stream:
            if not containers.item_names_are_text(stream):
                raise ValueError("names of its parts are no text")
            file = pi_heif.open_heif(stream, convert_hdr_to_8bit=False)
            if not len(file):
                raise ValueError("it holds no picture")
            return file[file.primary_index]
    except OSError as error:
        if error.strerror:
            raise
        raise UnshutterError(f"{source} is a HEIC photo, damaged, incomplete or unusual: {_cause(error)}") from None
    except Exception as error:
        raise UnshutterError(f"{source} is a HEIC photo, damaged, incomplete or unusual: {_cause(error)}") from None


def _cause(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
