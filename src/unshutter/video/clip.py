"""A clip as it comes in: what it says about itself, its frames, and the packets of its other streams."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.video.library import av
from unshutter.video.pictures import as_pattern
from unshutter.video.planes import PixelFormat

if TYPE_CHECKING:
    from av import Packet, VideoFrame

MOST_PIXELS, SMALLEST_SIDE = 1 << 28, 64  # px
_LOOKED_AT = 120  # packets that tell the usual frame interval
_WHOLE = 0.03  # of a frame interval: times are taken to be this close to even ones
_LONGEST_GAP = 4  # frame intervals; what lies farther apart is no motion
# FFmpeg's names of the files that are opened. Not among them: lists of other files (HLS, concat), which could have it
# open any file of this machine, or fetch one.
_KINDS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,m4v,h264,hevc,av1,obu,ivf,mjpeg,flv,ogg,asf,mxf,nut,dv,"
    "wtv,yuv4mpegpipe,gif"
)
_PROGRESSIVE = (0, 1)  # FFmpeg's field orders: unknown, progressive


@dataclass(frozen=True)
class Clip:
    """What a clip says about itself; its file is opened anew by each who reads it.

    Attributes:
        path: of the file; of pictures, their pattern (``frames/%05d.png``).
        pixels: how they are stored.
        codec: of the frames, as FFmpeg calls it.
        height, width: of the stored frames [px].
        interval_s: the usual time from one frame to the next [s].
        frames: how many there are; 0: unknown.
        duration_s: of the clip [s]; 0: unknown.
        tags: of the container and of the film, later ones first.
        ticks: units in a second of the times of its frames, at most a million.
        of_pictures: whether it is a sequence of pictures.
        side_data: what lies beside the first frame, by FFmpeg's names; later frames are not asked, since PyAV then
            keeps them for good.
    """

    path: str
    pixels: PixelFormat
    codec: str
    height: int
    width: int
    interval_s: float
    frames: int
    duration_s: float
    tags: dict[str, str]
    ticks: int
    of_pictures: bool
    side_data: dict[str, bytes]

    @classmethod
    def look(cls, path: str | os.PathLike[str], fps: float | None = None) -> Clip:
        """What a file says.

        Args:
            path: a film, a folder of pictures, or a pattern of their names.
            fps: of pictures; a film says it itself.

        Raises:
            UnshutterError: it is no film, or one that nothing can be done to.
        """
        place, of_pictures = as_pattern(path)
        with opened(place, fps) as container:
            stream = film_of(container, place)
            context = stream.codec_context
            if not stream.width or not stream.height or stream.width * stream.height > MOST_PIXELS:
                raise UnshutterError(f"{place}: frames of {stream.width}x{stream.height} px cannot be worked on")
            if min(stream.width, stream.height) < SMALLEST_SIDE:
                small = f"{stream.width}x{stream.height} px; both sides must be at least {SMALLEST_SIDE} px"
                raise UnshutterError(f"{place}: its frames are {small}")
            if context.field_order not in _PROGRESSIVE:
                raise _interlaced(place)
            length = stream.duration * stream.time_base if stream.duration else (container.duration or 0) / 1_000_000
            tags = {**dict(container.metadata), **dict(stream.metadata)}
            known = (place, PixelFormat.of(context.format), context.name, stream.height, stream.width)
            ticks = min(stream.time_base.denominator, 1_000_000)
            interval = _interval(container, stream)
            frames = stream.frames or (round(float(length) / interval) if of_pictures else 0)
        beside = _beside_first_frame(place, fps)
        if "SPHERICAL" in beside:
            raise UnshutterError(f"{place} is a 360-degree clip: its rows are no rows of the sensor")
        return cls(*known, interval, frames, float(length), tags, ticks, of_pictures, beside)

    def items(self, start: float | None = None, end: float | None = None, all_streams: bool = False) -> Iterator:
        """Frames in the order in which they are shown, and packets of the other streams where they lie between them.

        Args:
            start, end: only what is shown from and before these moments [s]; None: all.
            all_streams: also give the other streams' packets.

        Raises:
            UnshutterError: the file is damaged, or ends before it should.
        """
        with opened(self.path, 1 / self.interval_s if self.of_pictures else None) as container:
            film = film_of(container, self.path)
            film.thread_type = "AUTO"
            if start:
                container.seek(int(start / film.time_base), stream=film)
            met = 0
            for packet in _packets(container, None if all_streams else film, self.path):
                if packet.stream.index != film.index:  # that of the last, empty packets is 0
                    if packet.dts is not None and _wanted(_time(packet), start, end):
                        yield packet
                    continue
                met += packet.size > 0
                for frame in _decoded(packet, self.path):
                    if _wanted(frame.time, start, end):
                        yield self._checked(frame)
                    elif not all_streams and end is not None and (frame.time or 0) >= end:
                        return
            if not start and film.frames and met < film.frames:
                raise UnshutterError(f"{self.path} ends after {met} of its {film.frames} frames: the file is cut off")

    def since(self, before: VideoFrame | None, frame: VideoFrame) -> float | None:
        """Time from one frame to the next in usual frame intervals; None where they are no neighbours."""
        if before is None or before.time is None or frame.time is None:
            return 1.0
        tick = float(frame.time_base or 0) / self.interval_s
        gap = (frame.time - before.time) / self.interval_s
        if abs(gap - round(gap)) <= max(_WHOLE, 1.01 * tick) and round(gap) > 0:
            gap = float(round(gap))
        return gap if 0.2 < gap <= _LONGEST_GAP else None

    def _checked(self, frame: VideoFrame) -> VideoFrame:
        if frame.is_corrupt:
            raise _damaged(self.path, frame.time)
        if frame.interlaced_frame:
            raise _interlaced(self.path)
        if (frame.width, frame.height, frame.format.name) != (self.width, self.height, self.pixels.name):
            raise UnshutterError(f"{self.path}: its frames change in size or kind at {frame.time or 0:.1f} s")
        return frame


@contextmanager
def opened(place: str, fps: float | None = None) -> Iterator:
    """The file as PyAV reads it.

    Raises:
        UnshutterError: there is none, or it is no film.
    """
    how: dict[str, Any] = {"options": {"format_whitelist": _KINDS}}
    if "%" in Path(place).name:
        how = {"format": "image2", "options": {"framerate": str(Fraction(fps or 30).limit_denominator(100_000))}}
        first = next((k for k in range(100_000) if os.path.exists(place % k)), 0)
        how["options"]["start_number"] = str(first)
    try:
        container = av().open(place, metadata_errors="replace", **how)
    except (OSError, ValueError) as error:
        told = "no film that can be read" if isinstance(error, (ValueError, av().error.InvalidDataError)) else None
        told = told or (error.strerror if isinstance(error, OSError) else "") or "no film that can be read"
        raise UnshutterError(f"cannot read {place}: {told}") from None
    try:
        yield container
    finally:
        container.close()


def film_of(container, place: str):
    """The first stream of pictures that move; UnshutterError where there is none."""
    films = [s for s in container.streams.video if not s.disposition & 0x400]  # an attached picture is a cover
    if not films or films[0].codec_context is None:
        raise UnshutterError(f"{place} has no film in it, or one of an unknown kind")
    return films[0]


def _interval(container, stream) -> float:
    """The usual time from frame to frame [s]: the median of the first ones'."""
    times = []
    for packet in _packets(container, stream, "the clip"):
        if packet.pts is not None:
            times.append(packet.pts)
        if len(times) > _LOOKED_AT:
            break
    times = sorted(set(times))[:-4] if len(times) > 8 else sorted(set(times))  # the last ones may still lack some
    gaps = sorted(b - a for a, b in pairwise(times))
    if gaps:
        usual = float(gaps[len(gaps) // 2] * stream.time_base)
        said = [1 / float(rate) for rate in (stream.guessed_rate, stream.average_rate) if rate]
        return next((s for s in said if abs(s - usual) <= 1.01 * stream.time_base), usual)
    return 1 / float(stream.guessed_rate or stream.average_rate or 30)


def _beside_first_frame(place: str, fps: float | None) -> dict[str, bytes]:
    """The first frame's side data; refuses interlaced clips, which only frames tell."""
    with opened(place, fps) as container:
        film = film_of(container, place)
        for packet in _packets(container, film, place):
            for frame in _decoded(packet, place):
                if frame.interlaced_frame:
                    raise _interlaced(place)
                beside: Any = frame.side_data
                return {data.type.name: bytes(data) for data in beside}
    raise UnshutterError(f"{place} has no frame that can be decoded")


def _packets(container, stream, place: str) -> Iterator[Packet]:
    try:
        yield from container.demux(stream) if stream is not None else container.demux()
    except av().error.FFmpegError as error:
        raise UnshutterError(f"cannot read {place} to its end: {error.strerror}") from None


def _decoded(packet: Packet, place: str) -> list[VideoFrame]:
    try:
        return packet.decode()
    except av().error.FFmpegError:
        raise _damaged(place, _time(packet)) from None


def _time(packet: Packet) -> float | None:
    return None if packet.pts is None else float(packet.pts * packet.time_base)


def _wanted(at: float | None, start: float | None, end: float | None) -> bool:
    return at is None or ((start is None or at >= start - 1e-6) and (end is None or at < end))


def _damaged(place: str, at: float | None) -> UnshutterError:
    where = "" if at is None else f" at {at:.1f} s"
    return UnshutterError(f"{place} is damaged{where}: take what is whole with --start and --end")


def _interlaced(place: str) -> UnshutterError:
    return UnshutterError(f"{place} is interlaced: its rows are of two moments; deinterlace it first")
