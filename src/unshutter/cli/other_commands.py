"""The small commands: ``completion``, ``map``, ``points``, ``models``, ``cameras``, ``serve`` and ``open``."""

from __future__ import annotations

import argparse
import json
from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Literal

from unshutter.cli import Stopped, command_named, summaries
from unshutter.cli.arguments import HELP_ALL, Command, add_arguments
from unshutter.errors import UnshutterError
from unshutter.options import Find, Reference, option
from unshutter.options.fields import positional
from unshutter.page.settings import Settings
from unshutter.progress import tell
from unshutter.single.register import describe_methods, names
from unshutter.storage.locations import RunFiles
from unshutter.version import extra

SHELLS = ("bash", "zsh", "fish", "tcsh", "powershell")  # supported by shtab
_FILES = {"PATH", "FILE", "FOLDER"}  # metavars


@dataclass(frozen=True)
class Completion:
    """Arguments of ``unshutter completion``."""

    shell: str = field(metadata={"help": "Shell to write completions for.", "positional": True, "choices": SHELLS})


def complete(arguments: Completion) -> int:
    """Prints the script with which a shell completes commands, options, choices, methods and files."""
    import shtab

    shell = arguments.shell
    if shell not in shtab.SUPPORTED_SHELLS:
        raise UnshutterError(f"shtab {shtab.__version__} knows no {shell}: pip install --upgrade shtab")
    print(shtab.complete(_whole_parser(shtab.FILE), shell))
    return 0


def _whole_parser(files: object) -> argparse.ArgumentParser:
    """Creates a parser of all commands for shtab; it is never used to parse."""
    whole = argparse.ArgumentParser("unshutter")
    whole.add_argument("--version", action="store_true", help="print the version")
    commands = whole.add_subparsers()
    for name, what in summaries().items():
        command = command_named(name)
        parser = commands.add_parser(name, help=what)
        parser.add_argument(HELP_ALL, action="store_true", help="show all options")
        for action in add_arguments(parser, command.arguments):
            _complete(action, files)
    return whole


def _complete(action: argparse.Action, files: object) -> None:
    """Adds completions that shtab cannot derive from the parser."""
    if action.choices is not None:
        return
    if action.dest in ("estimator", "estimators"):
        action.choices = names()
    elif action.metavar in _FILES or not action.option_strings:
        action.complete = files  # type: ignore[attr-defined]  # read by shtab


COMPLETION = Command(
    """Print what a shell needs to complete these commands and their options.

bash: unshutter completion bash > ~/.local/share/bash-completion/completions/unshutter
zsh:  unshutter completion zsh > FOLDER/_unshutter
fish: unshutter completion fish > ~/.config/fish/completions/unshutter.fish

For zsh, FOLDER is one of those in $fpath.""",
    Completion,
    complete,
)


@dataclass(frozen=True)
class Map:
    """Arguments of ``unshutter map``."""

    source: Path = positional("Photo, or the motion file (.json) of one.", "input")
    output: Path = option(
        MISSING,
        "Map to write: .npz (map_x, map_y for cv2.remap), .exr (needs the extra `exr`) or .tif (ST map).",
        names="output",
        short="-o",
    )
    inverse: bool = option(False, "Write the inverse map, from the straightened picture back to the photo.")
    size: str | None = option(
        None,
        "Width and height of the map, for a scaled copy of the photo. Default: same as the photo.",
        metavar="WxH",
        names="word",
    )
    reference: Reference | None = option(
        None, "Row whose capture time the result shows. Default: taken from the motion file, otherwise first."
    )
    overwrite: bool = option(False, "Replace existing outputs.")
    find: Find = field(default_factory=Find)


def _map(arguments: Map) -> int:
    """Writes the map and reports it; returns the exit code."""
    from unshutter.export import map_file

    found = map_file(**vars(arguments))
    note = f" (changes nothing: {found.reason})" if found.reason else ""
    tell(f"{arguments.source} -> {arguments.output}{note}")
    return 0


MAP = Command(
    """Write a photo's correction as a map for other programs.

The map is for OpenCV (.npz) or an ST map (.exr, .tif).""",
    Map,
    _map,
    when_stopped="no half-written file is left",
    essentials={
        "source": "photo, or the motion file of one",
        "output": "map to write: .npz, .exr (extra `exr`) or .tif",
        "inverse": "from the straightened picture to the photo",
        "size": "of the map, for a scaled copy of the photo",
        "reference": "row of the picture's moment: first, middle or last",
        "overwrite": "replace an existing map",
    },
)


