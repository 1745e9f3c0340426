"""What a file says about its picture before any of its pixels are decoded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError
from unshutter.photo import colours, containers, metadata, resources
from unshutter.photo.codecs import CODECS, Codec, Coding, Source, recognise
from unshutter.photo.libvips import field, refusing, set_blob

if TYPE_CHECKING:
    import pyvips


@dataclass(frozen=True)
class Header:
    """What is known of a picture that is not decoded yet.

    Attributes:
        codec: its format.
        coding: how it is encoded.
        height, width: of the stored pixels [px].
        bands: channels, alpha included.
        orientation: EXIF orientation 1-8 of the stored pixels.
        about: an image with the metadata, by libvips's names; its pixels mean nothing.
        exif: EXIF blob.
    """

    codec: Codec
    coding: Coding
    height: int
    width: int
    bands: int
    orientation: int
    about: pyvips.Image
    exif: bytes | None


def read_header(source: Source, max_pixels: int) -> Header:
    """Reads it.

    Raises:
        UnshutterError: missing, unreadable, of no format that is read, damaged, of a kind that the package does not
            work on, more pixels than ``max_pixels``, or in need of an extra that is not installed.
    """
    codec = recognise(source)
    try:
        tree = None
        if codec.name == "tiff":
            with source.stream() as stream:
                tree = metadata.read_tree(stream)
            if tree is not None and _is_raw(tree):
                codec = CODECS["raw"]
        if codec.name == "heic":
            from unshutter.photo import heic

            header = heic.read_header(source, codec)
        elif codec.name == "raw":
            from unshutter.photo import raw

            header = raw.read_header(source, codec)
        else:
            header = _read_by_libvips(source, codec, tree)
    except OSError as error:
        raise UnshutterError(f"cannot read {source}: {error.strerror}") from None
    _check_size(source, header, max_pixels)
    return header


def _is_raw(tree: metadata.Tree) -> bool:
    """Whether a TIFF is a DNG, or begins with a preview as the raw files of Nikon and Sony do."""
    return metadata.DNG_VERSION in tree.pages[0] or bool((tree.number(metadata.SUBFILE_TYPE) or 0) & 1)


def _read_by_libvips(source: Source, codec: Codec, tree: metadata.Tree | None) -> Header:
    with refusing(f"{source} is damaged, incomplete or unusual"):
        about = source.load(codec, access="sequential")
        about.get_fields()  # their names may be damaged, too
    coding, exif = _read_coding(source, codec, about, tree)
    about = _with_what_libvips_misses(source, codec, about, tree)
    _check_pixels(source, about)
    # AVIF's own boxes turn the picture; EXIF has no say in it
    orientation = coding.orientation if codec.name == "avif" else field(about, "orientation", 1)
    size = (about.height, about.width)
    height, width = size[::-1] if coding.orientation >= 5 else size  # the decoder has turned it
    return Header(
        codec=codec,
        coding=coding,
        height=height,
        width=width,
        bands=about.bands - 2 if coding.grey else about.bands,
        orientation=orientation if 1 <= orientation <= 8 else 1,
        about=about,
        exif=exif,
    )


def _with_what_libvips_misses(
    source: Source, codec: Codec, about: pyvips.Image, tree: metadata.Tree | None
) -> pyvips.Image:
    """The metadata with IPTC as TIFF has it, and a profile for colours that AVIF tells by numbers."""
    about = about.copy()
    if codec.name == "tiff":
        about.remove("iptc-data")
        if tree is not None and (blocks := resources.of_tiff(tree)) is not None:
            set_blob(about, "iptc-data", blocks)
    if codec.name == "avif" and field(about, "icc-profile-data") is None:
        with source.stream() as stream:
            profile = colours.profile_of(source, *containers.box_coding(stream).code_points)
        if profile is not None:
            set_blob(about, "icc-profile-data", profile)
    return about


def _read_coding(
    source: Source, codec: Codec, about: pyvips.Image, tree: metadata.Tree | None
) -> tuple[Coding, bytes | None]:
    """How the picture was encoded, and its EXIF blob.

    Raises:
        UnshutterError: it holds several pictures, or its colours cannot be told.
    """
    bits, exif = field(about, "bits-per-sample", 8), field(about, "exif-data")
    pages = field(about, "n-pages", 1) if codec.name != "avif" else 1
    coding = Coding(bits=bits)
    with source.stream() as stream:
        if codec.name == "jpeg":
            quality, subsampled = containers.jpeg_coding(stream)  # libvips calls 4:2:2 4:2:0
            coding = Coding(quality, subsampled)
        elif codec.name == "webp":
            lossless = containers.webp_is_lossless(stream)
            coding = Coding(subsampled=not lossless, lossless=lossless)
        elif codec.name == "avif":
            orientation, grey, subsampled, _ = containers.box_coding(stream)
            coding = Coding(subsampled=subsampled, bits=bits, orientation=orientation, grey=grey)
        elif tree is not None:
            kinds = [tree.number(metadata.SUBFILE_TYPE, page=page) or 0 for page in range(len(tree.pages))]
            pages = sum(not kind & 5 for kind in kinds)  # smaller copies and masks do not count
            coding = Coding(bits=bits, compression=tree.number(metadata.COMPRESSION))
            exif = metadata.exif_of_tiff(tree)
    if pages > 1:
        raise UnshutterError(f"{source} holds {pages} pictures: unshutter takes single photos, save them one by one")
    return coding, exif


def _check_size(source: Source, header: Header, max_pixels: int) -> None:
    if header.width * header.height > max_pixels:
        size = f"{header.width}x{header.height} px ({header.width * header.height / 1e6:.0f} megapixels)"
        raise UnshutterError(f"{source} has {size}, more than the limit of {max_pixels / 1e6:g} megapixels")


def _check_pixels(source: Source, about: pyvips.Image) -> None:
    """Refuses CMYK or CIELAB colours, samples other than 8 or 16 bits unsigned, more than four channels."""
    if about.interpretation == "cmyk":
        raise UnshutterError(f"{source} is in CMYK colours: convert it to RGB first")
    if about.interpretation in ("lab", "labs", "labq", "lch", "xyz", "yxy", "hsv"):
        raise UnshutterError(f"{source} is in {str(about.interpretation).upper()} colours: convert it to RGB first")
    if about.format not in ("uchar", "ushort"):
        raise UnshutterError(
            f"{source} has {_sample_kind(str(about.format))} samples: convert it to 8 or 16 bits first"
        )
    if about.bands > 4:
        raise UnshutterError(f"{source} has {about.bands} channels: convert it to grey or RGB first")


def _sample_kind(vips_format: str) -> str:
    kinds = {"float": "32-bit float", "double": "64-bit float", "uint": "32-bit", "int": "32-bit signed"}
    return kinds.get(vips_format, {"char": "8-bit signed", "short": "16-bit signed"}.get(vips_format, vips_format))
