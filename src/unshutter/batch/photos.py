"""Photos of a batch, in and out: files, or objects behind a URL."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.photo import Photo
from unshutter.photo.codecs import for_suffix
from unshutter.storage.places import Place, read_place, write_place

if TYPE_CHECKING:
    from unshutter.photo.codecs import Subsampling
    from unshutter.rectification import Rectified


def open_photo(where: Place, max_pixels: int) -> Photo:
    """The photo of a place.

    Raises:
        UnshutterError: see ``Photo.open``.
    """
    return Photo.open(where, max_pixels) if isinstance(where, Path) else Photo.from_bytes(read_place(where), max_pixels)


def save_picture(
    result: Rectified, target: Place, overwrite: bool, quality: int | None, subsampling: Subsampling | None
) -> None:
    """Writes a result; the format is that of the name's ending.

    Raises:
        UsageError, UnshutterError: see ``Photo.save``.
    """
    if isinstance(target, Path):
        result.save(target, overwrite=overwrite, quality=quality, subsampling=subsampling)
    else:
        write_place(result.photo.to_bytes(for_suffix(Path(target.name)).name, quality, subsampling), target)
