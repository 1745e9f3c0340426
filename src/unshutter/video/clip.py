"""An input clip: its properties, its frames with their planes as arrays, and the packets of its other streams."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames import pyav
from unshutter.frames.tracks import Background, Tracks, background, follow
from unshutter.motion.lens import Lens
from unshutter.options.clip_options import MAX_CLIP_PIXELS, RectifyClip
from unshutter.orientation import Readout
from unshutter.photo.photo import check_size
from unshutter.progress import Steps, Watch
from unshutter.video import containers
from unshutter.video.containers import ExpectedLength, FrameTiming, film_of, opened

if TYPE_CHECKING:
    import av
    from av import Packet, VideoFrame

    from unshutter.motion.shapes import UInt, UInt8


@dataclass(frozen=True)
class Plane:
    """Storage of one plane of a pixel format."""

    # consecutive values per pixel (3 in packed RGB, 2 in the chroma of NV12). across, down: pixels of the frame per
    # pixel of the plane.
    bands: int
    across: int
    down: int
    black: int  # value of black in limited-range frames
    black_full: int  # value of black in full-range frames


@dataclass(frozen=True)
class PixelFormat:
    """A pixel format whose planes can be warped."""

    name: str  # FFmpeg's name of the format
    depth: int  # bits per value
    planes: tuple[Plane, ...]  # in the order of the format

    @classmethod
    def of(cls, pixel_format: av.VideoFormat | None) -> PixelFormat:
        """Returns the planes of an FFmpeg pixel format."""
        if pixel_format is None:
            raise UnshutterError("the clip does not state its pixel format")
        name, components = pixel_format.name, pixel_format.components
        by_plane = [[c for c in components if c.plane == k] for k in range(1 + max(c.plane for c in components))]
        depth = components[0].bits
        odd = any(len({(c.bits, c.width) for c in inside}) > 1 for inside in by_plane)
        packed = max(map(len, by_plane)) > 1
        if odd or pixel_format.has_palette or pixel_format.is_bit_stream or not 8 <= depth <= 16 or name.endswith("be"):
            raise UnshutterError(f"cannot process the pixel format {name}: convert the clip to yuv420p first")
        if packed and depth not in (8, 16):  # P010 and similar formats place their bits differently
            raise UnshutterError(f"cannot process the pixel format {name}: convert the clip to yuv420p10le first")
        planes = []
        for k, inside in enumerate(by_plane):
            across, down = -(-pixel_format.width // inside[0].width), -(-pixel_format.height // inside[0].height)
            chroma = not pixel_format.is_rgb and k in (1, 2)
            luma = not pixel_format.is_rgb and k == 0
            black = (1 << depth) // 2 if chroma else 0
            planes.append(Plane(len(inside), across, down, (1 << depth) // 16 if luma else black, black))
        return cls(name, depth, tuple(planes))

    def arrays(self, frame: av.VideoFrame) -> list[UInt[np.ndarray, "rows columns *bands"]]:
        """Returns the planes of a frame: views of its memory, valid as long as the frame exists."""
        dtype = np.dtype(np.uint8 if self.depth == 8 else "<u2")
        views = []
        for stored, plane in zip(frame.planes, self.planes, strict=True):
            shape, size = (-(-frame.height // plane.down), -(-frame.width // plane.across)), dtype.itemsize
            strides = (stored.line_size, plane.bands * size)
            if plane.bands > 1:
                shape, strides = (*shape, plane.bands), (*strides, size)
            views.append(np.ndarray(shape, dtype, buffer=memoryview(stored), strides=strides))
        return views

    def grey(self, frame: av.VideoFrame, side: int) -> UInt8[np.ndarray, "rows columns"]:
        """Returns a small grey copy of a frame, with a short side of about ``side`` px; never larger than the frame."""
        return small_grey(self.arrays(frame)[0], side, self.depth)


def small_grey(
    plane: UInt[np.ndarray, "height width *bands"], side: int, depth: int
) -> UInt8[np.ndarray, "rows columns"]:
    """Returns a small grey copy of a plane: of luma, of packed luma and chroma, or of red, green and blue."""
    luma = plane
    if luma.ndim == 3:
        luma = luma[..., 1] if luma.shape[2] > 2 else luma[..., 0]
    scale = min(1.0, side / min(luma.shape))
    size = (max(1, round(luma.shape[1] * scale)), max(1, round(luma.shape[0] * scale)))
    luma = luma if luma.strides[1] == luma.itemsize else np.ascontiguousarray(luma)
    small = np.asarray(cv2.resize(luma, size, interpolation=cv2.INTER_AREA))
    return np.right_shift(small, depth - 8, dtype=small.dtype, casting="unsafe").astype(np.uint8)


_WHOLE = 0.03  # of a frame interval: times this close to even ones are taken as even
_LONGEST_GAP = 4  # frame intervals; frames farther apart are not neighbours
_PROGRESSIVE = (0, 1)  # FFmpeg's field orders: unknown, progressive
_LEAD_S = 10.0  # s within which files without an index have a key frame
_LARGE = 6_000_000  # px: such frames are decoded one at a time, to save memory; other steps take longer
_DECODED_AHEAD = 2  # frames, if they are small
_AHEAD_BYTES = 25_000_000  # of frames queued between two steps
_NO_TABLES = ("mpegts", "mpeg", "h264", "hevc", "mpegvideo", "m4v", "mjpeg", "obu")  # FFmpeg estimates their length


@dataclass(frozen=True)
class SidePacket:
    """A packet of another stream (sound, subtitles), which is copied to the new file unchanged."""

    packet: Packet


@dataclass(frozen=True)
class Clip:
    """A clip, described by its file's headers and first frames; each reader opens the file separately."""

    path: str  # path of the file
    pixels: PixelFormat
    codec: str  # codec of the frames, as FFmpeg calls it. height, width: size of the stored frames [px].
    height: int
    width: int
    interval_s: float  # the usual time from one frame to the next [s]
    frames: int  # number of frames; 0 if unknown
    duration_s: float  # duration [s]; 0 if unknown
    tags: dict[str, str]  # tags of the container and of the video stream; the latter take precedence
    ticks: int  # time units per second of its frames, at most a million
    # side data of the first frame, by FFmpeg's names; not read from later frames, since PyAV would then never free it
    side_data: dict[str, bytes]
    lead_s: float = field(repr=False)  # how much earlier reading must begin so that a key frame comes first [s]
    expected: ExpectedLength = field(repr=False)  # how much of the clip there should be
    timing: FrameTiming = field(repr=False)  # how its frames get their times
    bits_per_s: float = 0.0  # bit rate of the frames; 0 if unknown

    @classmethod
    def look(cls, path: str | os.PathLike[str], max_pixels: int = MAX_CLIP_PIXELS) -> Clip:
        """Reads the headers and the first frames of a file.

        Args:
            max_pixels: clips with larger frames are rejected.
        """
        place = os.fspath(path)
        with opened(place) as container:
            stream = film_of(container, place)
            context = stream.codec_context
            _check_size(place, stream.width, stream.height, max_pixels)
            if context.field_order not in _PROGRESSIVE:
                raise _interlaced(place)
            kind, base = container.format.name, float(stream.time_base)
            length = stream.duration * stream.time_base if stream.duration else (container.duration or 0) / 1_000_000
            tags = {**pyav.tags(container), **pyav.tags(stream)}
            stored = (place, PixelFormat.of(context.format), context.name, stream.height, stream.width)
            ticks = min(stream.time_base.denominator, 1_000_000)
            by_tables = bool(stream.duration) and kind not in _NO_TABLES
            interval, first, before = containers.first_times(container, stream)
            rate = containers.bits_per_s(container, stream)
            if stream.frames > 1 and 0 < length < interval:
                raise UnshutterError("{clip} is damaged: the times of its frames cannot be right", clip=place)
            frames, expected = stream.frames, ExpectedLength.of(container, stream, interval, by_tables)
        beside, delay = _first_frame(place)
        if "SPHERICAL" in beside:
            raise UnshutterError("{clip} is a 360-degree clip: its rows are not rows of the sensor", clip=place)
        step = max(1, round(interval / base))
        begin = 0 if first is None else first - before * step
        timing = FrameTiming(begin, step, delay if kind == "avi" else None)
        lead_s = math.inf if first is None else _LEAD_S if kind in _NO_TABLES else 0.0
        times = (interval, frames, float(length), tags, ticks, beside, lead_s, expected, timing)
        return cls(*stored, *times, rate)

    def opened(self) -> AbstractContextManager[Any]:
        """Opens the file with PyAV; raises UnshutterError if it can no longer be read."""
        return opened(self.path)

    @property
    def frame_bytes(self) -> float:
        """Memory size of a decoded frame [bytes]."""
        size = sum(plane.bands / plane.across / plane.down for plane in self.pixels.planes)
        return size * self.height * self.width * (1 if self.pixels.depth == 8 else 2)

    def iter_frames(self, start: float | None = None, end: float | None = None) -> Iterator[VideoFrame]:
        """Yields the frames between two times [s] in presentation order; None means no limit."""
        for item in self._items(start, end):
            if not isinstance(item, SidePacket):
                yield item

    def items(
        self, start: float | None = None, end: float | None = None, all_streams: bool = False
    ) -> Generator[VideoFrame | SidePacket]:
        """Yields frames in presentation order, and packets of the other streams where they lie between them.

        A separate thread decodes the next frames.
        """
        return ahead(self._items(start, end, all_streams), self.most_ahead(_DECODED_AHEAD))

    def most_ahead(self, frames: int) -> int:
        """Returns how many frames may wait between two steps: as many as given, or fewer if they are large."""
        return min(frames, max(1, int(_AHEAD_BYTES / self.frame_bytes)))

    def _items(
        self, start: float | None, end: float | None, all_streams: bool = False
    ) -> Iterator[VideoFrame | SidePacket]:
        with self.opened() as container:
            film = film_of(container, self.path)
            film.thread_type = "AUTO" if self.height * self.width < _LARGE else "SLICE"
            if start and start - self.lead_s > self.expected.start_s:
                container.seek(int((start - self.lead_s) / film.time_base), stream=film)
            times = containers.Times(self.timing)
            for packet in containers.packets(container, None, self.path):
                of_film = packet.stream.index == film.index  # packet.stream_index is 0 in the final, empty packets
                if not of_film:
                    if all_streams and packet.dts is not None and _is_within(containers.time_of(packet), start, end):
                        yield SidePacket(packet)
                    continue
                for frame in containers.decoded(packet, self.path):
                    times.set(frame)
                    if _is_within(frame.time, start, end):
                        yield self._checked(frame)
                    elif not all_streams and end is not None and (frame.time or 0) >= end:
                        return

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
            raise containers.damaged(self.path, frame.time)
        if frame.interlaced_frame:
            raise _interlaced(self.path)
        if (frame.width, frame.height, frame.format.name) != (self.width, self.height, self.pixels.name):
            raise UnshutterError(
                f"{{clip}}: its frames change in size or format at {frame.time or 0:.1f} s", clip=self.path
            )
        return frame


