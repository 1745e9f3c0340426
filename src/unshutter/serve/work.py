"""What lanes do with a photo for files, as the command line would; NumPy and the like are loaded only there."""

from __future__ import annotations

import os
from pathlib import Path

from unshutter.batch.job import Job, Outcome
from unshutter.errors import UnshutterError
from unshutter.options import Find, Rectify, Reference
from unshutter.serve.held import Held, found_motion, in_one_line, motion_file, opened


def warm() -> int:
    """Loads what the first photo would wait for; returns the number of this process."""
    import unshutter.rectification
    import unshutter.warp.pixels  # noqa: F401
    from unshutter.estimators.register import load
    from unshutter.photo.libvips import libvips

    libvips()
    load().prepare()
    return os.getpid()


def estimated(held: Held, find: Find, reference: Reference) -> str:
    """The photo's motion as JSON, as `unshutter estimate` writes it.

    Raises:
        UnshutterError: the photo cannot be read.
    """
    return in_one_line(held, lambda: found_motion(held, opened(held), find).rereferenced(reference).to_json() + "\n")


def saved(held: Held, target: Path, wanted: Rectify) -> Outcome:
    """Writes the rectified photo as `unshutter rectify` does, to the byte; what goes wrong is in the outcome."""
    from unshutter.batch.work import do_job

    motion = None
    if wanted.neighbours:
        pass  # who say it anew
    elif wanted.motion is None:
        cached = motion_file(held, wanted.find)
        motion = cached.read_text(encoding="utf-8") if cached.exists() else None
    else:
        from unshutter.motion import Motion

        try:
            motion = Motion.load(wanted.motion).to_json()
        except UnshutterError as error:
            return Outcome(str(error).replace(str(wanted.motion), "the motion"))
    job = Job(held.path, target, None, overwrite=False, max_pixels=held.max_pixels)
    return do_job(job, wanted, motion)
