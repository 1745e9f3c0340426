"""Checks before any work on a clip: each output may be written, and none of them is a file that the run reads."""

from __future__ import annotations

import os
from pathlib import Path

from unshutter.errors import UnshutterError, UsageError
from unshutter.export.plot import check_plot
from unshutter.storage.files import check_target, remove_leftovers
from unshutter.storage.journal import JsonLog
from unshutter.storage.new_folders import remove_left_folders
from unshutter.storage.places import place
from unshutter.storage.protection import Protection
from unshutter.video import film_file, pictures
from unshutter.video.clip_preview import check_ending
from unshutter.video.options import RectifyClip


def on_this_machine(source: str) -> str:
    """A name that FFmpeg cannot take for something else: it knows ``concat:a|b``, ``subfile,...:a``, URLs.

    Raises:
        UnshutterError: it is not of a file or folder of this machine.
    """
    file = place(source)
    if not isinstance(file, Path):
        raise UnshutterError(f"{source} is not on this machine: clips are files or folders of it")
    return os.path.abspath(file) if ":" in str(file) else str(file)


def are_pictures(target: Path) -> bool:
    """Whether pictures are to be written there, rather than a film."""
    return pictures.is_pattern(str(target)) or not target.suffix or target.is_dir()


def check_targets(source: str, target: Path, options: RectifyClip) -> tuple[JsonLog | None, bool]:
    """Checks all that is to be written.

    Args:
        source: the clip, as :func:`on_this_machine` names it.
        target: where it goes.
        options: what is done.

    Returns:
        The log, where one is asked for; and whether an earlier run was killed there, whose leftovers were removed.

    Raises:
        UsageError: one name stands for two files, or has an ending of another kind of file.
        UnshutterError: something may not be written, or cannot.
    """
    check_ending(options.preview)
    if options.plot is not None:
        check_plot(options.plot)
    protection = Protection([*pictures.files_of(source), options.motion])
    named = {target.absolute()}
    for path in filter(None, (options.save_motion, options.preview, options.plot, options.json_log)):
        protection.check(path)
        if path.absolute() in named:
            raise UsageError(f"{path} is to be written twice: choose another name")
        named.add(path.absolute())
        if path is not options.json_log:
            check_target(path, options.overwrite)
            remove_leftovers(path.parent)
    protection.check(target)
    if are_pictures(target):
        leftovers = remove_left_folders(target.parent if pictures.is_pattern(str(target)) else target)
    else:
        film_file.check_ending(target.suffix)
        check_target(target, options.overwrite)
        leftovers = remove_leftovers(target.parent)
    return JsonLog(options.json_log, protection) if options.json_log is not None else None, bool(leftovers)
