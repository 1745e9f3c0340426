"""Results of a batch on their way out: to files, or to objects behind a URL."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.photo.formats import of_target
from unshutter.storage.places import write_place

if TYPE_CHECKING:
    from unshutter.batch.job import Job
    from unshutter.options import Save
    from unshutter.rectification import Rectified


def save_picture(result: Rectified, job: Job, overwrite: bool, save: Save) -> tuple[str, ...]:
    """Writes a job's result; the format is that of the name's ending.

    Returns:
        What of the metadata did not go into the file.

    Raises:
        UsageError, UnshutterError: see ``Photo.save``.
    """
    target = job.target
    done_before = isinstance(target, Path) and job.may_repeat and os.path.lexists(target)
    if isinstance(target, Path) and not done_before:
        return result.photo.save(target, save.quality, overwrite, save.subsampling, save.keep_times)
    file = result.photo.encode(of_target(Path(target.name)).name, save.quality, save.subsampling)
    times_ns = result.photo.times_ns if save.keep_times else None
    write_place(file.data, target, overwrite, mode_of=job.source, times_ns=times_ns)
    return file.left_out