@dataclass(frozen=True)
class ClipRequest:
    """A clip, and what the user wants from it."""

    clip: Clip
    options: RectifyClip
    readout: Readout  # direction in which the stored pixels were read
    watch: Watch | None = None  # called for every step of the work
    lens: Lens | None = None  # the camera's lens, if it is known to bend straight lines

    @classmethod
    def of(cls, clip: Clip, options: RectifyClip, watch: Watch | None = None) -> ClipRequest:
        """Returns the request of a clip whose readout direction is that of the options."""
        return cls(clip, options, Readout.parse(options.shutter.readout), watch)

    @property
    def frame_size(self) -> tuple[int, int]:
        """Height and width of the readout frame [px]."""
        return self.readout.frame_size(self.clip.height, self.clip.width)

    @property
    def focal(self) -> float | None:
        """Focal length [heights of the readout frame], if it is known."""
        stated = self.options.shutter.focal_px
        return self.lens.focal if self.lens is not None else stated and stated / self.frame_size[0]

    @property
    def span(self) -> tuple[float, float]:
        """Begin and end of the selected part [s]."""
        return self.options.span(self.clip.duration_s)

    def grey(self, frame: VideoFrame, side: int) -> UInt8[np.ndarray, "rows columns"]:
        """Returns a small grey copy of a frame, as it was read out, with a short side of about ``side`` px."""
        return np.ascontiguousarray(self.readout.turn(self.clip.pixels.grey(frame, side)))

    def steps(self, what: str) -> Steps:
        """Returns a counter for the frames of the selected part, as many as the file states; at least 2."""
        start, end, clip = self.options.start, self.options.end, self.clip
        frames = clip.frames
        if start is not None or end is not None or not frames:
            last = min(end or clip.duration_s, clip.duration_s or math.inf)
            frames = max(round((last - (start or 0.0)) / clip.interval_s), 2)
        return Steps(what, frames, self.watch)


