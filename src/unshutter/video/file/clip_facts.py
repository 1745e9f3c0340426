"""The facts of a clip's file, read once: headers, camera tags and the first frame; and access to all its frames."""

from __future__ import annotations

import math
import os
from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames import pyav
from unshutter.frames.pyav import av
from unshutter.options.clip_options import MAX_CLIP_PIXELS
from unshutter.photo.photo import check_size
from unshutter.video.file import containers, matroska, mp4, mp4_writer
from unshutter.video.file.bars import may_have_bars, picture_within_bars
from unshutter.video.file.camera_clock import CameraClock
from unshutter.video.file.camera_tags import CameraTags
from unshutter.video.file.clip import Clip
from unshutter.video.file.containers import COVER, ExpectedLength, Extent, FirstTimes, FrameTiming, VideoFile
from unshutter.video.file.dynamic_hdr import DolbyVision
from unshutter.video.file.packets import Packets
from unshutter.video.file.pixels import COLOURS, FULL_RANGE, PixelFormat

if TYPE_CHECKING:
    from collections import deque
    from contextlib import AbstractContextManager
    from typing import BinaryIO

    from av import Packet, VideoFrame


_LARGE = 6_000_000  # px: such frames are decoded one at a time, to save memory; other steps take longer
_FEW_DAMAGED, _MOST_DAMAGED = 3, 0.1  # frames that cannot be decoded, and their share: with more, clips are refused
_LOOKED_AT, _LOOK_EVERY, _KEY_FRAMES = 61, 6, 12  # frames in which bars are looked for
_NO_TABLES = ("mpegts", "mpeg", "h264", "hevc", "mpegvideo", "m4v", "mjpeg", "obu")  # FFmpeg estimates their length
_INSTA360 = b"8db42d694ccc418790edff439fe026bf"  # last bytes of Insta360's files, which have their log at the end


@dataclass(frozen=True)
class Coding:
    """How the frames of a clip are encoded, as far as a new video can be encoded alike."""

    name: str  # FFmpeg's name of the codec
    tag: str  # the codec's tag in the file
    profile: str | None  # its profile
    rate: Fraction  # frames per second
    time_base: Fraction | None  # unit of the frames' times [s]
    colours: dict[str, int]  # FFmpeg's codes of the colours, by their names
    pixel_aspect: Fraction | None  # width of a pixel divided by its height; None if unknown
    chroma: str = ""  # where chroma lies, in FFmpeg's words; empty for the usual place
    bits_per_s: float = 0.0  # bit rate of the frames; 0 if unknown

    @classmethod
    def of(cls, file: VideoFile) -> Coding:
        """Returns what an open file states."""
        video = file.video
        context = file.video.codec_context
        return cls(
            name=context.name,
            tag=context.codec_tag,
            profile=context.profile,
            rate=Fraction(video.guessed_rate or video.average_rate or 30),
            time_base=video.time_base,
            colours={name: getattr(context, name) for name in COLOURS},
            pixel_aspect=video.sample_aspect_ratio,
            chroma=matroska.chroma_location(video),
            bits_per_s=containers.bits_per_s(file.container, video),
        )


