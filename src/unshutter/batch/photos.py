"""Results of a batch on their way out: to files, or to objects behind a URL."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.photo import Photo
from unshutter.photo.encoding import not_written
from unshutter.photo.formats import of_target
from unshutter.storage.places import write_place

if TYPE_CHECKING:
    from unshutter.batch.job import Job
    from unshutter.frames.rectified_frame import RectifiedFrame
    from unshutter.options import Save
    from unshutter.result import Rectified


def save_picture(result: Rectified | RectifiedFrame, job: Job, overwrite: bool, save: Save) -> str:
    """Writes a job's result; the format is that of the name's ending.

    Returns:
        What the user should know: what of the metadata did not go into the file, and whether a photo that was left as
        it is had to be encoded all the same. Mostly empty.

    Raises:
        UsageError, UnshutterError: see ``Photo.save``.
    """
    target, format = job.target, of_target(Path(job.target.name))
    done_before = isinstance(target, Path) and job.may_repeat and os.path.lexists(target)
    if isinstance(target, Path) and not done_before:
        left_out = result.save(
            target,
            overwrite=overwrite,
            quality=save.quality,
            subsampling=save.subsampling,
            keep_times=save.keep_times,
        )
    else:
        file = result.encode(format.name, save.quality, save.subsampling)
        times_ns = result.photo.times_ns if save.keep_times else None
        write_place(file.data, target, overwrite, mode_of=job.source, times_ns=times_ns)
        left_out = file.left_out
    encoded = not result.changed and result.photo.file_as(format.name, save) is None
    anew = f"encoded as {format.name.upper()}" if encoded else ""
    return "; ".join(filter(None, (anew, not_written(left_out))))


def mask_file(result: Rectified | RectifiedFrame) -> bytes:
    """A PNG of the picture's pixels, as they are stored: 255 where the photo shows what belongs there, else 0."""
    import numpy as np

    return Photo.from_array(result.valid.astype(np.uint8) * 255).to_bytes("png")