@dataclass(frozen=True)
class Points:
    """Arguments of ``unshutter points``."""

    motion: Path = positional("Motion file (.json) of the photo.", "input")
    table: Path = positional(
        "CSV file with columns x and y, in px of the stored photo; other columns are kept.", "input"
    )
    output: Path = option(MISSING, "CSV file to write.", names="output", short="-o")
    inverse: bool = option(False, "From the straightened picture to the photo.")
    first_pixel: Literal["0", "0.5"] = option(
        "0", "Coordinate of the first pixel's centre: 0 (OpenCV) or 0.5 (COLMAP). Default: 0."
    )
    overwrite: bool = option(False, "Replace existing outputs.")


def _points(arguments: Points) -> int:
    """Moves the points and reports how many; returns the exit code."""
    from unshutter.export import move_file
    from unshutter.motion import Motion

    RunFiles(arguments)
    motion = Motion.load(arguments.motion)
    first = float(arguments.first_pixel)
    total, unseen = move_file(motion, arguments.table, arguments.output, arguments.inverse, first, arguments.overwrite)
    note = f", {unseen} of them outside the photo" if unseen else ""
    tell(f"{arguments.table} -> {arguments.output}: {total} points{note}")
    return 0


POINTS = Command(
    "Move points of a photo to where they are in the straightened picture, or back.",
    Points,
    _points,
    when_stopped="no half-written file is left",
)


@dataclass(frozen=True)
class Models:
    """Arguments of ``unshutter models``: none."""


def _models(arguments: Models) -> int:
    """Prints the list of methods."""
    print(describe_methods())
    return 0


MODELS = Command("List the methods: what each does, how large it is, how well it did.", Models, _models)


@dataclass(frozen=True)
class Cameras:
    """Arguments of ``unshutter cameras``."""

    word: list[str] = positional("List only cameras with these words in their name.", "word", optional=True)
    lenses: bool = option(False, "List lenses and their fields of view instead.")
    json: bool = option(False, "Print the lines of the table as JSON.")


def _cameras(arguments: Cameras) -> int:
    """Prints the list of cameras, of the modes of those that have a word in their name, or of lenses."""
    from unshutter.video.calibrate import cameras, lenses

    word = " ".join(arguments.word)
    has_modes = bool(cameras.named(cameras.table(), word))
    if arguments.lenses or (not has_modes and lenses.named_lenses(word)):  # some cameras have lenses only
        found = lenses.listed(word)
        text = lenses.describe_lenses(found)
    else:
        found = cameras.listed(word)
        text = cameras.describe_modes(found) if word else cameras.describe_cameras(found)
    print(json.dumps([each.as_json() for each in found], indent=1) if arguments.json else text)
    return 0


CAMERAS = Command(
    """List the cameras whose readout time is known, for clips.

Each line has a camera, the number of its modes and its readout times. With a word, each has camera and lens, frame size
and rate, and readout time. `unshutter video --camera NAME` takes these times. They come from Gyroflow's lens profiles
(CC0), where users share what they measured.""",
    Cameras,
    _cameras,
)


def serve(arguments: Settings) -> int:
    """Serves the page until Ctrl-C; returns the exit code."""
    try:
        from unshutter.page.server import serve
    except ImportError as error:
        raise UnshutterError(f"the page needs the extra: {extra('web')} ({error})") from None
    try:
        return serve(arguments)
    except KeyboardInterrupt as stop:
        if isinstance(stop, Stopped):  # a signal that means more than the end of the session
            raise
        return 0


SERVE = Command(
    """Open a page for photos and clips in the browser: before and after, corrections, saving.

It is for this machine only: your files stay on it, in a temporary folder that is removed when the page stops. Needs the
extra `web`, and `video` for clips.""",
    Settings,
    serve,
)


@dataclass(frozen=True)
class Open:
    """Arguments of ``unshutter open``."""

    file: list[Path] = positional("Photos and clips to open, or folders of them.", "input", optional=True)


def _open(arguments: Open) -> int:
    """Opens the page in the browser; returns the exit code."""
    from unshutter.page.launch import open_page

    return open_page(arguments.file)


OPEN = Command(
    """Open photos and clips on the page, in the browser.

A page that runs already gets a new tab. Otherwise, one is started, which ends soon after its last tab was closed. Needs
the extra `web`, and `video` for clips.""",
    Open,
    _open,
)
