"""An input clip: its properties, its frames, and the packets of its other streams."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.photo.argument import check_size
from unshutter.video.containers import (
    FrameTiming,
    Times,
    bits_per_s,
    damaged,
    decoded,
    film_of,
    first_times,
    opened,
    packets,
    time_of,
)
from unshutter.video.ending import Ending, ExpectedLength
from unshutter.video.file_length import FileLength, file_length
from unshutter.video.options import MAX_CLIP_PIXELS
from unshutter.video.pictures import PictureSequence
from unshutter.video.planes import PixelFormat

if TYPE_CHECKING:
    from av import Packet, VideoFrame

_WHOLE = 0.03  # of a frame interval: times this close to even ones are taken as even
_LONGEST_GAP = 4  # frame intervals; frames farther apart are not neighbours
_PROGRESSIVE = (0, 1)  # FFmpeg's field orders: unknown, progressive
_LEAD_S = 10.0  # s within which files without an index have a key frame
_LARGE = 6_000_000  # px: such frames are decoded one at a time, to save memory; other steps take longer
_NO_TABLES = ("mpegts", "mpeg", "h264", "hevc", "mpegvideo", "m4v", "mjpeg", "obu")  # FFmpeg estimates their length


@dataclass(frozen=True)
class SidePacket:
    """A packet of another stream (sound, subtitles), which is copied to the new file unchanged."""

    packet: Packet


@dataclass(frozen=True)
class Clip:
    """A clip, described by its file's headers and first frames; each reader opens the file separately.

    Attributes:
        path: path of the file, or the pattern of pictures (``frames/%05d.png``).
        pixels: pixel format.
        codec: codec of the frames, as FFmpeg calls it.
        height, width: size of the stored frames [px].
        interval_s: the usual time from one frame to the next [s].
        frames: number of frames; 0 if unknown.
        duration_s: duration [s]; 0 if unknown.
        tags: tags of the container and of the video stream; the latter take precedence.
        ticks: time units per second of its frames, at most a million.
        side_data: side data of the first frame, by FFmpeg's names; not read from later frames, since PyAV would then
            never free it.
        lead_s: how much earlier reading must begin so that a key frame comes first [s].
        expected: how much of the clip there should be.
        timing: how its frames get their times.
        pictures: the sequence of pictures; None for a film.
        bits_per_s: bit rate of the frames; 0 if unknown.
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
    side_data: dict[str, bytes]
    lead_s: float = field(repr=False)
    expected: ExpectedLength = field(repr=False)
    timing: FrameTiming = field(repr=False)
    pictures: PictureSequence | None = None
    bits_per_s: float = 0.0

    @classmethod
    def look(cls, path: str | os.PathLike[str], fps: float | None = None, max_pixels: int = MAX_CLIP_PIXELS) -> Clip:
        """Reads the headers and the first frames of a file.

        Args:
            path: a film, a folder of pictures, or a pattern of their names.
            fps: frames per second of pictures; a film states its own.
            max_pixels: clips with larger frames are rejected.

        Raises:
            UnshutterError: the file is not a film, or not a usable one.
        """
        place, pictures = os.fspath(path), PictureSequence.at(path)
        with opened(place, pictures, fps) as container:
            stream = film_of(container, place)
            context = stream.codec_context
            _check_size(place, stream.width, stream.height, max_pixels)
            if context.field_order not in _PROGRESSIVE:
                raise _interlaced(place)
            kind, base = container.format.name, float(stream.time_base)
            length = stream.duration * stream.time_base if stream.duration else (container.duration or 0) / 1_000_000
            tags = {**dict(container.metadata), **dict(stream.metadata)}
            stored = (place, PixelFormat.of(context.format), context.name, stream.height, stream.width)
            ticks = min(stream.time_base.denominator, 1_000_000)
            start_s = (stream.start_time or 0) * base
            by_tables = bool(stream.duration) and kind not in _NO_TABLES
            interval, first, before = first_times(container, stream)
            rate = 0.0 if pictures else bits_per_s(container, stream)
            frames = stream.frames or (round(float(length) / interval) if pictures else 0)
        end_s = start_s + float(length) if by_tables else None
        expected = ExpectedLength(
            file_length(place, kind) if pictures is None else FileLength(),
            0 if pictures else frames,
            kind == "avi",
            interval,
            start_s,
            end_s,
        )
        beside, delay = _first_frame(place, pictures, fps)
        if "SPHERICAL" in beside:
            raise UnshutterError("{clip} is a 360-degree clip: its rows are not rows of the sensor", clip=place)
        step = max(1, round(interval / base))
        begin = 0 if first is None else first - before * step
        timing = FrameTiming(begin, step, delay if kind == "avi" else None)
        lead_s = math.inf if first is None else _LEAD_S if kind in _NO_TABLES else 0.0
        times = (interval, frames, float(length), tags, ticks, beside, lead_s, expected, timing)
        return cls(*stored, *times, pictures, rate)

    @property
    def of_pictures(self) -> bool:
        """Whether it is a sequence of pictures."""
        return self.pictures is not None

    def expected_frames(self, start: float | None = None, end: float | None = None) -> int:
        """Returns the expected number of frames between two times [s], as far as the file states it; at least 2."""
        if start is None and end is None and self.frames:
            return self.frames
        last = min(end or self.duration_s, self.duration_s or math.inf)
        return max(round((last - (start or 0.0)) / self.interval_s), 2)

    def opened(self) -> AbstractContextManager[Any]:
        """Opens the file with PyAV; raises UnshutterError if it can no longer be read."""
        return opened(self.path, self.pictures, 1 / self.interval_s if self.pictures else None)

    def iter_frames(self, start: float | None = None, end: float | None = None) -> Iterator[VideoFrame]:
        """Yields the frames between two times [s] in presentation order; None means no limit.

        Raises:
            UnshutterError: the file is damaged, or ends early.
        """
        for item in self.items(start, end):
            if not isinstance(item, SidePacket):
                yield item

    def items(
        self, start: float | None = None, end: float | None = None, all_streams: bool = False
    ) -> Iterator[VideoFrame | SidePacket]:
        """Yields frames in presentation order, and packets of the other streams where they lie between them.

        Args:
            start, end: limits of the presentation time [s]; None for no limit.
            all_streams: also yield the other streams' packets.

        Raises:
            UnshutterError: the file is damaged, or ends early.
        """
        with self.opened() as container:
            film = film_of(container, self.path)
            film.thread_type = "AUTO" if self.height * self.width < _LARGE else "SLICE"
            if start and start - self.lead_s > self.expected.start_s:
                container.seek(int((start - self.lead_s) / film.time_base), stream=film)
            times, ending = Times(self.timing), Ending(self.path, self.expected)
            for packet in packets(container, None, self.path):
                of_film = packet.stream.index == film.index  # packet.stream_index is 0 in the final, empty packets
                ending.add(packet, of_film)
                if not of_film:
                    if all_streams and packet.dts is not None and _is_within(time_of(packet), start, end):
                        yield SidePacket(packet)
                    continue
                for frame in decoded(packet, self.path):
                    times.set(frame)
                    if _is_within(frame.time, start, end):
                        yield self._checked(frame)
                    elif not all_streams and end is not None and (frame.time or 0) >= end:
                        return
            ending.check(start, end)

    def check_whole(self, start: float | None = None, end: float | None = None) -> None:
        """Checks that a film whose file is cut off still contains all of the selected part.

        Args:
            start, end: the selected part [s]; None for no limit.

        Raises:
            UnshutterError: the film ends before that part does.
        """
        if not self.expected.length.cut:
            return
        with self.opened() as container:
            film, ending = film_of(container, self.path), Ending(self.path, self.expected)
            for packet in packets(container, None, self.path):
                ending.add(packet, packet.stream.index == film.index)
            ending.check(None, end)

    def since(self, before: VideoFrame | None, frame: VideoFrame) -> float | None:
        """Returns the time from one frame to the next in usual frame intervals, or None if they are not neighbours."""
        if before is None or before.time is None or frame.time is None:
            return 1.0
        tick = float(frame.time_base or 0) / self.interval_s
        gap = (frame.time - before.time) / self.interval_s
        if abs(gap - round(gap)) <= max(_WHOLE, 1.01 * tick) and round(gap) > 0:
            gap = float(round(gap))
        return gap if 0.2 < gap <= _LONGEST_GAP else None

    def _checked(self, frame: VideoFrame) -> VideoFrame:
        if frame.is_corrupt:
            raise damaged(self.path, frame.time)
        if frame.interlaced_frame:
            raise _interlaced(self.path)
        if (frame.width, frame.height, frame.format.name) != (self.width, self.height, self.pixels.name):
            raise UnshutterError(
                f"{{clip}}: its frames change in size or kind at {frame.time or 0:.1f} s", clip=self.path
            )
        return frame


