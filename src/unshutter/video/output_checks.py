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
    """Returns a name that FFmpeg cannot misread: it interprets ``concat:a|b``, ``subfile,...:a`` and URLs.

    Raises:
        UnshutterError: it is not a file or folder on this machine.
    """
    file = place(source)
    if not isinstance(file, Path):
        raise UnshutterError(f"{source} is not on this machine: clips are files or folders of it")
    return os.path.abspath(file) if ":" in str(file) else str(file)


def are_pictures(target: Path) -> bool:
    """Whether the output is a sequence of pictures rather than a film."""
    return pictures.is_pattern(str(target)) or not target.suffix or target.is_dir()


def check_targets(source: str, target: Path, options: RectifyClip) -> tuple[JsonLog | None, bool]:
    """Checks all outputs.

    Args:
        source: the clip, as :func:`on_this_machine` names it.
        target: the output.
        options: the user's options.

    Returns:
        The log, if requested; and whether leftovers of an earlier, killed run were removed there.

    Raises:
        UsageError: one name stands for two files, or has a file ending of another kind.
        UnshutterError: an output must not or cannot be written.
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