@dataclass(frozen=True, kw_only=True)
class ClipFacts(Clip):
    """A clip's file, described by its headers and first frame; each reader opens the file separately."""

    coding: Coding
    kind: str  # FFmpeg's name of the file's format
    start_s: float  # time at which the file begins, as FFmpeg states it [s]
    has_covers: bool = field(repr=False)  # whether there are cover pictures
    # first packet of each stream next to the video of which there is one among those read, by the stream's index
    first_packets: dict[int, bytes] = field(repr=False)
    can_take_video: bool = field(repr=False)  # whether another video can be put into a copy of the file
    lead_s: float = field(repr=False)  # how much earlier reading must begin so that a key frame comes first [s]
    expected: ExpectedLength = field(repr=False)  # how much of the clip there should be
    extent: Extent | None = field(repr=False)  # how much there is; None if that is as much as was to be read
    timing: FrameTiming = field(repr=False)  # how its frames get their times
    dolby_vision: DolbyVision | None = None
    progressive: bool = False  # whether the user says that frames are whole, whatever they look like
    says_interlaced: bool = False  # whether its headers say that rows show two moments, which may not be so

    def opened(self) -> AbstractContextManager[VideoFile]:
        """Opens the file with PyAV; raises UnshutterError if it can no longer be read."""
        return containers.opened(self.path)

    @property
    def is_full_range(self) -> bool:
        """Whether it says that 0 is black in its frames, which hold luma and chroma."""
        is_yuv = len(self.pixels.planes) > 1 and self.pixels.planes[0].black > 0
        return is_yuv and self.coding.colours["color_range"] == FULL_RANGE

    @property
    def ticks(self) -> int:
        """Time units per second of its frames, at most a million."""
        return min(1_000_000 if self.coding.time_base is None else self.coding.time_base.denominator, 1_000_000)

    def frames_between(self, start: float | None = None, end: float | None = None) -> Generator[VideoFrame]:
        """Opens the file and yields the frames between two times [s] in presentation order; None means no limit."""
        with self.opened() as file:
            yield from self.decode(file, start, end)

    def packets(self) -> Packets | None:
        """Returns the packets of its frames; None if its file has no index and is large, or cannot be read."""
        with suppress(UnshutterError), self.opened() as file:
            return Packets.of(file, self.frames or round(self.duration_s / self.interval_s))
        return None

    def some_frames(self) -> Iterator[VideoFrame]:
        """Yields frames from the beginning and, if the file has an index, key frames spread over the clip."""
        with suppress(UnshutterError):
            yield from islice(self.frames_between(), 0, _LOOKED_AT, _LOOK_EVERY)
        if self.lead_s:
            return
        with self.opened() as file:
            for at_s in np.linspace(0, self.duration_s, _KEY_FRAMES, endpoint=False).tolist()[1:]:
                with suppress(UnshutterError, av().error.FFmpegError):
                    file.container.seek(int((self.begin_s + at_s) / file.video.time_base), stream=file.video)
                    packets = (each for each in file.packets() if file.is_of_video(each))
                    frames = (frame for each in packets for frame in containers.decode_packet(each, file))
                    yield from (frame for frame in islice(frames, 1) if self._is_alike(frame))

    def decode(
        self, file: VideoFile, start: float | None, end: float | None, others: deque[Packet] | None = None
    ) -> Generator[VideoFrame]:
        """Yields the frames of the open file between two times [s] in presentation order; None means no limit.

        Args:
            others: receives the packets of the other streams between these times, as they are met.
        """
        video = file.video
        video.thread_type = "AUTO" if self.height * self.width < _LARGE else "SLICE"
        if start and start - self.lead_s > self.expected.start_s:
            file.container.seek(int((start - self.lead_s) / video.time_base), stream=video)
        times = containers.Times(self.timing)
        decoded = 0
        for packet in file.packets():
            if not file.is_of_video(packet):
                is_one = packet.size or packet.dts is not None  # not the sign that there are no more
                if others is not None and is_one and _is_within(containers.time_of(packet), start, end):
                    others.append(packet)
                continue
            for reader in file.readers:
                reader(packet)
            for frame in containers.decode_packet(packet, file):
                decoded += 1
                times.set(frame)
                if _is_within(frame.time, start, end):
                    self._check_frame(frame)
                    yield frame
                elif others is None and end is not None and (frame.time or 0) >= end:
                    return
            if len(file.damaged_s) > max(_FEW_DAMAGED, _MOST_DAMAGED * decoded):
                first_s = file.damaged_s[0]
                raise containers.damaged(self.path, None if first_s is None else max(first_s - self.begin_s, 0.0))

    def _check_frame(self, frame: VideoFrame) -> None:
        if (self.says_interlaced or frame.interlaced_frame) and not self.progressive and self.pixels.is_combed(frame):
            raise containers.interlaced(self.path)
        if not self._is_alike(frame):
            raise UnshutterError(
                f"{{clip}}: its frames change in size or format at {(frame.time or 0) - self.begin_s:.1f} s",
                clip=self.path,
            )

    def _is_alike(self, frame: VideoFrame) -> bool:
        return (frame.width, frame.height, frame.format.name) == (self.width, self.height, self.pixels.name)

    def check_whole(self) -> None:
        """Raises UnshutterError if the file ends before it should, and before the time up to which it was read."""
        if self.extent is not None:
            self.expected.check(self.path, self.extent)


def _is_within(at: float | None, start: float | None, end: float | None) -> bool:
    return at is None or ((start is None or at >= start - 1e-6) and (end is None or at < end))


