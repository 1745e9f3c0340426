"""Results of a batch on their way out: to files, or to objects behind a URL."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.photo.formats import of_target
from unshutter.storage.places import Place, write_place

if TYPE_CHECKING:
    from unshutter.options import Save
    from unshutter.rectification import Rectified


def save_picture(result: Rectified, target: Place, overwrite: bool, may_repeat: bool, save: Save) -> None:
    """Writes a result; the format is that of the name's ending.

    Args:
        result: what to write.
        target: where to.
        overwrite: whether what is there may be replaced.
        may_repeat: whether what is there may be the same picture, byte for byte, which is then left as it is.
        save: how to write it.

    Raises:
        UsageError, UnshutterError: see ``Photo.save``.
    """
    done_before = isinstance(target, Path) and may_repeat and os.path.lexists(target)
    if isinstance(target, Path) and not done_before:
        result.save(target, overwrite=overwrite, quality=save.quality, subsampling=save.subsampling)
    else:
        name = of_target(Path(target.name)).name
        data = result.photo.to_bytes(name, save.quality, save.subsampling)
        write_place(data, target, overwrite, mode_of=result.original.path)
