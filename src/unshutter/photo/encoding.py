"""Encodes pictures into files, as far as all formats have this in common."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from unshutter.errors import UnshutterError
from unshutter.geometry.readout import Orientation
from unshutter.photo.format import Picture, WrittenFormat
from unshutter.photo.libvips import field, in_srgb, refusing, standard, to_8_bits
from unshutter.photo.metadata import Metadata
from unshutter.photo.tags import exif, iptc, xmp

if TYPE_CHECKING:
    import pyvips

_THUMBNAIL_SIDE = 160  # px
_NAMED = 4  # number of omitted parts to name; the others are counted


# ---- contents of a file --------------------------------------------------------------------------------


def fitted(picture: Picture, format: WrittenFormat, is_new: bool) -> tuple[Picture, tuple[str, ...]]:
    """Fits a picture to a format, updates its metadata to match the pixels, and names what is lost.

    Args:
        picture: pixels and metadata of a photo.
        format: format of the file.
        is_new: whether the pixels differ from those of the file that the metadata come from; thumbnails are then
            replaced or removed.

    Raises:
        UnshutterError: the picture is too large for the format.
    """
    lost_channels = tuple(_lost_channels(picture, format))
    if picture.masked and not format.masks:  # otherwise libvips would treat the mask as transparency
        picture = replace(picture, image=standard(picture.image[: picture.image.bands - 1]))
    metadata, left_out = _true_metadata(picture, format, is_new)
    image, profile = _fitted_pixels(picture.image, metadata.icc, format)
    fitting = replace(picture, image=image, metadata=replace(metadata, icc=profile))
    return fitting, (*dict.fromkeys(left_out), *lost_channels)


def _lost_channels(picture: Picture, format: WrittenFormat) -> Iterator[str]:
    """Yields the names of channels that a format cannot hold."""
    if picture.masked and not format.masks:
        yield "mask channel"
    if picture.has_alpha and not format.alpha and _is_transparent(picture.image):
        yield "transparency"


def _true_metadata(picture: Picture, format: WrittenFormat, is_new: bool) -> tuple[Metadata, list[str]]:
    """Updates the metadata to match the pixels; returns them with the names of those that are lost."""
    image, metadata, orientation = picture.image, picture.metadata, picture.orientation
    left_out = [*metadata.without_place(format.holds), *metadata.left_behind]
    packet, resources = metadata.xmp, metadata.resources
    if packet is not None:
        film = metadata.film if "film" in format.holds else None
        left_out += xmp.gone(packet, film is not None)
        # an orientation given only in XMP is kept there
        xmp_orientation = orientation if orientation is not Orientation.NORMAL else exif.orientation(metadata.exif)
        packet = xmp.after(packet, xmp.Next(image.height, image.width, xmp_orientation, is_new, film and film.place))
        if packet is None:
            left_out.append("XMP (damaged)")
    if is_new and resources is not None:
        resources = iptc.without_thumbnails(resources)
    blob = _true_exif(image, metadata.exif, orientation, is_new)
    return replace(metadata, exif=blob, xmp=packet, resources=resources), left_out


def _true_exif(image: pyvips.Image, blob: bytes | None, orientation: Orientation, is_new: bool) -> bytes | None:
    if blob is not None:
        blob = exif.with_size(blob, image.height, image.width)
        if is_new and exif.has_thumbnail(blob):
            blob = exif.with_thumbnail(blob, _thumbnail(image), orientation)
    return exif.with_orientation(blob, orientation)


def _thumbnail(image: pyvips.Image) -> bytes:
    """Creates a JPEG thumbnail of at most 160 px."""
    small = image.flatten() if image.hasalpha() else image
    small = small.resize(min(_THUMBNAIL_SIDE / max(small.width, small.height), 1.0), kernel="linear")
    return to_8_bits(small).jpegsave_buffer(Q=80, keep=0)


def _fitted_pixels(
    image: pyvips.Image, profile: bytes | None, format: WrittenFormat
) -> tuple[pyvips.Image, bytes | None]:
    """Converts pixels to depth and channels that a format can hold; returns them with their ICC profile.

    Transparency that it cannot hold is flattened on black, and grey becomes three channels.

    Raises:
        UnshutterError: the picture is too large for the format.
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
        return image, profile
    grey, alpha = standard(image[0]), image[1:] if image.bands == 2 else None
    if profile is not None and profile[16:20] == b"GRAY":  # for grey only, so it would be lost
        colour = in_srgb(grey, profile)
        profile = field(colour, "icc-profile-data")
    else:
        colour = grey.bandjoin([grey, grey])
    return standard(colour if alpha is None else colour.bandjoin(alpha)), profile


def _is_transparent(image: pyvips.Image) -> bool:
    """Whether any pixel of an image is transparent, according to its last channel."""
    opaque = 65_535 if image.format == "ushort" else 255
    return float(image[image.bands - 1].min()) < opaque  # pyright: ignore[reportArgumentType]


class Encoded(NamedTuple):
    """A picture as an encoded file.

    Attributes:
        data: the file.
        left_out: names of metadata that it lacks: ("IPTC", "texts"). :func:`not_written` lists them in a line.
    """

    data: bytes
    left_out: tuple[str, ...]


def not_written(left_out: Sequence[str]) -> str:
    """Lists the metadata that a file cannot hold in one line for the user; empty if there are none."""
    if not left_out:
        return ""
    named = list(dict.fromkeys(left_out))
    more = [f"{len(named) - _NAMED} more"] if len(named) > _NAMED else []
    named = [*named[:_NAMED], *more]
    listed = " and ".join([", ".join(named[:-1]), named[-1]]) if len(named) > 1 else named[0]
    return f"not written: {listed}"


# ---- files ---------------------------------------------------------------------------------------------


def to_bytes(picture: Picture, format: WrittenFormat) -> Encoded:
    """Encodes a picture that is :func:`fitted`.

    Raises:
        UnshutterError: libvips fails.
    """
    with refusing(f"cannot encode the picture as {format.name.upper()}"):
        data = format.encode(picture, None)
    assert data is not None
    stream = io.BytesIO(data)
    left_out = format.embed(stream, picture)
    return Encoded(stream.getvalue(), tuple(left_out))


def to_file(picture: Picture, format: WrittenFormat, file: Path, target: Path) -> tuple[str, ...]:
    """Writes a file of a picture that is :func:`fitted`; ``target`` is its name in messages.

    Returns:
        Names of metadata that the format could not hold after all.

    Raises:
        UnshutterError: libvips or the system fails.
    """
    with refusing(f"cannot write {target}"):
        format.encode(picture, file)
    with file.open("r+b") as stream:
        return tuple(format.embed(stream, picture))