def upright(pixels: UInt8[np.ndarray, "rows columns 3"], turned_as: VideoFrame) -> UInt8[np.ndarray, "height width 3"]:
    """Returns pixels turned as the frame is to be shown: its file states an angle, anticlockwise."""
    return np.ascontiguousarray(np.rot90(pixels, round(turned_as.rotation / 90)))


def _check_size(place: str, width: int, height: int, most: int) -> None:
    """Raises UnshutterError if frames are too small or too large to be processed."""
    if not width or not height:
        raise UnshutterError("{clip} does not state the size of its frames", clip=place)
    size = f"{width}x{height} px"
    if width * height > most:
        millions = f"({width * height / 1e6:.0f} megapixels), more than the limit of {most / 1e6:g} megapixels"
        raise UnshutterError(f"{{clip}} has frames of {size} {millions}: see {{--max-pixels}}", clip=place)
    check_size(height, width, "{clip}: a frame", clip=place)


def _first_frame(place: str) -> tuple[dict[str, bytes], int]:
    """Returns the first frame's side data, and the delay of its decoding time after that of its packet [ticks]."""
    with opened(place) as container:
        film, first_dts = film_of(container, place), None
        for packet in containers.packets(container, film, place):
            first_dts = packet.dts if first_dts is None else first_dts
            for frame in containers.decoded(packet, place):
                if frame.interlaced_frame:
                    raise _interlaced(place)
                delay = frame.dts - first_dts if frame.dts is not None and first_dts is not None else 0
                return pyav.side_data(frame), delay
    raise UnshutterError("{clip} has no frame that can be decoded", clip=place)


