"""Where encoded data lie: in a file, or in memory."""

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
        """The file, if it is one."""
        return self.place if isinstance(self.place, Path) else None

    @property
    def suffix(self) -> str:
        """The ending of the file's name in lower case; empty for bytes in memory."""
        return self.place.suffix.lower() if isinstance(self.place, Path) else ""

    @property
    def length(self) -> int:
        """Of the data, in bytes; OSError where the file is gone."""
        return self.place.stat().st_size if isinstance(self.place, Path) else len(self.place)

    def stream(self) -> BinaryIO:
        """A new stream at the beginning; OSError where the file cannot be read."""
        return self.place.open("rb") if isinstance(self.place, Path) else io.BytesIO(self.place)

    def data(self) -> bytes:
        """All of them.

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
        """Fills a file with them; OSError where that fails."""
        if isinstance(self.place, Path):
            import shutil  # not above: most photos are not copied

            shutil.copyfile(self.place, path)
        else:
            path.write_bytes(self.place)

    def patched(self, places: Sequence[int], data: bytes) -> Source:
        """A copy in memory with some bytes replaced at each of the places; OSError where it cannot be read."""
        with self.stream() as stream:
            copy = bytearray(stream.read())
        for at in places:
            copy[at : at + len(data)] = data
        return Source(bytes(copy))

    def load(self, operation: str, **options: Any) -> pyvips.Image:
        """The picture by one of libvips's loaders, lazily; ``pyvips.Error`` where it cannot make sense of it."""
        image = libvips().Image
        if isinstance(self.place, Path):  # as bytes: names need not be text
            return getattr(image, operation)(os.fsencode(self.place), **options)
        return getattr(image, operation + "_buffer")(self.place, **options)
