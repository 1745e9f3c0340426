"""The source of encoded data: a file or memory."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from unshutter.errors import UnshutterError
from unshutter.photo.libvips import libvips

if TYPE_CHECKING:
    import pyvips


@dataclass(frozen=True)
class Source:
    """Encoded data: a file, or bytes in memory."""

    place: Path | bytes

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
        return self.place.stat().st_size if isinstance(self.place, Path) else len(self.place)

    def stream(self) -> BinaryIO:
        """Opens a new stream at the beginning; raises OSError if the file cannot be read."""
        return self.place.open("rb") if isinstance(self.place, Path) else io.BytesIO(self.place)

    def data(self) -> bytes:
        """Returns all data.

        Raises:
            UnshutterError: the file cannot be read.
        """
        if isinstance(self.place, bytes):
            return self.place
        try:
            return self.place.read_bytes()
        except OSError as error:
            raise UnshutterError(f"cannot read {{photo}}: {error.strerror}", photo=self) from None

    def copy_to(self, path: Path) -> None:
        """Copies the data to a file; raises OSError on failure."""
        if isinstance(self.place, Path):
            import shutil  # imported here: most photos are not copied

            shutil.copyfile(self.place, path)
        else:
            path.write_bytes(self.place)

    def patched(self, places: Sequence[int], data: bytes) -> Source:
        """Returns a copy in memory with bytes replaced at each place; raises OSError if the file cannot be read."""
        with self.stream() as stream:
            copy = bytearray(stream.read())
        for at in places:
            copy[at : at + len(data)] = data
        return Source(bytes(copy))

    def load(self, operation: str, **options: Any) -> pyvips.Image:
        """Opens the picture lazily with one of libvips's loaders; raises ``pyvips.Error`` if that fails."""
        image = libvips().Image
        if isinstance(self.place, Path):  # encoded, because names need not be valid text
            return getattr(image, operation)(os.fsencode(self.place), **options)
        return getattr(image, operation + "_buffer")(self.place, **options)
