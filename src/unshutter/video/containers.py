"""Film files as read by PyAV: the video stream, its packets and frames one by one, and their presentation times."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from unshutter import installation
from unshutter.errors import UnshutterError
from unshutter.storage.plain_files import check_plain
from unshutter.video.pictures import PictureSequence

if TYPE_CHECKING:
    from av import Packet, VideoFrame

_LOOKED_AT = 120  # packets from which the usual frame interval is determined
# FFmpeg's names of accepted formats. Lists of other files (HLS, concat) are excluded, because they could make it
# open any file on this machine, or fetch one.
_KINDS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,m4v,h264,hevc,av1,obu,ivf,mjpeg,flv,ogg,asf,mxf,nut,dv,"
    "wtv,yuv4mpegpipe,gif"
)
_LARGEST_FRAME = 1 << 28  # px; a decoder allocates memory before its frames' size can be checked


@cache
def av() -> ModuleType:
    """Returns the library that reads and writes films.

    Raises:
        UnshutterError: it is not installed.
    """
    os.environ.setdefault("SVT_LOG", "1")  # silences an encoder that writes to standard error
    try:
        import av
        from av import logging
    except ImportError:
        raise UnshutterError(f"clips need PyAV: {installation.extra('video')}") from None
    logging.set_level(None)
    return av


@contextmanager
def opened(place: str, pictures: PictureSequence | None = None, fps: float | None = None) -> Iterator[Any]:
    """Opens a file with PyAV.

    Args:
        place: path of a film; for pictures only a name for messages.
        pictures: a sequence of pictures; None for a film.
        fps: frames per second of pictures.

    Raises:
        UnshutterError: there is no such file, or it is not a film.
    """
    if pictures is None:
        check_plain(Path(place))
        name, arguments = place, {"options": {"format_whitelist": _KINDS, "max_pixels": str(_LARGEST_FRAME)}}
    else:
        rate = str(Fraction(fps or 30).limit_denominator(100_000))
        settings = {"framerate": rate, "start_number": str(pictures.first), "pattern_type": "sequence"}
        name, arguments = pictures.pattern, {"format": "image2", "options": settings}
    try:  # absolute path, because text before a colon would be taken for a protocol
        container = av().open(os.path.abspath(name), metadata_errors="replace", **arguments)
    except (OSError, ValueError, av().error.FFmpegError) as error:
        cause = error.strerror if isinstance(error, OSError) else ""
        raise UnshutterError(
            f"cannot read {{clip}}: {cause or 'no film that can be read; the file may be cut off or damaged'}",
            clip=place,
        ) from None
    try:
        yield container
    finally:
        container.close()


def film_of(container: Any, place: str) -> Any:
    """Returns the first stream of moving pictures; raises UnshutterError if there is none."""
    films = [s for s in container.streams.video if not s.disposition & 0x400]  # attached pictures are cover art
    if not films or films[0].codec_context is None:
        raise UnshutterError("{clip} has no film in it, or one of an unknown kind", clip=place)
    return films[0]


def packets(container: Any, stream: Any, place: str) -> Iterator[Packet]:
    """Yields the packets of one stream, or of all if None; raises UnshutterError if they cannot be read."""
    try:
        yield from container.demux(stream) if stream is not None else container.demux()
    except IndexError:  # raised by PyAV at the end of files with streams that began in mid-file
        return
    except av().error.FFmpegError as error:
        raise UnshutterError(f"cannot read {{clip}} to its end: {error.strerror}", clip=place) from None


def decoded(packet: Packet, place: str) -> list[VideoFrame]:
    """Returns the frames that a packet completes; raises UnshutterError if it is damaged."""
    try:
        return packet.decode()
    except av().error.FFmpegError:
        raise damaged(place, time_of(packet)) from None


def time_of(packet: Packet) -> float | None:
    """Returns the presentation time of a packet [s], or None if it is unknown."""
    return None if packet.pts is None else float(packet.pts * packet.time_base)


def damaged(place: str, at: float | None) -> UnshutterError:
    """Returns the error for a film that is damaged at a given time [s]."""
    where = "" if at is None else f" at {at:.1f} s"
    return UnshutterError(f"{{clip}} is damaged{where}: take what is whole with --start and --end", clip=place)


def first_times(container: Any, stream: Any) -> tuple[float, int | None, int]:
    """Returns the times of a film's first packets.

    Returns:
        The usual frame interval [s], the median of the packets'; their earliest time [ticks of the stream], None if
        none has one; and the number of packets before the first that has one.
    """
    times, before = [], 0
    for packet in packets(container, stream, "the clip"):
        if packet.pts is not None:
            times.append(packet.pts)
        elif not times and packet.size:
            before += 1
        if len(times) + before > _LOOKED_AT:
            break
    first = min(times, default=None)
    times = sorted(set(times))[:-4] if len(times) > 8 else sorted(set(times))  # the last ones may not be complete yet
    gaps = sorted(b - a for a, b in pairwise(times))
    stated = [1 / float(rate) for rate in (stream.guessed_rate, stream.average_rate) if rate]
    if not gaps:
        return (stated or [1 / 30])[0], first, before
    usual = float(gaps[len(gaps) // 2] * stream.time_base)
    return next((s for s in stated if abs(s - usual) <= 1.01 * stream.time_base), usual), first, before


def bits_per_s(container: Any, stream: Any) -> float:
    """Returns a film's bit rate as its file states it, or else that of the whole file except sound; 0 if unknown."""
    stated = stream.codec_context.bit_rate or stream.metadata.get("BPS", "")
    if stated and str(stated).isdecimal():
        return float(stated)
    sound = sum(each.codec_context.bit_rate or 0 for each in container.streams.audio if each.codec_context)
    return float(max((container.bit_rate or 0) - sound, 0))


# ---- presentation times ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class FrameTiming:
    """The rule by which a film's frames get their times.

    Attributes:
        start: time of the first frame if it has none [ticks of the film].
        step: usual time from one frame to the next [ticks].
        delay: in files that store decoding times only (AVI), the decoding time minus the presentation time [ticks];
            None for files with presentation times.
    """

    start: int
    step: int
    delay: int | None = None


class Times:
    """Assigns presentation times to frames in order, each later than the previous one."""

    def __init__(self, timing: FrameTiming):
        self._timing = timing
        self._last: int | None = None

    def set(self, frame: VideoFrame) -> None:
        """Assigns its time to the next frame."""
        timing = self._timing
        at = frame.pts
        if timing.delay is not None:
            at = None if frame.dts is None else frame.dts - timing.delay
        if at is None:
            at = timing.start if self._last is None else self._last + timing.step
        elif self._last is not None and at <= self._last:
            at = self._last + 1
        frame.pts = self._last = at
