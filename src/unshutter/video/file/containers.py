"""Video files as read by PyAV: the video stream, its packets, frames and their times; and files that are cut off."""

from __future__ import annotations

import math
import os
import re
import struct
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from unshutter.errors import UnshutterError
from unshutter.frames.pyav import av, open_to_read
from unshutter.options.clip_options import JOIN
from unshutter.storage.files import check_plain

if TYPE_CHECKING:
    from av import Packet, VideoFrame


ONE_FILM = "only one film of a file is straightened"
ALPHA_MODE = "alpha_mode"  # tag of Matroska, in any case: whether packets have a second picture, of the transparency
COVER = 0x400  # FFmpeg's disposition of attached pictures: cover art
# FFmpeg's names of accepted formats. Lists of other files (HLS, concat) are excluded, because they could make it
# open any file on this machine, or fetch one.
_KINDS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,m4v,h264,hevc,av1,obu,ivf,mjpeg,flv,ogg,asf,mxf,"
    "nut,dv,wtv,yuv4mpegpipe,gif"
)
_STATE_SECONDS = ("matroska", "flv", "asf")  # FFmpeg's names of formats whose headers hold the length in seconds
_NEAR = 1.5  # frame intervals: tolerance of the end of a video
_SHORT = 2.0  # frame intervals: tolerance if another stream may be the longest in a cut-off file
_SLOPPY, _SLOPPY_S = 4, 0.25  # frame intervals and seconds by which headers of complete files may be wrong


@dataclass(frozen=True)
class VideoFile:
    """A video's file, open for reading."""

    path: str
    stream: BinaryIO  # the file, through which FFmpeg reads: to be used otherwise only before or after its packets
    container: Any  # PyAV's
    video: Any  # its first stream of moving pictures
    damaged_s: list[float | None] = field(default_factory=list)  # times of its packets that cannot be decoded [s]
    readers: list[Callable[[Packet], None]] = field(default_factory=list)  # of the video's packets, as they are met

    @property
    def other_films(self) -> list[Any]:
        """Further streams of moving pictures."""
        videos = self.container.streams.video
        return [s for s in videos if s.index != self.video.index and not s.disposition & COVER and s.frames != 1]

    def packets(self) -> Iterator[Packet]:
        """Yields the packets of all streams; raises UnshutterError if they cannot be read."""
        try:
            yield from self.container.demux()
        except IndexError:  # raised by PyAV at the end of files with streams that began in mid-file
            return
        except av().error.FFmpegError as error:
            raise UnshutterError(f"cannot read {{clip}} to its end: {error.strerror}", clip=self.path) from None

    def is_of_video(self, packet: Packet) -> bool:
        """Whether a packet belongs to the moving pictures."""
        return packet.stream.index == self.video.index  # packet.stream_index is 0 in the final, empty packets


@contextmanager
def opened(place: str, **options: str) -> Iterator[VideoFile]:
    """Opens a video for reading, with options of FFmpeg's."""
    with opened_bytes(place) as stream, read_by_ffmpeg(stream, place, **options) as video:
        yield video


@contextmanager
def opened_bytes(place: str) -> Iterator[BinaryIO]:
    """Opens a video's file."""
    if os.path.isdir(place):
        raise UnshutterError(f"{{clip}} is a folder, not a video: {JOIN}", clip=place)
    check_plain(Path(place))
    try:  # absolute path, because text before a colon would be taken for a protocol
        stream = open(os.path.abspath(place), "rb")  # noqa: SIM115
    except OSError as error:
        raise _unreadable(place, error.strerror) from None
    with stream:
        yield stream


@contextmanager
def read_by_ffmpeg(stream: BinaryIO, place: str, **options: str) -> Iterator[VideoFile]:
    """Yields a video through whose open file PyAV reads, from its beginning."""
    settings = {"format_whitelist": _KINDS, "max_pixels": str(1 << 28), **options}
    library = av()  # outside the try: Ctrl-C during its import would leave half a module for the clause below
    stream.seek(0)
    try:
        container = open_to_read(stream, options=settings)
    except (OSError, ValueError, library.error.FFmpegError) as error:
        raise _unreadable(place, error.strerror if isinstance(error, OSError) else "") from None
    try:
        videos = [s for s in container.streams.video if not s.disposition & COVER]
        if not videos or videos[0].codec_context is None:
            raise UnshutterError("{clip} contains no video, or an unknown kind", clip=place)
        yield VideoFile(place, stream, container, videos[0])
    finally:
        container.close()


def _unreadable(place: str, cause: str | None) -> UnshutterError:
    cause = cause or "no video that can be read; the file may be cut off or damaged"
    return UnshutterError(f"cannot read {{clip}}: {cause}", clip=place)


