"""Results of a batch on their way out: to files, or to objects behind a URL."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.photo.codecs import for_suffix
from unshutter.storage.places import Place, write_place

if TYPE_CHECKING:
    from unshutter.options import Save
    from unshutter.rectification import Rectified


def save_picture(result: Rectified, target: Place, overwrite: bool, save: Save) -> None:
    """Writes a result; the format is that of the name's ending.

    Raises:
        UsageError, UnshutterError: see ``Photo.save``.
    """
    if isinstance(target, Path):
        result.save(target, overwrite=overwrite, quality=save.quality, subsampling=save.subsampling)
    else:
        name = for_suffix(Path(target.name)).name
        write_place(result.photo.to_bytes(name, save.quality, save.subsampling), target)
