"""libvips: its import on demand, its input, its errors in plain words, and its images as arrays."""

from __future__ import annotations

import io
import math
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, BinaryIO

from unshutter.errors import MissingFileError, UnshutterError, UsageError
from unshutter.storage import files
from unshutter.storage.opened import Opened

if TYPE_CHECKING:
    import numpy as np
    import pyvips


@dataclass(frozen=True)
class Source:
    """Encoded data: a file, or bytes in memory."""

    place: Path | bytes
    opened: Opened | None = None  # the file as it was when its header was read; None for bytes in memory

    @classmethod
    def of_file(cls, path: Path) -> Source:
        """Returns the data of a file as it is now; once the file is changed or replaced, its pixels are refused."""
        return cls(path, Opened.at(path))

    def __str__(self) -> str:
        return str(self.place) if isinstance(self.place, Path) else "the picture in memory"

    @property
    def path(self) -> Path | None:
        """The path of the file, if it is one."""
        return self.place if isinstance(self.place, Path) else None

    @property
    def suffix(self) -> str:
        """The extension of the file's name in lower case; empty for bytes in memory."""
        return self.place.suffix.lower() if isinstance(self.place, Path) else ""

    @property
    def length(self) -> int:
        """Length of the data in bytes; raises OSError if the file no longer exists."""
        return self._file.stat().st_size if isinstance(self.place, Path) else len(self.place)

    def stream(self) -> BinaryIO:
        """Opens a new stream at the beginning; raises OSError if the file cannot be read."""
        return self._file.open("rb") if isinstance(self.place, Path) else io.BytesIO(self.place)

    def data(self) -> bytes:
        """Returns all data."""
        if isinstance(self.place, bytes):
            return self.place
        try:
            with self.unchanged():
                return self._file.read_bytes()
        except OSError as error:
            raise UnshutterError(f"cannot read {{photo}}: {error.strerror}", photo=self) from None

    def copy_to(self, path: Path) -> None:
        """Copies the data to a file; raises OSError on failure."""
        if isinstance(self.place, Path):
            if not self._file.exists():
                raise MissingFileError("cannot read {photo}: it is no longer there", photo=self)
            with self.unchanged():
                shutil.copyfile(self._file, path)
        else:
            path.write_bytes(self.place)

    def load(self, operation: str, **options: Any) -> pyvips.Image:
        """Opens the picture lazily with one of libvips's loaders; raises ``pyvips.Error`` if that fails."""
        image = libvips().Image
        if isinstance(self.place, Path):  # encoded, because names need not be valid text
            # libvips remembers pictures by their file's name, and would return that of an earlier file
            return getattr(image, operation)(os.fsencode(self._file), revalidate=True, **options)
        return getattr(image, operation + "_buffer")(self.place, **options)

    @contextmanager
    def unchanged(self) -> Iterator[None]:
        """Raises UnshutterError, before or after the block, if the file is no longer the one that was opened."""
        self._check_unchanged()
        yield
        self._check_unchanged()

    def _check_unchanged(self) -> None:
        if self.opened is not None and self.opened.was_replaced():
            raise UnshutterError("{photo} was changed or replaced after it was opened: open it again", photo=self)

    @property
    def _file(self) -> Path:
        """The file, from whatever working folder."""
        assert isinstance(self.place, Path)
        return self.place if self.opened is None else self.opened.path


_forked = False  # whether this process was forked from one that had loaded libvips


@cache
def libvips() -> Any:
    """Imports pyvips, without libvips's log, which repeats errors on standard error, not always as text."""
    if _forked:
        raise UsageError(
            "this process was forked from one that had worked on photos, which libvips does not support: start it "
            "with ProcessPoolExecutor(mp_context=multiprocessing.get_context('spawn'))"
        )
    first = "pyvips" not in sys.modules  # otherwise the log is the business of whoever imported it
    if first:
        os.environ.setdefault("VIPS_WARNING", "1")
    import pyvips

    if first:
        getattr(pyvips, "_remove_log_handler", lambda: None)()
    if sys.platform != "win32":
        os.register_at_fork(after_in_child=_remember_the_fork)
    return pyvips


def _remember_the_fork() -> None:
    global _forked
    _forked = True
    libvips.cache_clear()


@contextmanager
def refusing(what: str, **files: object) -> Iterator[None]:
    """Converts errors of libvips to an UnshutterError: ``what``, with its files in braces, and the cause."""
    vips = libvips()
    _take_notes()
    try:
        yield
    except (vips.Error, UnicodeDecodeError) as error:  # pyvips decodes libvips's messages as text
        notes = _take_notes() if isinstance(error, UnicodeDecodeError) else f"{error.detail}\n{error.message}"
        raise UnshutterError(f"{what}: {_cause(notes)}", **files) from error


def _take_notes() -> str:
    """Returns libvips's messages, and clears them."""
    vips = libvips()
    notes = vips.ffi.string(vips.vips_lib.vips_error_buffer()).decode(errors="replace")
    vips.vips_lib.vips_error_clear()
    return notes


def _cause(notes: str) -> str:
    """Extracts the cause from libvips's messages: the system's if there is one, otherwise the first."""
    lines = [line.strip() for line in notes.splitlines() if line.strip()]
    system = [line.removeprefix("system error: ") for line in lines if line.startswith("system error: ")]
    known = [line for line in system if not line.startswith("Unknown error")]
    lines = [line for line in lines if "bad seek" not in line]  # libheif seeks beyond the end to find it
    return (known or [in_plain_words(line) for line in lines] or ["unknown"])[0]