def decode_packet(packet: Packet, file: VideoFile) -> list[VideoFrame]:
    """Returns the frames that a packet completes: none if it is damaged, which is counted."""
    try:
        return packet.decode()
    except av().error.FFmpegError:
        file.damaged_s.append(time_of(packet))
        return []


def time_of(packet: Packet) -> float | None:
    """Returns the presentation time of a packet [s], or None if it is unknown."""
    return None if packet.pts is None else float(packet.pts * packet.time_base)


def interlaced(place: str) -> UnshutterError:
    """Returns the error for a clip whose rows show two moments."""
    ways = "deinterlace it first or, if its frames are whole, add {--progressive}"
    return UnshutterError(f"{{clip}} is interlaced (its rows show two moments): {ways}", clip=place)


def damaged(place: str, at: float | None) -> UnshutterError:
    """Returns the error for a video of which much is damaged, first at a given time of the clip [s]."""
    where = "" if at is None else f" from {at:.1f} s on"
    return UnshutterError(f"{{clip}} is damaged{where}: use the intact part with {{--start}} and {{--end}}", clip=place)


class FirstTimes:
    """The times of a video's first packets, from which its usual frame interval is determined."""

    def __init__(self) -> None:
        self._times: list[int] = []  # ticks of the video
        self.untimed = 0  # number of packets before the first that has a time

    @property
    def first(self) -> int | None:
        """The earliest time [ticks of the video]; None if no packet has one."""
        return min(self._times, default=None)

    @property
    def are_enough(self) -> bool:
        """Whether further packets would add nothing."""
        return len(self._times) + self.untimed > 120

    def add(self, packet: Packet) -> None:
        """Adds the next packet of the video, unless the previous ones suffice."""
        if self.are_enough:
            return
        if packet.pts is not None:
            self._times.append(packet.pts)
        elif not self._times and packet.size:
            self.untimed += 1

    def interval_s(self, video: Any) -> float:
        """Returns the usual frame interval [s]: the median, or the stated one that is close to it."""
        times = sorted(set(self._times))
        if len(self._times) > 8:
            times = times[:-4]  # the last ones may not be complete yet
        gaps = sorted(b - a for a, b in pairwise(times))
        stated = [1 / float(rate) for rate in (video.guessed_rate, video.average_rate) if rate]
        if not gaps:
            return (stated or [1 / 30])[0]
        usual = float(gaps[len(gaps) // 2] * video.time_base)
        return next((s for s in stated if abs(s - usual) <= 1.01 * video.time_base), usual)


def bits_per_s(container: Any, stream: Any) -> float:
    """Returns a video's bit rate as its file states it, or else that of the file without sound and attachments.

    0 if unknown.
    """
    stated = stream.codec_context.bit_rate or stream.metadata.get("BPS", "")
    if stated and str(stated).isdecimal():
        return float(stated)
    sound = sum(each.codec_context.bit_rate or 0 for each in container.streams.audio if each.codec_context)
    attached = 8 * sum(len(each.data or b"") for each in container.streams if each.type == "attachment")
    stated_s, length_s = (container.duration or 0) / 1_000_000, length_of(container)
    others = sound + (attached / length_s if length_s > 0 else 0)
    bits = (container.bit_rate or 0) * (stated_s / length_s if length_s > 0 else 1)
    return float(max(bits - others, 0))


def length_of(container: Any) -> float:
    """Returns how long a file is [s], 0 if unknown; Matroska files state the time at which they end."""
    length_s = (container.duration or 0) / 1_000_000
    begin_s = (container.start_time or 0) / 1_000_000
    return length_s - begin_s if "matroska" in container.format.name and 0 < begin_s < length_s else length_s


# ---- presentation times ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class FrameTiming:
    """The rule by which a video's frames get their times."""

    start: int  # time of the first frame if it has none [ticks of the video]
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


# ---- videos whose file is cut off --------------------------------------------------------------------------


@dataclass
class Extent:
    """The end of the packets of a video's file that were read so far."""

    frames: int = 0  # number of packets of the video
    video_s: float = -math.inf  # end of the video [s]
    all_s: float = -math.inf  # end of all streams [s]
    torn: bool = False  # whether the last packet is damaged
    latest: deque[float] = field(default_factory=lambda: deque(maxlen=32))  # ends of the last frames [s]

    def add(self, packet: Packet, of_video: bool) -> None:
        """Adds the next packet."""
        if not packet.size:
            return
        at = time_of(packet)
        at = -math.inf if at is None else at + float((packet.duration or 0) * packet.time_base)
        self.torn, self.all_s = packet.is_corrupt, max(self.all_s, at)
        if of_video:
            self.frames += 1
            self.video_s = max(self.video_s, at)
            self.latest.append(at)

    def reaches(self, end_s: float, interval_s: float) -> bool:
        """Whether the video reaches a time [s], within the tolerance of the end of a video."""
        return self.video_s >= end_s - _NEAR * interval_s


@dataclass(frozen=True)
class ExpectedLength:
    """The length of a video as its file states it."""

    frames: int  # number of frames in its tables; 0 if unknown
    seconds: float | None  # end time of its longest stream, if it is stated in seconds; None if unknown
    interval_s: float  # usual frame interval [s]
    start_s: float  # start time of the video [s]
    end_s: float | None  # end time according to its tables [s]; None if unknown

    @classmethod
    def of(cls, file: VideoFile, interval_s: float, has_tables: bool) -> ExpectedLength:
        """Returns what an open file states about its video."""
        container = file.container
        stream = file.video
        kind = container.format.name.partition(",")[0]
        frames = stream.frames
        seconds = None
        if kind == "avi":  # some of its frames may be empty: a repeated frame has no data
            frames, seconds = 0, float(frames * stream.time_base) or None
        elif kind in _STATE_SECONDS and container.duration:
            seconds = container.duration / 1_000_000
        start_s = float((stream.start_time or 0) * stream.time_base)
        end_s = start_s + float(stream.duration * stream.time_base) if has_tables else None
        return cls(frames, seconds, interval_s, start_s, end_s)

    def check(self, path: str, seen: Extent) -> None:
        """Raises UnshutterError if a video that was read to the end of its file ends earlier than stated."""
        video_s = seen.video_s
        if seen.torn or seen.frames < self.frames:  # up to the first gap among its last frames
            ends = sorted(seen.latest)
            video_s = next((a for a, b in pairwise(ends) if b - a > _NEAR * self.interval_s), video_s)
        problem = self._problem(seen.frames, video_s, seen.all_s, seen.torn)
        if problem is not None:
            until = math.floor(10 * video_s) / 10 if math.isfinite(video_s) else 0.0
            way = f"; {{--end}} {until:.1f} keeps what is there" if until > max(self.start_s, 0.0) else ""
            raise UnshutterError(f"{{clip}} {problem}: the file is cut off{way}", clip=path)

    def _problem(self, frames: int, video_s: float, all_s: float, torn: bool) -> str | None:
        """Returns what is wrong with a file's end, from its number of frames and the ends of its video and streams."""
        if frames < self.frames:
            if self.end_s and video_s < self.end_s - _NEAR * self.interval_s:
                return f"ends early, {self._share(video_s, self.end_s)}"
            return f"ends after {frames} of its {self.frames} frames"
        if self.seconds is not None and not self.frames:
            missing = self.seconds - self._since(video_s if torn else all_s, self.seconds)
            if missing > (_SHORT * self.interval_s if torn else max(_SLOPPY * self.interval_s, _SLOPPY_S)):
                return f"ends early, {self._share(video_s, self.seconds)}"
        elif torn and not self.frames and self.end_s is not None:
            return "ends in the middle of its data"
        return None

    def _since(self, at: float, seconds: float) -> float:
        """Returns how much of the stated length was read: late-starting files count from their start, others from 0."""
        return at - self.start_s if self.start_s >= seconds else at

    def _share(self, video_s: float, seconds: float) -> str:
        return f"after {max(self._since(video_s, seconds), 0.0):.1f} of {seconds:.1f} s"


# The date of creation, which FFmpeg passes over. Sources: Microsoft, Advanced Systems Format 3.2 (file properties: in
# 100 ns since 1601); SMPTE ST 377-1 (creation date of a package: year, month, day, hour, minute, second, 4 ms).
_DATE_OF_ASF = re.compile(bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365") + rb".{32}(.{8})", re.DOTALL)
_DATE_OF_MXF = re.compile(rb"\x44\x05\0\x08(.{8})", re.DOTALL)
_HEADER = 1 << 20  # bytes that are searched


def creation_time(file: VideoFile) -> dict[str, str]:
    """Returns the tag of an ASF or MXF file's date of creation, to the second; empty for other files, or without."""
    kind = file.container.format.name
    if kind not in ("asf", "mxf"):
        return {}
    at = file.stream.tell()
    file.stream.seek(0)
    found = (_DATE_OF_ASF if kind == "asf" else _DATE_OF_MXF).search(file.stream.read(_HEADER))
    file.stream.seek(at)
    if found is None or not any(found[1]):
        return {}
    try:
        if kind == "asf":
            ticks = int.from_bytes(found[1], "little")
            date = datetime(1601, 1, 1, tzinfo=UTC) + timedelta(seconds=ticks // 10_000_000)
        else:
            date = datetime(*struct.unpack(">H5Bx", found[1]), tzinfo=UTC)
    except (ValueError, OverflowError):
        return {}
    return {"creation_time": f"{date.isoformat()[:19]}.000000Z"}
