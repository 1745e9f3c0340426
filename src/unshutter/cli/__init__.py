"""The command line: names, arguments and output of the commands, whose work is done elsewhere.

SIGTERM and SIGHUP end the program as Ctrl-C does: finished results are kept, partial files removed.
"""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import threading
from contextlib import suppress
from importlib import import_module
from pathlib import PurePath
from types import FrameType
from typing import NoReturn

from unshutter import version
from unshutter.cli.arguments import Command, parse
from unshutter.errors import UnshutterError, UsageError, shortened
from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.options.picture_formats import SUFFIXES
from unshutter.progress import tell
from unshutter.version import __version__


class Stopped(KeyboardInterrupt):
    """Raised when a signal asks the program to end."""

    def __init__(self, number: int):
        super().__init__()
        self.exit_code = 128 + number


def stop_on_signals() -> None:
    """Makes these signals raise :class:`Stopped`; signals that are ignored, as under ``nohup``, remain ignored.

    So does Ctrl-C raise KeyboardInterrupt. Where FFmpeg has called what runs, they are raised a moment later.
    """
    for name in ("SIGTERM", "SIGHUP", "SIGINT"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _stop)


def open_missing_streams() -> None:
    """Opens the null device for each standard stream that the process was started without.

    Otherwise the next file that is opened takes its number, and what a library prints would be written into it.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest free number is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 (until the process ends)


def _stop(number: int, frame: FrameType | None) -> None:
    pyav = sys.modules.get("unshutter.frames.pyav")
    if pyav is not None and pyav.is_called_back(frame):
        threading.Timer(0.005, signal.raise_signal, [number]).start()
        return
    raise KeyboardInterrupt if number == signal.SIGINT else Stopped(number)


# name -> its variable in this folder. Other packages add commands by entry points.
COMMANDS = {
    "rectify": "photo_commands:RECTIFY",
    "video": "clip_command:VIDEO",
    "measure": "clip_command:MEASURE",
    "cameras": "other_commands:CAMERAS",
    "estimate": "photo_commands:ESTIMATE",
    "map": "other_commands:MAP",
    "serve": "other_commands:SERVE",
    "open": "other_commands:OPEN",
    "points": "other_commands:POINTS",
    "poses": "poses_command:COMMAND",
    "models": "other_commands:MODELS",
    "completion": "other_commands:COMPLETION",
}
_GROUP = "unshutter.commands"
_ABOUT = "Removes rolling-shutter distortion from photos and video. Originals are never changed."


def run() -> NoReturn:
    """Runs the program: calls :func:`main` and exits with its exit code."""
    stop_on_signals()
    open_missing_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # not every file name is printable on every terminal
            stream.reconfigure(errors="backslashreplace")
    code = main()
    for stream in filter(None, (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except BrokenPipeError:  # the process reading our output has exited
            code = code or 1
        except OSError as error:
            code = code or _say(f"cannot write the output: {error.strerror}", 1)
    gc.freeze()  # the process is about to end: searching for reference cycles would only take time
    sys.exit(code)


def main(words: list[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 success, 1 something failed, 2 wrong usage."""
    # NumPy's own threads are rarely used, but while it is imported they spin on the cores that decode.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        return _run_command(sys.argv[1:] if words is None else words)
    except UsageError as error:
        return _say(str(error), 2)
    except UnshutterError as error:
        return _say(str(error), 1)
    except BrokenPipeError:  # the process reading our output has exited
        if sys.stdout is not None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:  # for example, output goes to a full disc
        what = error.strerror or str(error)
        return _say(f"{error.filename}: {what}" if error.filename else what, 1)
    except ImportError as error:  # a library is missing or damaged, or Ctrl-C came while one was being loaded
        cause = " ".join(str(error).split())
        return _say(f"cannot load a library that it needs; if that persists, install it again: {cause}", 1)
    except MemoryError:
        return _say("not enough memory", 1)
    except KeyboardInterrupt as stop:
        return _say("stopped before anything was done", _exit_code(stop))


def _run_command(words: list[str]) -> int:
    name = words[0] if words else "--help"
    if default := command_for_file(name):
        name = default
        words = [default, *words]
    if name in ("-h", "--help", "--help-all", "help"):
        print(_help())
    elif name == "--version":
        print(__version__)
    else:
        command = command_named(name)
        try:
            arguments = parse(name, command, words[1:])
        except SystemExit:  # help was requested
            return 0
        try:
            return command.run(arguments)
        except KeyboardInterrupt as stop:
            return _say(f"stopped; {command.when_stopped}", _exit_code(stop))
    return 0


def command_for_file(name: str) -> str:
    """Returns the command for a first word that is a file, ``rectify`` or ``video``; empty if it is not one."""
    if name.startswith("-") or name in (*COMMANDS, "help"):
        return ""
    suffix = PurePath(name).suffix.lower()
    if suffix in VIDEO_FORMATS:
        return "video"
    return "rectify" if suffix in SUFFIXES or os.path.exists(name) else ""


def _exit_code(stop: KeyboardInterrupt) -> int:
    return stop.exit_code if isinstance(stop, Stopped) else 130


def command_named(name: str) -> Command:
    """Finds a command by name, built in or from another installed package."""
    if name in COMMANDS:
        module, _, variable = COMMANDS[name].partition(":")
        return getattr(import_module(f"unshutter.cli.{module}"), variable)
    for entry in version.plugins(_GROUP).select(name=name):
        return entry.load()
    if name.startswith("-"):
        raise UsageError(
            f"options come after the command: unshutter rectify PHOTO {shortened(name)} ... (see unshutter --help)"
        )
    guess = version.choices(name, summaries(), _GROUP)
    raise UsageError(f"unknown command '{shortened(name)}': {guess} (see unshutter --help)")


def summaries() -> dict[str, str]:
    """Returns the summaries of all commands by name, those of other installed packages last."""
    own = {name: command_named(name).summary for name in COMMANDS}
    others = {entry.name: entry for entry in version.plugins(_GROUP) if entry.name not in own}
    return own | {name: entry.load().summary for name, entry in sorted(others.items())}


def _help() -> str:
    commands = summaries()
    width = max(map(len, commands))
    lines = [f"  {name.ljust(width)}  {what}" for name, what in commands.items()]
    usage = """usage: unshutter PHOTO ...     straighten photos, as unshutter rectify does
       unshutter COMMAND ...   (unshutter COMMAND --help lists its usual options)
       unshutter --version"""
    return "\n".join([usage, "", _ABOUT, "", "commands:", *lines])


def _say(message: str, code: int) -> int:
    with suppress(OSError):  # the terminal is closed
        tell(f"unshutter: {message}")
    return code
