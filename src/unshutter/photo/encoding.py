"""Pixels and metadata into files, as far as it is the same for all formats."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from unshutter.errors import UnshutterError
from unshutter.photo.format import Coding, WrittenFormat
from unshutter.photo.libvips import field, libvips, refusing, standard, to_8_bits
from unshutter.photo.metadata import Metadata
from unshutter.photo.tags import exif, iptc, xmp

if TYPE_CHECKING:
    import pyvips

_THUMBNAIL_SIDE = 160  # px
_NAMED = 4  # of the parts that were left out; the rest is counted


# ---- what goes into a file -----------------------------------------------------------------------------


def with_metadata(
    image: pyvips.Image, metadata: Metadata, orientation: int, is_new: bool, format: WrittenFormat
) -> tuple[pyvips.Image, tuple[str, ...]]:
    """The pixels with metadata that are true of them, and the names of those that cannot go along.

    Args:
        image: pixels alone.
        metadata: of the photo that they come from.
        orientation: EXIF orientation 1-8.
        is_new: whether the pixels are others than the metadata's, so that thumbnails must be made anew, or go.
        format: of the file.
    """
    left_out = [*metadata.without_place(format.holds), *metadata.left_behind]
    packet, resources = metadata.xmp, metadata.resources
    if packet is not None:
        film = metadata.film if "film" in format.holds else None
        left_out += xmp.gone(packet, film is not None)
        # where only XMP tells how to turn the picture, it goes on doing so
        told = orientation if orientation != 1 else exif.orientation(metadata.exif)
        packet = xmp.after(packet, xmp.Next(image.height, image.width, told, is_new, film and film.place))
        if packet is None:
            left_out.append("XMP (damaged)")
    if is_new and resources is not None:
        resources = iptc.without_thumbnails(resources)
    blob = _exif_of(image, metadata.exif, orientation, is_new)
    image = replace(metadata, exif=blob, xmp=packet, resources=resources).on(image)
    image.set_type(libvips().GValue.gint_type, "orientation", orientation)
    return image, tuple(dict.fromkeys(left_out))


def _exif_of(image: pyvips.Image, blob: bytes | None, orientation: int, is_new: bool) -> bytes | None:
    if blob is not None:
        blob = exif.with_size(blob, image.height, image.width)
        if is_new and exif.has_thumbnail(blob):
            blob = exif.with_thumbnail(blob, _thumbnail(image), orientation)
    return exif.with_orientation(blob, orientation)


def _thumbnail(image: pyvips.Image) -> bytes:
    """A JPEG of at most 160 px."""
    small = image.flatten() if image.hasalpha() else image
    small = small.resize(min(_THUMBNAIL_SIDE / max(small.width, small.height), 1.0), kernel="linear")
    return to_8_bits(small).jpegsave_buffer(Q=80, keep=0)


def fitted(image: pyvips.Image, format: WrittenFormat) -> pyvips.Image:
    """What of the pixels a format can hold: depth, alpha (else over black), one channel (else three).

    Raises:
        UnshutterError: too large for the format.
    """
    if max(image.width, image.height) > format.longest_side:
        raise UnshutterError(
            f"a picture of {image.width}x{image.height} px does not fit into {format.name.upper()}, "
            f"which ends at {format.longest_side} px: choose another format"
        )
    if image.hasalpha() and not format.alpha:
        image = image.flatten()
    if not format.deep:
        image = to_8_bits(image)
    if image.bands > 2 or format.grey:
        return image
    grey, alpha = image[0], image[1:] if image.bands == 2 else None
    profile = field(image, "icc-profile-data")
    if profile is not None and profile[16:20] == b"GRAY":  # its tones would be lost with it
        colour = standard(grey).icc_transform("srgb", embedded=True, depth=16 if image.format == "ushort" else 8)
    else:
        colour = grey.bandjoin([grey, grey])
    return standard(colour if alpha is None else colour.bandjoin(alpha))


def is_transparent(image: pyvips.Image) -> bool:
    """Whether an image shows through anywhere, by its last channel."""
    opaque = 65_535 if image.format == "ushort" else 255
    return float(image[image.bands - 1].min()) < opaque  # pyright: ignore[reportArgumentType]


class Encoded(NamedTuple):
    """A picture as a file.

    Attributes:
        data: the file.
        left_out: metadata that did not go into it, in words: ("IPTC", "texts"). :func:`not_written` says it in a line.
    """

    data: bytes
    left_out: tuple[str, ...]


def not_written(left_out: Sequence[str]) -> str:
    """One line for the user that names what a file could not take; empty where it took everything."""
    if not left_out:
        return ""
    named = list(dict.fromkeys(left_out))
    more = [f"{len(named) - _NAMED} more"] if len(named) > _NAMED else []
    named = [*named[:_NAMED], *more]
    listed = " and ".join([", ".join(named[:-1]), named[-1]]) if len(named) > 1 else named[0]
    return f"not written: {listed}"


# ---- files ---------------------------------------------------------------------------------------------


def to_bytes(image: pyvips.Image, format: WrittenFormat, coding: Coding, quality: int | None) -> Encoded:
    """An encoded file of an image that is :func:`fitted`.

    Raises:
        UnshutterError: libvips refuses.
    """
    with refusing(f"cannot encode the picture as {format.name.upper()}"):
        data = format.encode(image, coding, quality, None)
    assert data is not None
    stream = io.BytesIO(data)
    left_out = format.embed(stream, image)
    return Encoded(stream.getvalue(), tuple(left_out))


def to_file(
    image: pyvips.Image, format: WrittenFormat, coding: Coding, quality: int | None, file: Path, target: Path
) -> tuple[str, ...]:
    """Writes a file of an image that is :func:`fitted`; ``target`` is what messages call it.

    Returns:
        What of the metadata the format could not take after all.

    Raises:
        UnshutterError: libvips or the system refuses.
    """
    with refusing(f"cannot write {target}"):
        format.encode(image, coding, quality, file)
    with file.open("r+b") as stream:
        return tuple(format.embed(stream, image))