_TOO_SHORT = re.compile(
    r"premature end|end of (file|data|input|stream)|insufficient|truncated|got \d+ bytes|read error at scanline", re.I
)
_SPOILT = re.compile(
    r"corrupt|decoding error|read error|unable to (read|parse|call|decode)|error during reading|bad huffman|checksum",
    re.I,
)


def in_plain_words(complaint: str) -> str:
    """Rephrases a decoder's message without the names of libraries and their functions."""
    if _TOO_SHORT.search(complaint) and "Corrupt" not in complaint:
        return "it ends too early"
    if _SPOILT.search(complaint):
        return "part of its data cannot be decoded"
    return re.sub(r"^((\w+: )+)(?=\S)", "", complaint)


# ---- threads and their memory --------------------------------------------------------------------------

_encoding = Lock()


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Sets the number of threads used by libvips, regardless of the machine and VIPS_CONCURRENCY.

    Needed for encoders whose output depends on this number. It applies to all of libvips in this process until the
    block is left; only one such block runs at a time.
    """
    vips = libvips().vips_lib
    with _encoding:
        usual = vips.vips_concurrency_get()
        vips.vips_concurrency_set(count)
        try:
            yield
        finally:
            vips.vips_concurrency_set(usual)


@contextmanager
def memory_returned() -> Iterator[None]:
    """Returns what the threads of libheif's coders freed to the system: glibc would keep it, a gigabyte in a batch."""
    try:
        yield
    finally:
        if sys.platform == "linux":
            import ctypes  # imported here: most formats do not need it

            getattr(ctypes.CDLL(None), "malloc_trim", int)(0)  # musl has none


# ---- images --------------------------------------------------------------------------------------------


def field(image: pyvips.Image, name: str, default: Any = None) -> Any:
    """Returns a metadata field of libvips, or the default."""
    return image.get(name) if image.get_typeof(name) else default


def set_blob(image: pyvips.Image, name: str, data: bytes) -> None:
    """Sets a metadata field to bytes."""
    image.set_type(libvips().GValue.blob_type, name, data)  # pyright: ignore[reportArgumentType]


def standard(image: pyvips.Image) -> pyvips.Image:
    """Returns the image with the colour interpretation for its bands and bits, on which libvips's operations depend."""
    if image.format not in ("uchar", "ushort") or not 1 <= image.bands <= 4:
        raise UnshutterError(f"a photo has 1 to 4 bands of 8 or 16 bits, not {image.bands} of {image.format}")
    deep = image.format == "ushort"
    meaning = ("grey16" if deep else "b-w") if image.bands < 3 else ("rgb16" if deep else "srgb")
    return image if image.interpretation == meaning else image.copy(interpretation=meaning)


def to_8_bits(image: pyvips.Image) -> pyvips.Image:
    """Converts 16 bits to 8, rounding (65535 -> 255); images of 8 bits are returned unchanged."""
    return standard(image.linear([255 / 65535], [0.5], uchar=True)) if image.format == "ushort" else image


def in_srgb(image: pyvips.Image, profile: bytes, bits: int | None = None) -> pyvips.Image:
    """Converts the image, of 8 or 16 bits, from the colours of an ICC profile to sRGB.

    Raises ``pyvips.Error`` if they do not match. Without ``bits``, samples keep their size.
    """
    image = image.copy()
    set_blob(image, "icc-profile-data", profile)
    return image.icc_transform("srgb", embedded=True, depth=bits or (16 if image.format == "ushort" else 8))


# ---- images and arrays ---------------------------------------------------------------------------------


def computed(image: pyvips.Image) -> np.ndarray:
    """Computes the pixels [H, W, bands] of an image, read-only; raises ``pyvips.Error`` on failure."""
    shape = image.height, image.width, image.bands
    dtype, size = {"uchar": ("uint8", 1), "ushort": ("uint16", 2)}[str(image.format)]
    fits = math.prod(shape) * size <= files.SPILL_BYTES
    data = image.write_to_memory() if fits else b""  # the long part; NumPy may be imported at the same time
    import numpy as np

    if fits:
        pixels = np.frombuffer(data, dtype).reshape(shape)
        pixels.setflags(write=False)
        return pixels
    with files.nameless_file() as file:
        image.rawsave_target(libvips().Target.new_to_descriptor(file.fileno()))
        return np.memmap(file, dtype=dtype, mode="r", shape=shape)


def as_image(pixels: np.ndarray) -> pyvips.Image:
    """Wraps pixels [H, W, bands] as a libvips image, without copying if it can, as :func:`standard` says."""
    height, width, bands = pixels.shape
    kind = {"uint8": "uchar", "uint16": "ushort"}[pixels.dtype.name]
    return standard(
        libvips().Image.new_from_memory(
            pixels if pixels.flags.c_contiguous else pixels.copy(), width, height, bands, kind
        )
    )


def with_bands(array: np.ndarray) -> np.ndarray:
    """Returns the array as pixels [H, W, bands] of a photo."""
    import numpy as np  # imported here: reading a file, which starts first, does not need it

    array = np.asarray(array)
    if array.dtype not in (np.uint8, np.uint16):
        raise UnshutterError(f"a photo needs pixels of type uint8 or uint16, got {array.dtype}")
    if array.ndim not in (2, 3) or 0 in array.shape or (array.ndim == 3 and array.shape[2] > 4):
        raise UnshutterError(f"a photo needs pixels of shape [H, W] or [H, W, 1..4], got {list(array.shape)}")
    return array.reshape(*array.shape[:2], -1)