def frame_bytes(clip: Clip) -> float:
    """Returns the memory size of a decoded frame of a clip [bytes]."""
    size = sum(plane.bands / plane.across / plane.down for plane in clip.pixels.planes)
    return size * clip.height * clip.width * (1 if clip.pixels.depth == 8 else 2)


def _check_size(place: str, width: int, height: int, most: int) -> None:
    """Raises UnshutterError if frames are too small or too large to be processed."""
    if not width or not height:
        raise UnshutterError("{clip} does not say how large its frames are", clip=place)
    size = f"{width}x{height} px"
    if width * height > most:
        millions = f"({width * height / 1e6:.0f} megapixels), more than the limit of {most / 1e6:g} megapixels"
        raise UnshutterError(f"{{clip}} has frames of {size} {millions}: see --max-pixels", clip=place)
    check_size(height, width, "{clip}: a frame", clip=place)


def _first_frame(place: str, pictures: PictureSequence | None, fps: float | None) -> tuple[dict[str, bytes], int]:
    """Returns the first frame's side data, and the delay of its decoding time after that of its packet [ticks].

    Raises:
        UnshutterError: the clip has no frame, or is interlaced, which only its frames reveal.
    """
    with opened(place, pictures, fps) as container:
        film, first_dts = film_of(container, place), None
        for packet in packets(container, film, place):
            first_dts = packet.dts if first_dts is None else first_dts
            for frame in decoded(packet, place):
                if frame.interlaced_frame:
                    raise _interlaced(place)
                beside: Any = frame.side_data
                delay = frame.dts - first_dts if frame.dts is not None and first_dts is not None else 0
                return {data.type.name: bytes(data) for data in beside}, delay
    raise UnshutterError("{clip} has no frame that can be decoded", clip=place)


def _is_within(at: float | None, start: float | None, end: float | None) -> bool:
    return at is None or ((start is None or at >= start - 1e-6) and (end is None or at < end))


def _interlaced(place: str) -> UnshutterError:
    return UnshutterError("{clip} is interlaced: its rows are of two moments; deinterlace it first", clip=place)