def read_clip_facts(
    path: str | os.PathLike[str],
    max_pixels: int = MAX_CLIP_PIXELS,
    until_s: float | None = 0.0,
    progressive: bool = False,
) -> ClipFacts:
    """Reads the facts of a clip's file in one pass.

    Args:
        max_pixels: clips with larger frames are rejected.
        progressive: whether frames are whole, whatever they look like.
        until_s: the file is read up to this time of the clip [s], to see how much there is; None: to its end.
    """
    place = os.fspath(path)
    with containers.opened_bytes(place) as stream:
        movie = None
        with suppress(*mp4.DAMAGE):
            movie = mp4.Movie.read(stream)
        ends_with_log = _ends_with_log(stream)
        camera = CameraTags() if movie is None else CameraTags.of(movie)
        with containers.read_by_ffmpeg(stream, place) as file:
            video = file.video
            container = file.container
            context = file.video.codec_context
            _check_size(place, video.width, video.height, max_pixels)
            pixels = PixelFormat.of(context.format)
            kind = container.format.name
            start_s = (container.start_time or 0) / 1e6
            begin_s = 0.0 if movie is not None else max(start_s, 0.0)  # editors of MP4 files let clips begin at 0
            length = video.duration * video.time_base if video.duration else containers.length_of(container)
            begun = _Beginning.read(file, pixels, None if until_s is None else begin_s + until_s)
            interval_s = begun.times.interval_s(video)
            times = begun.times
            if video.frames > 1 and 0 < length < interval_s:
                raise UnshutterError("{clip} is damaged: the times of its frames cannot be right", clip=place)
            if "SPHERICAL" in begun.side_data:
                raise UnshutterError("{clip} is a 360-degree clip: its rows are not rows of the sensor", clip=place)
            described = []
            with suppress(*mp4.DAMAGE):
                described = [] if movie is None else movie.track(video.id).descriptions
            dolby_vision = DolbyVision.of(begun.side_data, described)
            if dolby_vision is not None:
                dolby_vision.check(place)
            step = max(1, round(interval_s / float(video.time_base)))
            begin = 0 if times.first is None else times.first - times.untimed * step
            tags = {**pyav.tags(container), **pyav.tags(video)}
            data_tracks = tuple(each.metadata.get("handler_name", "").strip() for each in container.streams.data)
            is_whole = movie is not None and mp4_writer.can_take(movie, video.id)  # all samples are in the file
            facts = ClipFacts(
                path=place,
                pixels=pixels,
                coding=Coding.of(file),
                height=video.height,
                width=video.width,
                interval_s=interval_s,
                frames=video.frames,
                duration_s=float(length),
                tags=tags,
                clock=CameraClock(slowed=camera.slowed(tags, interval_s)),
                camera=camera,
                side_data=begun.side_data,
                kind=kind,
                start_s=start_s,
                begin_s=begin_s,
                has_covers=any(each.disposition & COVER for each in container.streams.video),
                first_packets=begun.first,
                data_tracks=data_tracks,
                can_take_video=is_whole,
                may_have_log=ends_with_log or bool(data_tracks),
                # s within which files without an index have a key frame
                lead_s=math.inf if times.first is None else 10.0 if kind in _NO_TABLES else 0.0,
                expected=ExpectedLength.of(file, interval_s, bool(video.duration) and kind not in _NO_TABLES),
                extent=None if begun.reaches_end or is_whole else begun.extent,
                timing=FrameTiming(begin, step, begun.delay if kind == "avi" else None),
                dolby_vision=dolby_vision,
                progressive=progressive,
                says_interlaced=context.field_order not in (0, 1),
            )
    if not begun.may_have_bars:
        return facts
    return replace(facts, picture=picture_within_bars(pixels, facts.some_frames()))


@dataclass
class _Beginning:
    """What a video's packets show as they are read for the first time."""

    times: FirstTimes = field(default_factory=FirstTimes)
    extent: Extent = field(default_factory=Extent)
    first: dict[int, bytes] = field(default_factory=dict)  # first packet of each other stream
    side_data: dict[str, bytes] = field(default_factory=dict)  # of the first frame
    may_have_bars: bool = False  # whether the first frame's edges are flat
    delay: int = 0  # the first frame's decoding time minus that of its packet [ticks]
    reaches_end: bool = False  # whether the video reaches the time up to which it was to be read

    @classmethod
    def read(cls, file: VideoFile, pixels: PixelFormat, until_s: float | None) -> _Beginning:
        """Reads packets up to a time [s] or, if that is None, to the end of the file; and decodes the first frame."""
        begun = cls()
        first_dts = None
        has_frame = False
        for packet in file.packets():
            of_video = file.is_of_video(packet)
            begun.extent.add(packet, of_video)
            if not of_video:
                if packet.size:
                    begun.first.setdefault(packet.stream.index, bytes(packet))
                continue
            begun.times.add(packet)
            first_dts = packet.dts if first_dts is None else first_dts
            if not has_frame:
                for frame in containers.decode_packet(packet, file)[:1]:
                    has_frame, begun.side_data = True, pyav.side_data(frame)
                    begun.may_have_bars = may_have_bars(pixels, frame)
                    begun.delay = 0 if frame.dts is None or first_dts is None else frame.dts - first_dts
            if has_frame and begun.times.are_enough and begun._reaches(file, until_s):
                break
        if not has_frame:
            raise UnshutterError("{clip} has no frame that can be decoded", clip=file.path)
        begun.reaches_end = begun._reaches(file, until_s)
        return begun

    def _reaches(self, file: VideoFile, until_s: float | None) -> bool:
        return until_s is not None and self.extent.reaches(until_s, self.times.interval_s(file.video))


def _ends_with_log(stream: BinaryIO) -> bool:
    """Whether a file ends with an Insta360's own data, which include the gyro log."""
    with suppress(OSError):
        stream.seek(-len(_INSTA360), os.SEEK_END)
        return stream.read() == _INSTA360
    return False


def _check_size(place: str, width: int, height: int, most: int) -> None:
    """Raises UnshutterError if frames are too small or too large to be processed."""
    if not width or not height:
        raise UnshutterError("{clip} does not state the size of its frames", clip=place)
    size = f"{width}x{height} px"
    if width * height > most:
        millions = f"({width * height / 1e6:.0f} megapixels), more than the limit of {most / 1e6:g} megapixels"
        raise UnshutterError(f"{{clip}} has frames of {size} {millions}: see {{--max-pixels}}", clip=place)
    check_size(height, width, "{clip}: a frame", clip=place)