def _is_within(at: float | None, start: float | None, end: float | None) -> bool:
    return at is None or ((start is None or at >= start - 1e-6) and (end is None or at < end))


def _interlaced(place: str) -> UnshutterError:
    return UnshutterError("{clip} is interlaced (its rows show two moments): deinterlace it first", clip=place)


# ---- frames ahead of their use, and tracks between them ----------------------------------------------------------

_T = TypeVar("_T")
_END = object()


def ahead(items: Iterable[_T], most: int) -> Generator[_T]:
    """Yields the items, computed by a separate thread up to ``most`` ahead; re-raises its errors.

    When the iterator is closed, the thread ends after its current item and closes its own source.
    """
    source, waiting = iter(items), deque[Future[Any]]()
    with ThreadPoolExecutor(1) as thread:
        try:
            waiting.extend(thread.submit(next, source, _END) for _ in range(most))
            while (item := waiting.popleft().result()) is not _END:
                waiting.append(thread.submit(next, source, _END))
                yield item
        finally:
            for future in waiting:
                future.cancel()
            if isinstance(source, Generator):
                thread.submit(source.close)


COPY_SIDE = 270  # px, short side of the copies in which corners are tracked
_FOLLOWED_AHEAD = 3  # frames


def followed(
    request: ClipRequest, start: float | None, end: float | None, side: int = COPY_SIDE
) -> Iterator[tuple[VideoFrame, float | None, Tracks | None, Background | None]]:
    """Yields the frames between two times [s], each with tracks of corners since the previous one.

    Args:
        start, end: the times; None means no limit.
        side: short side of the grey copies in which corners are tracked [px].

    Yields:
        The frame; the time since the previous one (:meth:`Clip.since`); and, except for the first frame, all tracks
        and those of the background.
    """
    clip, before, grey_before = request.clip, None, None
    for frame in ahead(clip.iter_frames(start, end), _FOLLOWED_AHEAD):
        grey = request.grey(frame, side)
        tracks = None if grey_before is None else follow(grey_before, grey, request.lens)
        yield frame, clip.since(before, frame), tracks, None if tracks is None else background(tracks)
        before, grey_before = frame, grey
