"""Photo: pixels and metadata, from a file or an array; and open_photo, for all that Python functions accept."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import IO, TYPE_CHECKING, BinaryIO, TypeAlias, cast

from unshutter.errors import UnshutterError, UsageError
from unshutter.inventory import Part
from unshutter.options import MAX_PIXELS, PictureFormat, Save
from unshutter.options.picture_formats import BY_NAME
from unshutter.orientation import Orientation
from unshutter.photo import attitude, decoder, exif, exposure, readout_times, regions, saving
from unshutter.photo.arrays import is_pillow, pixels_of
from unshutter.photo.attitude import Attitude
from unshutter.photo.auxiliary_pictures import Auxiliaries
from unshutter.photo.decoder import Decoder, grey_copy, grey_size, read_header
from unshutter.photo.embedded_video import EmbeddedVideo, embedded_video
from unshutter.photo.formats import WRITTEN
from unshutter.photo.formats.picture_format import Coding, Metadata, Picture, WrittenFormat
from unshutter.photo.libvips import Source, as_image, with_bands
from unshutter.photo.placement import Placement
from unshutter.photo.saving import FileOutput
from unshutter.readout_time import ReadoutTime
from unshutter.storage.files import Times
from unshutter.storage.opened import Opened

if TYPE_CHECKING:
    from datetime import datetime

    import numpy as np
    import pyvips
    from PIL.Image import Image


PREVIEW = "unshutter --preview"  # the program that previews name in EXIF


@dataclass(frozen=True, eq=False)
class Photo(FileOutput):
    """A picture as it is stored, never rotated to be upright, with all metadata of its file.

    Pixels are decoded once, on first use or earlier (:meth:`start_decoding`). :attr:`pixels` is always
    [H, W, bands], with one band for a grey photo; :meth:`to_array` returns a grey photo as [H, W].

    Results keep depth, channels, profile and metadata as far as their format can hold them, with the picture's size and
    a new thumbnail; docs/reference/formats.md lists this by format. Places in the metadata move with the pixels.

    Attributes:
        format: ``jpeg``, ``png``, ``webp``, ``tiff``, ``avif``, ``heic``, ``raw``, or ``array``.
        height, width: size of the stored pixels [px].
        bands: number of channels, including alpha.
        orientation: EXIF orientation 1-8 of the stored pixels.
        path: the file that it was read from, if any.
        opened: that file as it was when it was opened.
        made_from: the files that it was made from, none of which it may replace.
    """

    format: str
    height: int
    width: int
    bands: int
    orientation: int
    path: Path | None
    _decoder: Decoder | None = field(repr=False)
    _coding: Coding = field(repr=False)
    _metadata: Metadata = field(repr=False)
    _new_pixels: np.ndarray | None = field(repr=False, default=None)  # pixels that differ from the source's
    opened: Opened | None = field(repr=False, default=None)  # its file, before it was read
    given: np.ndarray | Image | None = field(repr=False, default=None)  # what it was made from, if not from a file
    made_from: Sequence[Opened] = field(repr=False, default=())

    # ---- reading ---------------------------------------------------------------------------------------

    @classmethod
    def open(cls, path: str | os.PathLike[str], max_pixels: int = MAX_PIXELS) -> Photo:
        """Reads the header of a file; its pixels are decoded later.

        Raises:
            UnshutterError: the file is missing, unreadable, empty, damaged or of no known format, has several pictures,
                is CMYK, CIELAB or floating point, or has more than ``max_pixels``.
        """
        return cls._from_source(Source.of_file(Path(path)), max_pixels)

    @classmethod
    def from_bytes(cls, data: bytes, max_pixels: int = MAX_PIXELS) -> Photo:
        """Like :meth:`open`, for an encoded file in memory."""
        return cls._from_source(Source(bytes(data)), max_pixels)

    @classmethod
    def _from_source(cls, source: Source, max_pixels: int) -> Photo:
        header = read_header(source, max_pixels)
        return cls(
            format=header.format.row.name,
            height=header.height,
            width=header.width,
            bands=header.bands,
            orientation=header.orientation,
            path=source.path,
            _decoder=Decoder(source, header),
            _coding=header.coding,
            _metadata=header.metadata,
            made_from=() if source.opened is None else (source.opened,),
            opened=source.opened,
        )

    @classmethod
    def from_array(cls, array: np.ndarray, exposure_s: float | None = None, *, software: str = "") -> Photo:
        """Creates a photo from a copy of pixels [H, W] or [H, W, 1..4] (grey, RGB, each with or without alpha).

        Args:
            array: the pixels, uint8 or uint16.
            exposure_s: exposure time [s] for EXIF; None: no EXIF.
            software: name of the program for EXIF instead, in ASCII, if the picture is drawn.

        Raises:
            UnshutterError: the shape or type is unsupported, or there are no pixels.
        """
        pixels = with_bands(array).copy()
        pixels.setflags(write=False)
        height, width, bands = pixels.shape
        metadata = Metadata()
        if exposure_s is not None:
            metadata = Metadata(exif=exposure.blob_of(exposure_s))
        elif software:
            metadata = Metadata(exif=exif.of_software(software))
        return cls("array", height, width, bands, 1, None, None, Coding(), metadata, pixels)

    @property
    def auxiliaries(self) -> Auxiliaries | None:
        """The auxiliary pictures of the photo, such as its gain map; None if it has none."""
        return self._metadata.auxiliaries

    def with_pixels(
        self, pixels: np.ndarray, placement: Placement | None = None, auxiliaries: Auxiliaries | None = None
    ) -> Photo:
        """Returns a photo with new pixels, possibly of another size, and this one's metadata and format; not copied.

        Args:
            placement: where they show what this photo shows: places in the metadata, such as faces, are moved along.
                By default, pixels of the same size show everything at the same place; others lose these metadata.
            auxiliaries: the auxiliary pictures that fit these pixels; by default none.

        Raises:
            UnshutterError: see :meth:`from_array`.
        """
        pixels = with_bands(pixels)
        height, width, bands = pixels.shape
        if placement is None and (height, width) != (self.height, self.width):
            placement = Placement((self.height, self.width), (height, width))
        metadata = self._metadata if placement is None else self._metadata.moved(placement)
        metadata = metadata.with_auxiliaries(auxiliaries)
        return replace(
            self, height=height, width=width, bands=bands, _new_pixels=pixels, _decoder=None, _metadata=metadata
        )

    # ---- contents --------------------------------------------------------------------------------------

    @property
    def has_alpha(self) -> bool:
        """Whether the last channel is transparency."""
        return self.bands in (2, 4) and not self._coding.masked

    @property
    def masked(self) -> bool:
        """Whether the last channel is a mask, as Photoshop stores some in TIFF."""
        return self.bands in (2, 4) and self._coding.masked

    def start_decoding(self, executor: Executor | None = None, grey_px: int | None = None, whole: bool = True) -> None:
        """Starts decoding in a thread of the executor, by default a new one.

        A grey copy with a short side of ``grey_px`` comes first, if it will be needed, then all pixels, if they will
        be.
        """
        if self._decoder is not None:
            thread = executor or ThreadPoolExecutor(1)
            self._decoder.start(thread, grey_px, whole)
            if executor is None:
                thread.shutdown(wait=False)

    @property
    def pixels(self) -> np.ndarray:
        """The stored pixels [H, W, bands] (bands is 1 for grey), uint8 or uint16; read-only.

        Raises:
            UnshutterError: the file is damaged, incomplete, or gone.
        """
        if self._decoder is not None:
            return self._decoder.pixels
        assert self._new_pixels is not None
        return self._new_pixels

    @property
    def hdr_formats(self) -> tuple[str, ...]:
        """The output formats in which it stays HDR; empty if it is SDR."""
        if self._metadata.code_points is not None:
            return tuple(name for name, format in WRITTEN.items() if "code_points" in format.holds)
        all = self.auxiliaries
        if all is None or all.gain_map is None:
            return ()
        held = ((name, format.held_auxiliaries(all)) for name, format in WRITTEN.items())
        return tuple(name for name, each in held if each is not None and each.gain_map is not None)

    @property
    def image(self) -> pyvips.Image:
        """The stored pixels as a libvips image."""
        return as_image(self.pixels)

    @property
    def _picture(self) -> pyvips.Image:
        """The image without a mask, which libvips would treat as transparency."""
        return as_image(self.pixels[..., :-1]) if self.masked else self.image

    def to_array(self) -> np.ndarray:
        """Returns a copy of the stored pixels, [H, W] or [H, W, bands], uint8 or uint16."""
        return self.pixels[..., 0].copy() if self.bands == 1 else self.pixels.copy()

    def to_image(self) -> Image:
        """Returns the stored pixels as a Pillow image; colours of 16 bits are rounded to 8.

        It has the EXIF and the ICC profile of the file, or the ``info`` of the Pillow image that was given.

        Raises:
            UnshutterError: Pillow is not installed.
        """
        try:
            from PIL import Image
        except ImportError:
            raise UnshutterError("images need Pillow: pip install pillow") from None
        pixels = self.to_array()
        if pixels.ndim == 3 and pixels.dtype.itemsize == 2:
            pixels = ((pixels + 128.0) / 257).astype("uint8")
        image = Image.fromarray(pixels)
        if is_pillow(self.given):
            image.info = dict(self.given.info)
        if self._metadata.exif is not None:
            image.info["exif"] = self._metadata.exif
        if self._metadata.icc is not None:
            image.info["icc_profile"] = self._metadata.icc
        return image

    def embedded_video(self) -> EmbeddedVideo | None:
        """Returns the video that belongs to the photo; None if there is none."""
        source = self._decoder.source if self._decoder is not None else None
        metadata = self._metadata
        return embedded_video(source, self.format, metadata.video, metadata.xmp, metadata.exif)

    def grey(self, short_side: int | None = None) -> np.ndarray:
        """Returns a luminance copy (Rec. 601) of the stored pixels, antialiased; transparent areas are mid-grey.

        Position p of the photo is at (p + 0.5) * h / height - 0.5 of the copy, likewise across, to 0.2 px; to 0.5 px if
        a JPEG yields a smaller copy than requested.
        JPEGs at least about twice as large are decoded at a half, quarter or eighth of their size for this, even if
        their pixels have been decoded already, so that estimates do not depend on earlier calls.

        Args:
            short_side: short side of the copy [px], up to a tenth less for JPEGs; never enlarged. None: full size.

        Returns:
            uint8 [h, w].

        Raises:
            UnshutterError: the file is damaged, incomplete, or gone; UsageError: short_side below 1.
        """
        if short_side is not None and short_side < 1:
            raise UsageError(f"a grey copy needs a short side of at least 1 px, got {short_side}")
        if self._decoder is not None:
            return self._decoder.grey(short_side)
        size = grey_size(self.height, self.width, short_side)
        return grey_copy(self._picture, *size, stated=self._metadata.code_points)

    def screen_copy(self, longest: int | None = None) -> np.ndarray:
        """Returns a copy of the stored pixels for a screen, in sRGB (using the photo's profile), flattened on grey.

        Args:
            longest: longer side [px]; never enlarged. None: full size.

        Returns:
            uint8 [h, w, 3].

        Raises:
            UnshutterError: the file is damaged, incomplete, or gone; UsageError: longest below 1.
        """
        if longest is not None and longest < 1:
            raise UsageError(f"a copy for the screen needs a longer side of at least 1 px, got {longest}")
        if self._decoder is None or longest is None:
            image = self._picture
        else:
            pixels = self._decoder.reduced(longest)
            image = as_image(pixels[..., :-1] if self.masked else pixels)
        return decoder.screen_pixels(image, *self._size_for(longest), self._metadata)

    def _size_for(self, longest: int | None) -> tuple[int, int]:
        """Returns height and width [px] of a copy whose longer side is at most this long; None: full size."""
        most = max(self.height, self.width)
        scale = 1.0 if longest is None or longest >= most else longest / most
        return max(round(self.height * scale), 1), max(round(self.width * scale), 1)

    # ---- the camera ------------------------------------------------------------------------------------

    def focal_px(self) -> float | None:
        """Returns the focal length in pixels of the stored picture from EXIF's 35 mm equivalent; None if unknown."""
        return exif.focal_px(self._metadata.exif, self.height, self.width)

    def exposure_s(self) -> float | None:
        """Returns the exposure time [s] from EXIF; None if unknown."""
        return exposure.time_s(self._metadata.exif)

    @property
    def software(self) -> str:
        """The program that wrote the file, from EXIF; empty if unknown."""
        return exif.read(self._metadata.exif).text(exif.SOFTWARE)

    def taken(self) -> datetime | None:
        """Returns the time at which the photo was taken, from EXIF, in the camera's time zone; None if unknown."""
        return exposure.taken(self._metadata.exif)

    def camera(self) -> str:
        """Returns make and model of the camera, from EXIF; empty if unknown."""
        return readout_times.camera(self._metadata.exif)

    def camera_in_words(self) -> str:
        """Returns the camera for a sentence, from EXIF: ``a Canon PowerShot A70``."""
        return readout_times.camera_in_words(self._metadata.exif)

    def setting(self) -> tuple[object, ...] | None:
        """Returns what photos of a burst have in common, from EXIF; None if this cannot be one of them."""
        return exposure.setting(self._metadata.exif)

    def bends_lines(self) -> bool:
        """Whether the lens or camera named in EXIF bends straight lines."""
        return exposure.bends_lines(self._metadata.exif)

    def is_merged(self) -> bool:
        """Whether EXIF marks the photo as merged from several exposures (HDR); its exposure time is one of theirs."""
        return exposure.is_merged(self._metadata.exif)

    def is_panorama(self) -> bool:
        """Whether the metadata call the photo a panorama, whose rows were not read out one after another."""
        return exposure.is_panorama(self._metadata.exif) or regions.is_panorama(self._metadata.xmp)

    def readout_time(self) -> ReadoutTime:
        """Returns the likely readout time for the kind of camera named in EXIF, and the shutter that it states."""
        return readout_times.readout_time(self._metadata.exif, self._metadata.xmp)

    @cached_property
    def attitude(self) -> Attitude | None:
        """The camera's attitude, as recorded by an accelerometer, level gauge or gimbal; None if unknown."""
        metadata = self._metadata
        return attitude.of_photo(metadata.exif, metadata.xmp, Orientation(self.orientation), self.height, self.width)

    # ---- writing ---------------------------------------------------------------------------------------

    @property
    def usual_format(self) -> PictureFormat:
        """The format in which it is written if none is asked for, its own if that can be written."""
        if self.format == "heic" and "jpeg" in self.hdr_formats:
            return "jpeg"
        return "png" if self.format == "array" else BY_NAME[self.format].written_as

    @property
    def times_ns(self) -> Times:
        """Access and modification time of the photo's file [ns since 1970] when it was opened.

        Raises:
            UsageError: the photo does not come from a file.
        """
        if self.opened is None or self.opened.times_ns is None:
            raise UsageError("only a photo that was read from a file has times that could be kept")
        return self.opened.times_ns

    def upright(self, longest_px: int = 0) -> np.ndarray:
        """Returns the photo as shown by a viewer: [H, W, 3] uint8 sRGB, upright, on white if transparent.

        Args:
            longest_px: long side to which the photo is reduced; 0: full size.

        Raises:
            UnshutterError: the file is damaged, incomplete, or gone.
        """
        size = self._size_for(longest_px or None)
        pixels = decoder.screen_pixels(self._picture, *size, self._metadata, behind=255)
        return Orientation(self.orientation).upright(pixels)

    def file_as(self, format: str, how: Save) -> Source | None:
        """Returns the photo's encoded data, if a result in this format with these options would be a copy of them.

        None if the pixels are new, the format differs, or a quality or subsampling is requested.
        """
        is_same = self.format == format and how.quality is how.subsampling is None
        return self._decoder.source if self._decoder is not None and is_same else None

    def _picture_for(self, format: WrittenFormat, save: Save) -> tuple[Picture, list[Part]]:
        """Returns the photo as a format can hold it, and what becomes of the parts of its file."""
        coding = self._coding
        if save.subsampling is not None:
            coding = replace(coding, subsampled=save.subsampling == "4:2:0")
        picture = Picture(self.image, self._metadata, Orientation(self.orientation), coding, save.quality)
        return saving.fitted(picture, format, is_new=self._new_pixels is not None)


SMALLEST_SIDE = 64  # px


PhotoLike: TypeAlias = "str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO | np.ndarray | Image | Photo"


def open_photo(argument: PhotoLike, max_pixels: int = MAX_PIXELS) -> Photo:
    """Opens the photo that an argument represents; files with more than ``max_pixels`` are refused.

    Bytes and streams are encoded files; floating-point pixels from 0 to 1 are converted to 16 bits; of a Pillow image,
    only the pixels are used.
    """
    if isinstance(argument, Photo):
        return argument
    if isinstance(argument, (str, os.PathLike)):
        return Photo.open(argument, max_pixels)
    if isinstance(argument, (bytes, bytearray, memoryview)):
        return Photo.from_bytes(bytes(argument), max_pixels)
    made_from = files_behind(argument)
    if callable(getattr(argument, "read", None)):
        data = cast(IO, argument).read()
        if not isinstance(data, bytes):
            raise UnshutterError("the file is open in text mode: open it in binary mode ('rb')")
        return replace(Photo.from_bytes(data, max_pixels), made_from=made_from)
    pixels, given = pixels_of(argument)
    return replace(Photo.from_array(pixels), given=given, made_from=made_from)


def files_behind(argument: object) -> Sequence[Opened]:
    """Returns the files behind an argument that :func:`open_photo` takes."""
    if isinstance(argument, Photo):
        return argument.made_from
    opened = Opened.behind(argument)
    return () if opened is None else (opened,)


def check_size(height: int, width: int, subject: str = "the photo", **files: object) -> None:
    """Checks that a picture is large enough to find or undo a motion."""
    if min(height, width) < SMALLEST_SIDE:
        size = f"{width}x{height} px"
        raise UnshutterError(f"{subject} is {size}; both sides must be at least {SMALLEST_SIDE} px", **files)
