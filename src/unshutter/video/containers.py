"""Film files as read by PyAV: the video stream, its packets, frames and their times; and files that are cut off."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.frames.pyav import av, open_to_read
from unshutter.options.clip_options import JOIN
from unshutter.storage.files import check_plain

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
_STATE_SECONDS = ("matroska", "flv", "asf")  # FFmpeg's names of formats whose headers hold the length in seconds
_NEAR = 1.5  # frame intervals: tolerance of the end of a film
_SHORT = 2.0  # frame intervals: tolerance if another stream may be the longest in a cut-off file
_REORDERED = 32  # frames within which decoding and presentation order may differ
_SLOPPY, _SLOPPY_S = 4, 0.25  # frame intervals and seconds by which headers of complete files may be wrong


@contextmanager
def opened(place: str, **options: str) -> Iterator[Any]:
    """Opens a file with PyAV, and with options of FFmpeg's."""
    if os.path.isdir(place):
        raise UnshutterError(f"{{clip}} is a folder, not a film: {JOIN}", clip=place)
    check_plain(Path(place))
    settings = {"format_whitelist": _KINDS, "max_pixels": str(_LARGEST_FRAME), **options}
    library = av()  # outside the try: Ctrl-C during its import would leave half a module for the clause below
    try:  # absolute path, because text before a colon would be taken for a protocol
        container = open_to_read(os.path.abspath(place), options=settings)
    except (OSError, ValueError, library.error.FFmpegError) as error:
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
        raise UnshutterError("{clip} contains no video, or an unknown kind", clip=place)
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
    return UnshutterError(f"{{clip}} is damaged{where}: use the intact part with {{--start}} and {{--end}}", clip=place)


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
    """The rule by which a film's frames get their times."""

    start: int  # time of the first frame if it has none [ticks of the film]
    step: int  # usual time from one frame to the next [ticks]
    # in files that store decoding times only (AVI), the decoding time minus the presentation time [ticks]; None for
    # files with presentation times
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


# ---- films whose file is cut off --------------------------------------------------------------------------


@dataclass(frozen=True)
class ExpectedLength:
    """The length of a film as its file states it."""

    frames: int  # number of frames in its tables; 0 if unknown
    seconds: float | None  # end time of its longest stream, if it is stated in seconds; None if unknown
    interval_s: float  # usual frame interval [s]
    start_s: float  # start time of the film [s]
    end_s: float | None  # end time according to its tables [s]; None if unknown

    @classmethod
    def of(cls, container: Any, stream: Any, interval_s: float, has_tables: bool) -> ExpectedLength:
        """Returns what an open file states about its film."""
        kind, frames, seconds = container.format.name.partition(",")[0], stream.frames, None
        if kind == "avi":  # some of its frames may be empty: a repeated frame has no data
            frames, seconds = 0, frames * interval_s or None
        elif kind in _STATE_SECONDS and container.duration:
            seconds = container.duration / 1_000_000
        start_s = float((stream.start_time or 0) * stream.time_base)
        end_s = start_s + float(stream.duration * stream.time_base) if has_tables else None
        return cls(frames, seconds, interval_s, start_s, end_s)

    def check(self, path: str, end: float | None) -> None:
        """Raises UnshutterError if a film ends earlier than stated, and before the time ``end`` [s]."""
        near, torn = _NEAR * self.interval_s, False
        frames, film_s, all_s = 0, -math.inf, -math.inf
        latest: deque[float] = deque(maxlen=_REORDERED)  # ends of frames [s]
        with opened(path) as container:
            film = film_of(container, path)
            for packet in packets(container, None, path):
                if not packet.size:
                    continue
                at = time_of(packet)
                at = -math.inf if at is None else at + float((packet.duration or 0) * packet.time_base)
                torn, all_s = packet.is_corrupt, max(all_s, at)
                if packet.stream_index == film.index:
                    frames, film_s = frames + 1, max(film_s, at)
                    latest.append(at)
                    if end is not None and film_s >= end - near:
                        return
        if torn or frames < self.frames:  # up to the first gap among its last frames
            ends = sorted(latest)
            film_s = next((a for a, b in pairwise(ends) if b - a > near), film_s)
        problem = self._problem(frames, film_s, all_s, torn)
        if problem is not None:
            until = math.floor(10 * film_s) / 10 if math.isfinite(film_s) else 0.0
            way = f"; {{--end}} {until:.1f} keeps what is there" if until > max(self.start_s, 0.0) else ""
            raise UnshutterError(f"{{clip}} {problem}: the file is cut off{way}", clip=path)

    def _problem(self, frames: int, film_s: float, all_s: float, torn: bool) -> str | None:
        """Returns what is wrong with a file's end, from its number of frames and the ends of its film and streams."""
        if frames < self.frames:
            if self.end_s and film_s < self.end_s - _NEAR * self.interval_s:
                return f"ends early, {self._share(film_s, self.end_s)}"
            return f"ends after {frames} of its {self.frames} frames"
        if self.seconds is not None and not self.frames:
            missing = self.seconds - self._since(film_s if torn else all_s, self.seconds)
            if missing > (_SHORT * self.interval_s if torn else max(_SLOPPY * self.interval_s, _SLOPPY_S)):
                return f"ends early, {self._share(film_s, self.seconds)}"
        elif torn and not self.frames and self.end_s is not None:
            return "ends in the middle of its data"
        return None

    def _since(self, at: float, seconds: float) -> float:
        """Returns how much of the stated length was read: late-starting files count from their start, others from 0."""
        return at - self.start_s if self.start_s >= seconds else at

    def _share(self, film_s: float, seconds: float) -> str:
        return f"after {max(self._since(film_s, seconds), 0.0):.1f} of {seconds:.1f} s"
