"""Pixels and metadata into files: what a format can hold of a picture, and how it is encoded."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from unshutter.errors import UnshutterError
from unshutter.photo import metadata, new_pixels, resources
from unshutter.photo.codecs import Codec, Coding
from unshutter.photo.embedding import embed_exif
from unshutter.photo.libvips import field, libvips, set_blob, standard, to_8_bits

if TYPE_CHECKING:
    import pyvips

_CLASSIC_TIFF_BYTES = 3_500_000_000
_THUMBNAIL_SIDE = 160  # px
# Metadata that go from a photo to its successor, by libvips's names; EXIF is handled by itself.
_CARRIED = ("icc-profile-data", "xmp-data", "iptc-data", "resolution-unit", "image-description")
_KEEP_EXIF, _KEEP_XMP, _KEEP_IPTC, _KEEP_ICC, _KEEP_OTHER = 1, 2, 4, 8, 16  # libvips's flags
_KEEP = _KEEP_XMP | _KEEP_IPTC | _KEEP_ICC | _KEEP_OTHER


def dress(
    image: pyvips.Image, header: pyvips.Image, exif: bytes | None, orientation: int, is_new: bool
) -> pyvips.Image:
    """The pixels of one image with the metadata of another, and none of their own.

    Args:
        image: pixels.
        header: ICC profile, XMP, IPTC, resolution.
        exif: EXIF blob.
        orientation: EXIF orientation 1-8.
        is_new: whether the pixels are others than the metadata's, so that thumbnails must be made anew, or go.
    """
    image = image.copy(xres=header.xres, yres=header.yres)
    types = libvips().GValue
    for name in image.get_fields():
        if name.startswith("exif-") or image.get_typeof(name) == types.blob_type:
            image.remove(name)
    for name in header.get_fields():
        if name in _CARRIED or name.startswith("png-comment-"):
            image.set_type(header.get_typeof(name), name, header.get(name))
    exif = _exif_of(image, exif, orientation, is_new)
    if exif is not None:
        set_blob(image, "exif-data", exif)
    if (xmp := field(image, "xmp-data")) is not None:
        xmp = new_pixels.xmp_for(xmp, image.height, image.width, orientation)
        set_blob(image, "xmp-data", new_pixels.xmp_without_pictures(xmp) if is_new else xmp)
    if is_new and (blocks := field(image, "iptc-data")) is not None:
        set_blob(image, "iptc-data", resources.without_thumbnails(blocks))
    image.set_type(types.gint_type, "orientation", orientation)
    return image


def _exif_of(image: pyvips.Image, exif: bytes | None, orientation: int, is_new: bool) -> bytes | None:
    if exif is not None:
        exif = new_pixels.exif_with_size(exif, image.height, image.width)
        if is_new and new_pixels.has_thumbnail(exif):
            exif = new_pixels.exif_with_thumbnail(exif, _thumbnail(image), orientation)
    return new_pixels.exif_with_orientation(exif, orientation)


def _thumbnail(image: pyvips.Image) -> bytes:
    """A JPEG of at most 160 px."""
    small = image.flatten() if image.hasalpha() else image
    small = small.resize(min(_THUMBNAIL_SIDE / max(small.width, small.height), 1.0), kernel="linear")
    return to_8_bits(small).jpegsave_buffer(Q=80, keep=0)


def fit(image: pyvips.Image, codec: Codec) -> pyvips.Image:
    """What of the pixels a format can hold: depth, alpha (else over black), one channel (else three).

    Raises:
        UnshutterError: too large for the format.
    """
    if max(image.width, image.height) > codec.longest_side:
        raise UnshutterError(
            f"a picture of {image.width}x{image.height} px does not fit into {codec.name.upper()}, "
            f"which ends at {codec.longest_side} px: choose another format"
        )
    if image.hasalpha() and not codec.alpha:
        image = image.flatten()
    if not codec.deep:
        image = to_8_bits(image)
    if image.bands > 2 or codec.grey:
        return image
    grey, alpha = image[0], image[1:] if image.bands == 2 else None
    profile = field(image, "icc-profile-data")
    if profile is not None and profile[16:20] == b"GRAY":  # its tones would be lost with it
        colour = standard(grey).icc_transform("srgb", embedded=True, depth=16 if image.format == "ushort" else 8)
    else:
        colour = grey.bandjoin([grey, grey])
    return standard(colour if alpha is None else colour.bandjoin(alpha))


def encode(
    image: pyvips.Image, codec: Codec, coding: Coding, quality: int | None, path: Path | None = None
) -> bytes | None:
    """Encodes pixels that :func:`fit` into a file, or into bytes without ``path``; ``pyvips.Error`` on failure.

    EXIF comes later, by :func:`add_metadata`; WebP and AVIF get some that keeps its place.
    """
    if codec.name == "tiff":
        image = image.copy()
        image.remove("iptc-data")
    keeps_place = field(image, "exif-data") is not None and codec.name in ("webp", "avif", "tiff")
    options = _options(image, codec, coding, quality) | {"keep": _KEEP | _KEEP_EXIF if keeps_place else _KEEP}
    if path is None:
        return getattr(image, codec.save + "_buffer")(**options)
    return getattr(image, codec.save)(os.fsencode(path), **options)


def add_metadata(file: BinaryIO, image: pyvips.Image, codec: Codec) -> None:
    """Puts EXIF, and what else libvips does not write well, into an encoded file, open for reading and writing."""
    exif = field(image, "exif-data")
    if codec.name == "tiff":
        more = resources.tiff_tags(field(image, "iptc-data", b""))
        metadata.add_exif_to_tiff(file, exif, image.height, image.width, more)
    elif exif is not None:
        embed_exif(file, codec.name, metadata.shortened(exif) if codec.name == "jpeg" else exif)


def _options(image: pyvips.Image, codec: Codec, coding: Coding, quality: int | None) -> dict[str, Any]:
    chroma = "on" if coding.subsampled else "off"
    bits = 16 if image.format == "ushort" else 8
    if codec.name == "jpeg":
        return {"Q": quality or coding.quality or 95, "subsample_mode": chroma}
    if codec.name == "png":
        return {"filter": "all", "bitdepth": bits, "palette": False}
    if codec.name == "webp":
        lossless = coding.lossless and quality is None
        return {"lossless": True, "exact": True} if lossless else {"Q": quality or 90}
    if codec.name == "tiff":
        size = image.width * image.height * image.bands * bits // 8
        compression = {1: "none", 5: "lzw"}.get(coding.compression or 0, "deflate")
        options = {"compression": compression, "bigtiff": size > _CLASSIC_TIFF_BYTES}
        return options if compression == "none" else options | {"predictor": "horizontal"}
    deep = coding.bits if coding.bits in (10, 12) else 12
    # effort 2: seven times as fast as the default at two per cent more bytes
    return {
        "compression": "av1",
        "Q": quality or 80,
        "effort": 2,
        "bitdepth": deep if bits == 16 else 8,
        "subsample_mode": chroma,
    }
