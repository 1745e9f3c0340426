"""AVIF and HEIC: pictures in boxes, which contain their orientation and the position of their EXIF.

HEIC is read through libheif (package pi-heif, extra ``heic``). Its pixels are those read from the sensor; the boxes
irot and imir state how a viewer should rotate and mirror them. libheif always applies them while decoding, which is
undone here.

Source: ISO/IEC 23008-12 (HEIF), AV1 Image File Format.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple, final

from unshutter import version
from unshutter.errors import UnshutterError
from unshutter.photo import boxes, code_points, exif, xmp
from unshutter.photo.auxiliary_pictures import QUALITY, Auxiliaries, AuxiliaryPicture, check_auxiliary
from unshutter.photo.box_properties import add_gain_map, state_colours
from unshutter.photo.chunks import APP1, APP2, XMP_PREFIX
from unshutter.photo.directories import EXIF_PREFIX
from unshutter.photo.formats import picture_format
from unshutter.photo.formats.picture_format import Coding, Format, Header, Metadata, Picture, WrittenFormat
from unshutter.photo.gain_map_metadata import ISO_IN_JPEG, ISO_PREFIX
from unshutter.photo.libvips import (
    Source,
    as_image,
    computed,
    field,
    in_plain_words,
    memory_returned,
    refusing,
    standard,
    threads,
)
from unshutter.photo.parts import DAMAGED, GAIN_MAP, purpose, without

if TYPE_CHECKING:
    import numpy as np
    import pyvips
    from pi_heif import HeifImage


_HDR_QUALITY = 90  # usual one: screens stretch the code values of PQ's darker half
# attributes and content of XMP that lists a gain map, whose length is filled in when it is written (Ultra HDR)
_LISTED = (
    b'xmlns:Container="http://ns.google.com/photos/1.0/container/" '
    b'xmlns:Item="http://ns.google.com/photos/1.0/container/item/"',
    b'<Container:Directory><rdf:Seq><rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="Primary" '
    b'Item:Mime="image/jpeg"/></rdf:li><rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="GainMap" '
    b'Item:Mime="image/jpeg" Item:Length="0"/></rdf:li></rdf:Seq></Container:Directory>',
)
_VERSION = b' xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0"'
_THREADS = 4  # of the encoder, on every machine: it splits the picture into tiles by their number


@final
class Avif(WrittenFormat):
    """AVIF: 8, 10 or 12 bits, RGB; the decoder returns grey as three channels."""

    loader = "heifload"
    signature = re.compile(rb"....ftyp(avis|(....)*avif)", re.DOTALL)
    longest_side = 16_384
    deep = True
    grey = False
    alpha = True
    holds = frozenset({"exif", "icc", "code_points", "xmp", "auxiliaries"})

    def read_header(self, source: Source) -> Header:
        """See Format. The orientation is that of the boxes, which decoders apply; EXIF's is ignored."""
        own, found = boxes.inspect_boxes(source)
        image = picture_format.open_image(self, source)
        coding = Coding(subsampled=own.subsampled, bits=field(image, "bits-per-sample", 8))
        read = picture_format.metadata_of(image)
        profile, stated = read.icc, None
        if profile is None:
            profile, stated = code_points.colours(*own.code_points, own.light, source)
        blob = exif.with_header(read.exif)
        if picture_format.readable(self, source) is not source:
            blob = None
            found = without(found, "exif", "EXIF", DAMAGED)
        metadata = replace(read, exif=blob, icc=profile, code_points=stated, found=found)
        header = picture_format.header(self, source, image, coding, metadata, pictures=1)
        height, width = own.orientation.size(header.height, header.width)
        bands = header.bands - 2 if own.grey else header.bands
        metadata = _with_auxiliaries(header.metadata, source, self, (height, width))
        return replace(header, height=height, width=width, bands=bands, orientation=own.orientation, metadata=metadata)

    def exif_blocks(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """See Format."""
        extent = boxes.extent(file, b"Exif")
        if extent is not None:
            file.seek(extent.at)
            content = file.read(extent.length)  # four bytes with the position of the TIFF header, then EXIF
            start = 4 + int.from_bytes(content[:4], "big")
            yield extent.at + start, content[start:]

    @memory_returned()
    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        with refusing("{photo} is damaged or incomplete", photo=source):
            image = picture_format.readable(self, source).load(self.loader, access="sequential", fail_on="error")
            if header.metadata.code_points is not None and header.coding.bits > 8:
                image |= image >> header.coding.bits  # white is 65535
            pixels = computed(image)
        if header.bands <= 2 < pixels.shape[2]:
            pixels = pixels[..., [0] if pixels.shape[2] == 3 else [0, 3]]
        return header.orientation.stored(pixels)

    def encode(self, picture: Picture, path: Path | None) -> bytes | None:
        """See WrittenFormat."""
        coding = picture.coding
        deep = coding.bits if coding.bits in (10, 12) else 12
        stated = picture.metadata.code_points
        if stated is not None:
            picture = replace(
                picture, image=_of_bits(picture.image, deep), metadata=replace(picture.metadata, icc=None)
            )
        options = {
            "compression": "av1",
            "Q": picture.quality or (self.row.usual_quality if stated is None else _HDR_QUALITY),
            "effort": 0,  # takes a quarter of the time of 2; docs/reference/formats.md describes what is lost
            "bitdepth": deep if picture.image.format == "ushort" else 8,
            "subsample_mode": "on" if coding.subsampled else "off",
        }
        with threads(_THREADS), memory_returned():
            return picture_format.encode(picture, "heifsave", path, **options)

    def embed(self, file: BinaryIO, picture: Picture) -> list[str]:
        """See WrittenFormat. Appends EXIF, and makes the item of the zeroed placeholder point to it."""
        metadata = picture.metadata
        if metadata.code_points is not None:
            state_colours(file, metadata.code_points)
        left_out = [] if metadata.exif is None or _embed_exif(file, metadata.exif) else ["EXIF"]
        auxiliaries = metadata.auxiliaries
        gain_map = None if auxiliaries is None else auxiliaries.iso_gain_map
        if auxiliaries is not None and auxiliaries.meaning is not None and gain_map is not None:
            with threads(_THREADS), memory_returned(), refusing("cannot encode the gain map"):
                coded = as_image(gain_map).heifsave_buffer(
                    compression="av1", Q=QUALITY, effort=0, bitdepth=8, subsample_mode="off", keep=0
                )
            if not add_gain_map(file, coded, auxiliaries.meaning.metadata, auxiliaries.alternate):
                left_out.append(GAIN_MAP)
        return left_out

    def held_auxiliaries(self, auxiliaries: Auxiliaries) -> Auxiliaries | None:
        """See WrittenFormat. Only gain maps whose meaning is known."""
        gain_map = auxiliaries.gain_map
        if gain_map is None or auxiliaries.meaning is None:
            return None
        return replace(auxiliaries, pictures=(gain_map,), extension=None)


def _embed_exif(file: BinaryIO, blob: bytes) -> bool:
    """Replaces the placeholder of EXIF; returns whether there is one."""
    old = boxes.extent(file, b"Exif")
    if old is None or not old.are_32_bits:
        return False
    end = file.seek(0, 2)
    content = struct.pack(">I", len(EXIF_PREFIX)) + EXIF_PREFIX + blob.removeprefix(EXIF_PREFIX)
    file.write(struct.pack(">I4s", 8 + len(content), b"mdat") + content)
    file.seek(old.at)
    file.write(bytes(old.length))
    file.seek(old.numbers_at)
    file.write(struct.pack(">II", end + 8 - old.base, len(content)))
    return True


def _of_bits(image: pyvips.Image, bits: int) -> pyvips.Image:
    """Rounds an image of 16 bits to fewer, which are the upper ones: libvips would cut the others off."""
    if image.format != "ushort":
        return image
    levels = image.linear([((1 << bits) - 1) / 65_535], [0.5]).cast("ushort")
    return standard(levels << (16 - bits))


@final
class Heic(Format):
    """HEIC: read-only."""

    signature = re.compile(rb"....ftyp(hevc|hevx|msf1|(....)*(hei[cxms]|mif1))", re.DOTALL)

    def read_header(self, source: Source) -> Header:
        """See Format."""
        own, found = boxes.inspect_boxes(source)
        picture = _primary(source)
        info = picture.info
        height, width = own.orientation.size(*picture.size[::-1])
        profile, stated = info.get("icc_profile"), None
        if not profile:
            profile, stated = code_points.colours(*own.code_points, own.light, source)
        packet = info.get("xmp")
        blob = exif.with_header(info.get("exif") or None)
        if info.get("exif") and blob is None:
            found = without(found, "exif", "EXIF", DAMAGED)
        metadata = Metadata(
            exif=blob,
            icc=bytes(profile) if profile else None,
            code_points=stated,
            xmp=bytes(packet) if packet else None,
            found=found,
        ).without_exif_loop()
        metadata = _with_auxiliaries(metadata, source, self, (height, width))
        coding = Coding(subsampled=info.get("chroma") == 420, bits=info["bit_depth"])
        return Header(self, coding, height, width, len(_channels(picture)), own.orientation, metadata)

    @memory_returned()
    def decode(self, source: Source, header: Header, shrink: int = 1) -> np.ndarray:
        """See Format."""
        pixels = header.orientation.stored(_upright_pixels(source))
        if header.metadata.code_points is not None and pixels.itemsize > 1:
            pixels = pixels | pixels >> header.coding.bits  # white is 65535
            pixels.setflags(write=False)
        if pixels.shape != (header.height, header.width, header.bands):
            raise UnshutterError("{photo} is damaged: its headers do not match its picture", photo=source)
        return pixels


class _StoredItem(NamedTuple):
    """An auxiliary picture of an AVIF or HEIC."""

    source: Source
    format: Format
    item: boxes.AuxiliaryItem
    photo_size: tuple[int, int]

    def file(self) -> None:
        """See Stored."""

    def segments(self) -> list[tuple[int, bytes]]:
        """See Stored. XMP gets the type of the picture, as in Apple's JPEGs."""
        item = self.item
        packet = item.xmp
        if b"hdrgm:" not in (packet or b"") and item.iso is None and b"AuxiliaryImageType" not in (packet or b""):
            told = b'xmlns:apdi="http://ns.apple.com/pixeldatainfo/1.0/" apdi:AuxiliaryImageType="%s"'
            packet = xmp.with_description(packet, told % item.kind.encode())
        iso = [] if item.iso is None else [(APP2, ISO_PREFIX + ISO_IN_JPEG + item.iso[1:])]
        return [*([] if packet is None else [(APP1, XMP_PREFIX + packet)]), *iso]

    def pixels(self) -> np.ndarray:
        """See Stored."""
        import numpy as np

        try:
            source = Source(boxes.with_primary(self.source.data(), self.item.number))
        except (KeyError, ValueError, IndexError, struct.error) as error:
            raise UnshutterError("the auxiliary picture is damaged") from error
        header = self.format.read_header(source)
        check_auxiliary(header.height, header.width, header.bands, self.photo_size)
        pixels = self.format.decode(source, header)
        if pixels.dtype != np.uint8:
            pixels = np.round(pixels / 257).astype(np.uint8)
        return pixels


def _with_auxiliaries(metadata: Metadata, source: Source, format: Format, size: tuple[int, int]) -> Metadata:
    """Returns the metadata with the auxiliary pictures of an AVIF or HEIC, as a JPEG lists them."""
    with source.stream() as stream:
        items = [(purpose(item.kind.encode()), item) for item in boxes.auxiliary_items(stream)]
    pictures = tuple(AuxiliaryPicture(name, _StoredItem(source, format, item, size)) for name, item in items if name)
    if not pictures:
        return metadata
    names = {each.name for each in pictures}
    found = (part._replace(held="auxiliaries") if part.name in names else part for part in metadata.found)
    segments = tuple(ISO_PREFIX + ISO_IN_JPEG + item.iso[1:5] for _, item in items if item.iso is not None)
    gain_map = next((item for name, item in items if name == GAIN_MAP), None)
    alternate = () if gain_map is None else gain_map.alternate
    packet = metadata.xmp
    if any(b"hdrgm:" in (item.xmp or b"") for _, item in items) and b"Container:Directory" not in (packet or b""):
        attributes, content = _LISTED
        version_told = b"hdrgm:Version" in (packet or b"")
        packet = xmp.with_description(packet, attributes + (b"" if version_told else _VERSION), content)
    auxiliaries = Auxiliaries(
        pictures,
        segments[:1],
        ">",
        exif=metadata.exif,
        alternate=alternate,
        alternate_has_other_colours=gain_map is not None and gain_map.has_other_colours,
    )
    return replace(metadata, xmp=packet, found=tuple(found), auxiliaries=auxiliaries)


def _upright_pixels(source: Source) -> np.ndarray:
    """Decodes the primary picture, [H, W, bands] uint8 or uint16, rotated and mirrored as the file specifies."""
    import numpy as np

    picture = _primary(source)
    try:
        pixels = np.array(picture)  # copied, because pi-heif's pixels are freed with its picture
    except Exception as error:  # libheif's errors, in whichever class pi-heif raises them
        raise UnshutterError(f"{{photo}} is damaged or incomplete: {_cause(error)}", photo=source) from None
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    if _channels(picture).endswith("a"):  # colours are premultiplied
        top = np.iinfo(pixels.dtype).max
        opacity = np.maximum(pixels[..., -1:], 1) / top
        plain = np.minimum(np.round(pixels[..., :-1] / opacity), top).astype(pixels.dtype)
        pixels = np.concatenate([plain, pixels[..., -1:]], axis=2)
    pixels.setflags(write=False)
    return pixels


def _channels(picture: HeifImage) -> str:
    return picture.mode.partition(";")[0]  # one letter per channel


def _primary(source: Source) -> HeifImage:
    try:
        import pi_heif
    except ImportError:
        raise UnshutterError(f"{{photo}} is a HEIC photo: to read it, {version.extra('heic')}", photo=source) from None
    try:
        with source.stream() as stream:
            if not _item_names_are_text(stream):
                raise ValueError("names of its parts are not text")
            if not boxes.bits_agree(stream):  # pi-heif is not asked to read such data
                raise ValueError("its headers contradict each other")
            file = pi_heif.open_heif(stream, convert_hdr_to_8bit=False)
            if not len(file):
                raise ValueError("it contains no picture")
            return file[file.primary_index]
    except Exception as error:
        if isinstance(error, OSError) and error.strerror:
            raise
        raise UnshutterError(
            f"{{photo}} is a HEIC photo, damaged, incomplete or unusual: {_cause(error)}", photo=source
        ) from None


def _item_names_are_text(file: BinaryIO) -> bool:
    """Whether the types of all items are ASCII, as the standard demands; pi-heif is not asked to read others."""
    try:
        entries = boxes.item_entries(boxes.in_meta(file)[b"iinf"])
    except (KeyError, IndexError):
        return True  # reported elsewhere
    return all(byte < 128 for entry in entries for byte in entry[8:])


def _cause(error: Exception) -> str:
    return in_plain_words(" ".join(str(error).split())) or type(error).__name__
