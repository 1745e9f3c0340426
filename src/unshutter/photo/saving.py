"""Fits pictures to a format, and writes them: as an encoded file in memory, or to a file on disc."""

from __future__ import annotations

import io
import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from unshutter.errors import UnshutterError
from unshutter.inventory import Part, left_out
from unshutter.options import PictureFormat, Save, Subsampling
from unshutter.options.fields import errors_in_python, from_keywords
from unshutter.orientation import Orientation
from unshutter.photo import chunks, exif, extended_xmp, xmp
from unshutter.photo.code_points import CodePoints, for_screen
from unshutter.photo.formats import WRITTEN, of_target
from unshutter.photo.formats.picture_format import Metadata, Picture, WrittenFormat
from unshutter.photo.libvips import field, in_srgb, refusing, standard, to_8_bits
from unshutter.photo.parts import AUXILIARY, DAMAGED, Found, lost, without
from unshutter.storage.files import Times, check_target, written_whole
from unshutter.storage.locations import RunFiles
from unshutter.storage.opened import Opened

if TYPE_CHECKING:
    import pyvips


class Encoded(NamedTuple):
    """A picture as an encoded file."""

    data: bytes  # the file
    left_out: tuple[str, ...]  # names of metadata that it lacks: ("IPTC", "texts")


