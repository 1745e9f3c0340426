"""Standard input and output in place of files, which ``-`` stands for.

What comes in is kept in a temporary file, and what goes out is passed on when it is complete: commands work on files,
results have the bytes that they would have there, and a reader gets a whole result or nothing.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from unshutter.errors import UnshutterError, UsageError, stand_ins
from unshutter.frames.pyav import VIDEO_FORMATS, av, open_to_read
from unshutter.photo.decoder import recognise
from unshutter.photo.libvips import Source
from unshutter.run.inputs import picture_name, unchanged_name, usual_format, video_name

PIPE = "-"
_INPUT = "standard input"
_OUTPUT = "standard output"
_CHUNK = 1 << 20  # bytes
_LARGEST_PHOTO = 1 << 32  # bytes: what most formats can hold


class Pipes:
    """The files in a temporary folder that stand for a command's standard input and output; none if it uses neither.

    Args:
        source: the only input, or an empty text if there are several.
        output: where results go, if that was said.
        what: what goes out, as the command calls it: ``a photo``.
    """

    def __init__(self, source: str, output: str | None, what: str):
        self.is_read = source == PIPE
        self.is_written = output == PIPE or (output is None and self.is_read)
        self._what = what
        if self.is_read and sys.stdin.isatty():
            raise UsageError(f"standard input is the terminal: pipe {what} into it, or give the name of a file")
        if self.is_written and sys.stdout.isatty():
            raise UsageError(f"{what} cannot be shown in a terminal: give {{--output}} FILE, or add > FILE")
        if self.is_written and source and not self.is_read:
            _check_not_appended(Path(source))
        if self.is_read or self.is_written:
            self._kept_in = TemporaryDirectory(prefix="unshutter-")
            self._folder = Path(self._kept_in.name)
            stand_ins[str(self._folder / "stdin")] = _INPUT

    def __enter__(self) -> Pipes:
        return self

    def __exit__(self, *error: object) -> None:
        """Removes the files; messages that are printed later still call them by what they stand for."""
        if self.is_read or self.is_written:
            self._kept_in.cleanup()

    @property
    def results(self) -> Path:
        """The folder of the file that is sent to standard output."""
        return self._folder / "out"

    def keep_photo(self) -> Path:
        """Saves the photo from standard input; returns the file, which has the ending of its format."""
        kept = self._keep(is_photo=True)
        return self._rename(kept, recognise(Source.of_file(kept)).row.suffixes[0])

    def keep_clip(self, output: str | None) -> Path:
        """Saves the clip from standard input; returns the file, with the output's ending if containers agree."""
        kept = self._keep()
        if _is_photo(kept):
            raise UsageError(f"standard input is a photo, not a clip: unshutter rectify {PIPE}")
        return self._rename(kept, _ending_of_clip(kept, output or ""))

    def name_results(self, source: Path, format: str | None = None, keep: bool = False) -> None:
        """Makes messages call a photo's results in :attr:`results` "standard output"."""
        for name in (picture_name(source, format or usual_format(source), keep), unchanged_name(source, format, keep)):
            stand_ins[str(self.results / name)] = _OUTPUT

    def name_video(self, source: Path) -> Path:
        """Returns the file for the video on standard output, in a container that can be read from a pipe."""
        self.results.mkdir()
        video = (self.results / video_name(source)).with_suffix(".mkv")
        stand_ins[str(video)] = _OUTPUT
        return video

    def send(self, file: Path | None = None) -> None:
        """Writes a file to standard output: by default a photo's result, if there is one."""
        if file is None:
            file = next(self.results.iterdir(), None) if self.results.is_dir() else None
        if file is not None:
            with file.open("rb") as stream:
                shutil.copyfileobj(stream, sys.stdout.buffer, _CHUNK)
            sys.stdout.buffer.flush()

    def _keep(self, is_photo: bool = False) -> Path:
        """Keeps what comes in; a photo is recognised by its beginning, before data that may not end."""
        kept = self._folder / "stdin"
        try:
            with kept.open("wb") as file:
                while data := sys.stdin.buffer.read(_CHUNK):
                    is_first = file.tell() == 0
                    file.write(data)
                    if is_photo and is_first:
                        file.flush()
                        recognise(Source.of_file(kept))
                    if is_photo and file.tell() > _LARGEST_PHOTO:
                        raise UnshutterError("standard input is larger than 4 GB: write it to a file first")
        except OSError as error:
            raise UnshutterError(f"cannot keep standard input in {self._folder.parent}: {error.strerror}") from None
        return kept

    def _rename(self, kept: Path, ending: str) -> Path:
        file = kept.rename(kept.with_suffix(ending))
        stand_ins[str(file)] = stand_ins.pop(str(kept))
        return file


def only(sources: Iterable[str | os.PathLike[str]]) -> str:
    """Returns the input if it is the only one; empty if there are several, none of which may be standard input."""
    names = [os.fspath(source) for source in sources]
    if len(names) == 1:
        return names[0]
    if PIPE in names:
        raise UsageError(f"'{PIPE}' is a single photo from standard input: leave out the others")
    return ""


def _is_photo(file: Path) -> bool:
    try:
        recognise(Source.of_file(file))
    except UnshutterError:
        return False
    return True


def _check_not_appended(source: Path) -> None:
    """Raises UnshutterError if standard output was redirected to the end of the file that is read."""
    with suppress(OSError, ValueError):
        if os.path.samestat(os.fstat(sys.stdout.fileno()), os.stat(source)):
            raise UnshutterError("standard output is {photo}, an original, which is never overwritten", photo=source)


def _ending_of_clip(clip: Path, output: str) -> str:
    """Returns an ending of a video's name that fits its contents, that of the output if it does; empty if unknown."""
    try:
        with clip.open("rb") as stream, open_to_read(stream) as container:
            kinds = container.format.name.split(",")
    except (ValueError, av().error.FFmpegError):
        return ""
    wanted = Path(output).suffix.lower()
    if VIDEO_FORMATS.get(wanted) in kinds:
        return wanted
    return next((ending for ending, kind in VIDEO_FORMATS.items() if kind in kinds), "")
