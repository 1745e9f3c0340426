"""PyAV, the library that reads and writes videos: imported when needed, and the same in its versions 18 and 19."""

from __future__ import annotations

import os
import struct
from contextlib import suppress
from functools import cache
from itertools import count
from types import FrameType, ModuleType
from typing import TYPE_CHECKING, BinaryIO, cast

from unshutter import version
from unshutter.errors import UnshutterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from av import VideoFrame
    from av.container import InputContainer
    from av.sidedata.sidedata import SideData
    from av.stream import Stream

# ending of a video's name -> FFmpeg's format that writes it as one file
VIDEO_FORMATS = {
    ending: name
    for name, endings in {
        "mp4": ".mp4 .lrv",  # GoPro's small copy of a video
        "ipod": ".m4v",
        "mov": ".mov",
        "3gp": ".3gp",
        "3g2": ".3g2",
        "f4v": ".f4v",
        "matroska": ".mkv",
        "webm": ".webm",
        "avi": ".avi",
        "mpegts": ".ts .mts .m2ts .m2t",
        "mpeg": ".mpg .mpeg .mpe",
        "vob": ".vob",
        "flv": ".flv",
        "asf": ".wmv .asf",
        "ogv": ".ogv",
        "mxf": ".mxf",
        "nut": ".nut",
        "gif": ".gif",
        "yuv4mpegpipe": ".y4m",
        "ivf": ".ivf",
        "h264": ".h264 .264",
        "hevc": ".hevc .h265 .265",
        "obu": ".obu",
        "dv": ".dv",
        "mjpeg": ".mjpg .mjpeg",
        "mpeg1video": ".m1v",
        "mpeg2video": ".m2v",
    }.items()
    for ending in endings.split()
}


@cache
def av() -> ModuleType:
    """Returns the library."""
    os.environ.setdefault("SVT_LOG", "1")  # silences an encoder that writes to standard error
    try:
        import av.logging
    except ModuleNotFoundError:
        raise UnshutterError(f"clips need PyAV: {version.extra('video')}") from None
    except ImportError as error:  # too little memory, or a broken installation
        raise UnshutterError(f"cannot load PyAV, which clips need: {' '.join(str(error).split())}") from None
    av.logging.set_level(None)
    return av


class _Seekable:
    """An open file whose seek says that it failed as FFmpeg expects it: PyAV prints the traceback of an exception."""

    def __init__(self, stream: BinaryIO):
        self._stream = stream
        self.read = stream.read
        self.tell = stream.tell

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Returns the new position, or a negative number if a damaged file asks for an impossible one."""
        try:
            return self._stream.seek(offset, whence)
        except (OSError, ValueError, OverflowError):
            return -1

    def seekable(self) -> bool:
        """Returns whether the file can be read from any position."""
        return self._stream.seekable()


def is_called_back(frame: FrameType | None) -> bool:
    """Whether the running code was called by FFmpeg, which swallows exceptions and takes the file for damaged."""
    while frame is not None and frame.f_code is not _Seekable.seek.__code__:
        frame = frame.f_back
    return frame is not None


def open_to_read(source: BinaryIO | str, options: dict[str, str] | None = None) -> InputContainer:
    """Opens a video for reading; by default, PyAV 18 refuses one whose tags are not UTF-8, and PyAV 19 reads it."""
    lenient = {"metadata_errors": "replace"} if int(av().__version__.partition(".")[0]) < 19 else {}
    return av().open(source if isinstance(source, str) else _Seekable(source), options=options, **lenient)


def tags(source: InputContainer | Stream) -> dict[str, str]:
    """Returns a container's or stream's tags as printable text; PyAV 19 returns undecodable bytes as surrogates."""
    return {
        key: value.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
        for key, value in dict(source.metadata).items()
    }


def side_data(frame: VideoFrame) -> dict[str, bytes]:
    """Returns a frame's side data by FFmpeg's names: iteration gives the data in PyAV 18, their types in PyAV 19.

    PyAV 18.1 gives none if it does not know one of the kinds (Exif, in MJPEG): then only the rotation is known.
    """
    try:
        stored = cast("Sequence[SideData]", frame.side_data)
    except ValueError:
        along, across = {0: (1, 0), 1: (0, 1), 2: (-1, 0), 3: (0, -1)}[round(frame.rotation / 90) % 4]
        matrix = (along << 16, -across << 16, 0, across << 16, along << 16, 0, 0, 0, 1 << 30)
        return {"DISPLAYMATRIX": struct.pack("=9i", *matrix)} if along != 1 else {}
    found: list[SideData] = []
    with suppress(IndexError):  # PyAV 19 counts kinds, of which a frame may have several
        for k in count():
            found.append(stored[k])
    return {data.type.name: bytes(data) for data in found}