class FileOutput(ABC):
    """A picture with metadata that can be written in any output format."""

    format: str
    path: Path | None
    opened: Opened | None
    made_from: Sequence[Opened]

    @property
    @abstractmethod
    def times_ns(self) -> Times:
        """Access and modification time of its file [ns since 1970]."""

    @abstractmethod
    def _picture_for(self, format: WrittenFormat, save: Save) -> tuple[Picture, list[Part]]:
        """Returns the picture as a format can hold it, and what becomes of the parts of its file."""

    @property
    @abstractmethod
    def usual_format(self) -> PictureFormat:
        """The format in which it is written if none is asked for."""

    def to_bytes(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> bytes:
        """Encodes the photo.

        Args:
            format: ``jpeg``, ``png``, ``webp``, ``tiff`` or ``avif``; its own by default
                (PNG for arrays, TIFF for raw, AVIF for HEIC but JPEG if it has a gain map).
            quality: 1-100 for JPEG, WebP and AVIF; by default like the input's, else 95, 90 and 80 (HDR: 90).
            subsampling: chroma subsampling of JPEG and AVIF, ``4:4:4`` (none) or ``4:2:0``; by default like the input's
                (4:4:4 for anything in between).
        """
        return self.encode(format, quality, subsampling).data

    def encode(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> Encoded:
        """Encodes the photo like :meth:`to_bytes`, and names the metadata that the format cannot hold."""
        save = from_keywords(Save, {"format": format, "quality": quality, "subsampling": subsampling})
        target = WRITTEN[save.format or self.usual_format]
        data, parts = encode_with_parts(self, target, save)
        return Encoded(data, tuple(left_out(parts)))

    @errors_in_python()
    def save(
        self,
        path: str | os.PathLike[str],
        quality: int | None = None,
        overwrite: bool = False,
        subsampling: Subsampling | None = None,
        keep_times: bool = False,
    ) -> tuple[str, ...]:
        """Writes the photo atomically: to a temporary file next to ``path`` that is renamed when complete.

        It gets the permissions of the file from which the photo was read.

        Args:
            path: file to write; its extension determines the format: .jpg .jpeg .png .webp .tif .tiff .avif.
            quality: see :meth:`to_bytes`.
            overwrite: whether an existing file may be replaced; never the photo's own or the target of a link.
            subsampling: see :meth:`to_bytes`.
            keep_times: whether it also gets the access and modification time that the photo's file had when it was
                opened, as far as the file system supports them.

        Returns:
            The names of metadata that the format cannot hold, such as ``("IPTC",)``.
        """
        target = Path(path)
        options = from_keywords(Save, {"quality": quality, "subsampling": subsampling, "keep_times": keep_times})
        format = of_target(target)
        check_result(target, overwrite, self.made_from)
        return write_photo(self, target, format, options, overwrite)


def check_result(target: Path, overwrite: bool, made_from: Sequence[Opened]) -> None:
    """Checks that a result may be written: none of the files that it was made from is replaced."""
    RunFiles(reads=made_from).check(target)
    check_target(target, overwrite)


def encode_with_parts(photo: FileOutput, format: WrittenFormat, save: Save) -> tuple[bytes, list[Part]]:
    """Encodes a photo as :meth:`FileOutput.encode` does; returns the file, and what became of the parts of its source.

    Parts that did not fit are listed at the end as left out.
    """
    picture, parts = photo._picture_for(format, save)
    with refusing(f"cannot encode the picture as {format.row.title}"):
        data = format.encode(picture, None)
    assert data is not None
    stream = io.BytesIO(data)
    parts += lost(format.embed(stream, picture))
    return stream.getvalue(), parts


def write_photo(photo: FileOutput, target: Path, format: WrittenFormat, save: Save, overwrite: bool) -> tuple[str, ...]:
    """Writes a photo as :meth:`FileOutput.save` does, without checking the target first."""
    times_ns = photo.times_ns if save.keep_times else None
    picture, parts = photo._picture_for(format, save)  # decodes: damage is found before writing
    with written_whole(target, overwrite, mode_of=photo.opened and photo.opened.path, times_ns=times_ns) as part:
        with refusing(f"cannot write {target}"):
            format.encode(picture, part)
        with part.open("r+b") as stream:
            parts += lost(format.embed(stream, picture))
    return tuple(left_out(parts))


# ---- contents of a file --------------------------------------------------------------------------------


def fitted(picture: Picture, format: WrittenFormat, is_new: bool) -> tuple[Picture, list[Part]]:
    """Fits a picture to a format, and updates its metadata to match the pixels; also returns what becomes of parts.

    If the pixels differ from those of the file that the metadata come from, thumbnails are replaced or removed.
    """
    stated = picture.metadata.code_points
    if stated is not None and "code_points" not in format.holds:
        raise UnshutterError(f"{format.row.title} cannot hold {stated.title}: save it as AVIF or PNG")
    lost_channels = []
    if picture.masked and not format.masks:  # otherwise libvips would treat the mask as transparency
        lost_channels = ["mask channel"]
        picture = replace(picture, image=standard(picture.image[: picture.image.bands - 1]))
    elif picture.has_alpha and not format.alpha:
        opaque = 65_535 if picture.image.format == "ushort" else 255
        if float(picture.image[picture.image.bands - 1].min()) < opaque:  # pyright: ignore[reportArgumentType]
            lost_channels = ["transparency"]
    metadata = _updated_metadata(picture, format, is_new)
    parts = _parts(picture.metadata, metadata, format)
    image, profile = _fitted_pixels(picture.image, metadata.icc, format)
    fitting = replace(picture, image=image, metadata=replace(metadata, icc=profile))
    return fitting, [*parts, *lost(lost_channels)]


def _parts(before: Metadata, after: Metadata, format: WrittenFormat) -> list[Part]:
    """Returns what becomes of the parts of a file, given the metadata that are written."""
    changed = [name for name in format.holds if getattr(before, name) != getattr(after, name)]
    changed += ["resolution", *after.moved_in]  # the former is written in another form
    return [found.part(format.holds, changed) for found in after.found]


def _updated_metadata(picture: Picture, format: WrittenFormat, is_new: bool) -> Metadata:
    """Returns metadata that match the pixels; what is lost in this is among the parts."""
    image = picture.image
    metadata = picture.metadata
    if metadata.auxiliaries is not None and "auxiliaries" in format.holds:
        held = format.held_auxiliaries(metadata.auxiliaries)
        readable = held and held.readable(format.appends_pictures)
        metadata = metadata if readable is metadata.auxiliaries else metadata.with_auxiliaries(readable)
    orientation = picture.orientation
    found = metadata.found
    packet = metadata.xmp
    resources = metadata.resources
    if packet is not None:
        video = metadata.video if "video" in format.holds else None
        found = (*found, *xmp.lost(packet, video is not None, {part.name for part in found} & {*AUXILIARY}))
        # an orientation given only in XMP is kept there
        xmp_orientation = orientation if orientation is not Orientation.NORMAL else exif.orientation(metadata.exif)
        packet = xmp.updated(
            packet,
            xmp.NextPicture(
                image.height, image.width, xmp_orientation, is_new, video and video.place, *_follow(metadata, format)
            ),
        )
        if packet is None:
            found = without(found, "xmp", "XMP", DAMAGED)
    if is_new and resources is not None:
        resources = chunks.without_thumbnails(resources)
    blob = metadata.exif
    profile = metadata.icc
    if profile is not None and profile[16:20] not in (b"RGB ", b"GRAY"):  # libvips would leave it out
        found = without(found, "icc", "colour profile")
        profile = None
    if blob is not None:
        blob = exif.with_size(blob, image.height, image.width)
        if is_new and exif.has_thumbnail(blob):
            blob = exif.with_thumbnail(blob, _thumbnail(image, metadata.code_points), orientation)
            found += () if exif.has_thumbnail(blob) else (Found("thumbnail"),)
    blob = exif.with_orientation(blob, orientation)
    return replace(metadata, exif=blob, icc=profile, xmp=packet, resources=resources, found=found)


def _follow(metadata: Metadata, format: WrittenFormat) -> tuple[tuple[tuple[str, int], ...], str | None]:
    """Returns name and length [bytes] of each auxiliary picture that will follow the picture, and what XMP will."""
    if metadata.auxiliaries is None or not format.appends_pictures:
        return (), None
    packet = metadata.auxiliaries.extended_xmp
    lengths = tuple((each.name, len(each.file)) for each in metadata.auxiliaries.behind)
    return lengths, None if packet is None else extended_xmp.digest(packet)


def _thumbnail(image: pyvips.Image, stated: CodePoints | None) -> bytes:
    small = image.flatten() if image.hasalpha() else image
    small = small.resize(min(160 / max(small.width, small.height), 1.0), kernel="linear")
    small = to_8_bits(small) if stated is None else for_screen(small, stated)
    return small.jpegsave_buffer(Q=80, keep=0)


def _fitted_pixels(
    image: pyvips.Image, profile: bytes | None, format: WrittenFormat
) -> tuple[pyvips.Image, bytes | None]:
    """Converts pixels to depth and channels that a format can hold; returns them with their ICC profile.

    Transparency that it cannot hold is flattened on black, and grey becomes three channels.
    """
    if max(image.width, image.height) > format.longest_side:
        raise UnshutterError(
            f"a picture of {image.width}x{image.height} px is too large for {format.row.title}, "
            f"whose limit is {format.longest_side} px: choose another format"
        )
    if image.hasalpha() and not format.alpha:
        image = image.flatten()
    if not format.deep:
        image = to_8_bits(image)
    if image.bands > 2 or format.grey:
        return image, profile
    grey = standard(image[0])
    alpha = image[1:] if image.bands == 2 else None
    if profile is not None and profile[16:20] == b"GRAY":  # for grey only, so it would be lost
        colour = in_srgb(grey, profile)
        profile = field(colour, "icc-profile-data")
    else:
        colour = grey.bandjoin([grey, grey])
    return standard(colour if alpha is None else colour.bandjoin(alpha)), profile
