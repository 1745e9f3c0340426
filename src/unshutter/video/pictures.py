"""Clips that are pictures in a folder: ``frames/00001.png``, ``frames/00002.png`` ..."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError

if TYPE_CHECKING:
    from av import VideoFrame

_NUMBERED = re.compile(r"(.*?)(\d+)(\.[A-Za-z]+)")
_PATTERN = re.compile(r"[^%]*%0?\d*d[^%]*")
ENDINGS = {".png": "png", ".jpg": "mjpeg", ".jpeg": "mjpeg", ".tif": "tiff", ".tiff": "tiff"}


def as_pattern(path: str | os.PathLike[str]) -> tuple[str, bool]:
    """What FFmpeg opens, and whether it is a sequence of pictures.

    Args:
        path: a file, a folder of numbered pictures, or a pattern like ``frames/%05d.png``.

    Raises:
        UnshutterError: a folder without numbered pictures, or of several kinds of them.
    """
    place = os.fspath(path)
    if not os.path.isdir(place):
        if is_pattern(place):
            if not any(os.path.exists(place % k) for k in range(100_000)):
                raise UnshutterError(f"there is no picture {place}")
            return place, True
        return place, False
    kinds: dict[tuple[str, int, str], int] = {}
    for name in sorted(os.listdir(place)):
        if (found := _NUMBERED.fullmatch(name)) and found[3].lower() in ENDINGS:
            kind = (found[1], len(found[2]), found[3])
            kinds[kind] = kinds.get(kind, 0) + 1
    if len(kinds) != 1:
        what = "several kinds of numbered pictures" if kinds else "no numbered pictures (00001.png ...)"
        raise UnshutterError(f"{place} has {what} in it: say which with a pattern, such as {place}/%05d.png")
    (stem, digits, ending), _ = kinds.popitem()
    return str(Path(place) / f"{stem.replace('%', '%%')}%0{digits}d{ending}"), True


def is_pattern(place: str) -> bool:
    """Whether a name stands for a sequence of pictures."""
    return bool(_PATTERN.fullmatch(Path(place).name))


# ---- written --------------------------------------------------------------------------------------------


def folder_and_name(target: Path, like: str) -> tuple[Path, str]:
    """Where pictures go and what they are called.

    Args:
        target: a folder, or a pattern.
        like: a name or pattern that says how they are called where the target does not.

    Raises:
        UnshutterError: pictures of this ending cannot be written.
    """
    if is_pattern(str(target)):
        folder, name = target.parent, target.name
    else:
        folder, name = target, Path(like).name if is_pattern(like) else "%05d.png"
    if Path(name).suffix.lower() not in ENDINGS:
        raise UnshutterError(f"cannot write pictures called {name}: choose .png, .jpg or .tif")
    return folder, name


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A folder that gets its name when the block ends well, and goes otherwise.

    Raises:
        UnshutterError: there is something of that name, or it cannot be made.
    """
    if os.path.lexists(folder) and not (folder.is_dir() and not folder.is_symlink() and not os.listdir(folder)):
        raise UnshutterError(f"{folder} exists already: pictures go into a new folder")
    part = folder.with_name(f".{folder.name}.{os.urandom(4).hex()}.part")
    try:
        part.mkdir()
        yield part
        if folder.is_dir():
            folder.rmdir()
        part.rename(folder)
    except OSError as error:
        raise UnshutterError(f"cannot write {folder}: {error.strerror}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write(frame: VideoFrame, path: Path) -> None:
    """Writes a frame as a picture.

    Raises:
        UnshutterError: it cannot be written.
    """
    from unshutter.video.library import av

    codec = ENDINGS[path.suffix.lower()]
    context = av().CodecContext.create(codec, "w")
    known = av().Codec(codec, "w").video_formats or []
    format_ = frame.format.name
    if format_ not in [each.name for each in known]:
        format_ = "rgb48be" if codec == "png" and frame.format.components[0].bits > 8 else "rgb24"
        format_ = "yuvj444p" if codec == "mjpeg" else format_
    if codec == "mjpeg":
        context.options = {"strict": "unofficial"}
        context.qscale, context.global_quality = True, 2 * 118
        context.color_range = frame.color_range
    made = frame if format_ == frame.format.name else frame.reformat(format=format_)
    made.pict_type = 0
    context.width, context.height, context.pix_fmt = frame.width, frame.height, format_
    context.time_base = frame.time_base
    try:
        data = b"".join(bytes(packet) for packet in [*context.encode(made), *context.encode(None)])
        path.write_bytes(data)
    except (av().error.FFmpegError, OSError) as error:
        raise UnshutterError(f"cannot write {path.name}: {error.strerror}") from None
