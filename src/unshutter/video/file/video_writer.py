"""Writes the new video, whose frames are encoded, and everything else copied."""

from __future__ import annotations

import errno
import io
import math
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.pyav import VIDEO_FORMATS, av
from unshutter.inventory import Fate, Part
from unshutter.options.clip_options import Encode
from unshutter.progress import ClipObserver
from unshutter.video.file.clip_facts import ClipFacts
from unshutter.video.file.containers import ALPHA_MODE, COVER, ONE_FILM, VideoFile, creation_time, opened, time_of
from unshutter.video.file.dynamic_hdr import DynamicHdr
from unshutter.video.file.encoders import REDUCED, Encoder, light_boxes, others_for
from unshutter.video.file.part_times import chapters_of_part, timecode_after
from unshutter.video.file.pixels import FULL_RANGE, LIMITED_RANGE
from unshutter.video.file.stages import Stage, Work

if TYPE_CHECKING:
    from av import Packet, VideoFrame


_TELLING_S = 2.0  # s of the new video from which its size is predicted
_ALIKE = 1.6  # ratio of bit rates; smaller differences are not reported
_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_PRIMING_S = 0.1  # sound that decoders need before the time at which it begins
_CLOCKS = ("mpegts", "mpeg")  # formats whose times begin anywhere
USUAL = (".mp4", ".mov", ".mkv")  # file endings of previews, which are offered instead of another, too
_PREVIEWS = (".jpg", ".jpeg", ".png")
_MP4 = (".mp4", ".mov", ".m4v", ".lrv")


class VideoWriter:
    """Writes a video from two streams: frames, and packets of the clip's other streams, which are merged by time.

    Attributes:
        waiting: packets, in order, that are written before the next later frame. They may be added by another thread.
        parts: what becomes of the clip's streams, and of what else the video cannot hold.
        carried: streams of the clip that the video has.
        is_part: whether the video is only a part of the clip.
        covers: cover pictures that are not written with the video.

    Args:
        container: PyAV's, open for writing.
        source: the clip's file, open.
        ending: file ending of the video, if tags and other streams are copied too; None if not.
        size: height and width of the frames [px].
        start_s: time in the input that becomes 0 in the new video [s].
        part: when the part of the clip begins and ends that is written, if not with the clip [s].
        work: counts encoded frames; its observer receives the bit rates of the clip and of the new video if they differ
            considerably, once and early.
    """

    def __init__(
        self,
        container: Any,
        source: VideoFile,
        clip: ClipFacts,
        encoder: Encoder,
        ending: str | None,
        size: tuple[int, int],
        start_s: float,
        part: tuple[float | None, float | None],
        work: Work,
    ):
        self._container = container
        self._pixel_format = encoder.pixel_format
        like = source.video
        self._stream = encoder.add_to(container, clip, size)
        self._streams: dict[int, Any] = {}
        self.waiting: deque[Packet] = deque()
        self.parts: list[Part] = []
        self.carried: list[Any] = []
        self.covers: list[bytes] = []
        self._clip = clip
        self._part = part
        self.is_part = part != (None, None)
        with suppress(ValueError, AttributeError):
            self._stream.disposition = like.disposition
        if ending is not None:  # otherwise a timecode would become a track of its own
            self._stream.metadata.update(self._tags(like.metadata))
            container.metadata.update(self._tags({**source.container.metadata, **creation_time(source)}))
            self._add_others(source, encoder, ending)
            if chapters := self._chapters(source):
                container.set_chapters(chapters)
        is_whole = size == (clip.height, clip.width)  # otherwise, places in the metadata would be others
        self._dynamic_hdr = DynamicHdr.between(like, encoder.name, clip.dolby_vision) if is_whole else None
        if self._dynamic_hdr is not None:
            source.readers.append(self._dynamic_hdr.read)
        self._shift = start_s
        self._undated: dict[int, list[Packet]] = {}  # packets of a stream without a decoding time, as it begins
        self._earliest_dts: dict[int, int] = {}  # of the next packet of a stream
        if encoder.pixel_format in REDUCED.values() and clip.pixels.name in REDUCED:
            self.parts.append(Part("the last 2 of 12 bits of each colour", Fate.LEFT_OUT, f"{encoder.name} writes 10"))
        if any(name.lower() == ALPHA_MODE and value != "0" for name, value in like.metadata.items()):
            self.parts.append(Part("transparency", Fate.LEFT_OUT, "FFmpeg does not decode that of VP8 and VP9"))
        self._narrows = encoder.narrows
        if encoder.narrows:
            why = f"converted to the limited range of {encoder.name}"
            self.parts.append(Part("the full range of levels", Fate.LEFT_OUT, why))
        self._kind = f"{encoder.name} in a file of the kind '{container.format.name}'"
        self._bytes = 0
        self._packets = 0
        self._work = work
        self._observer: ClipObserver | None = work.observer  # None once it was told
        self._last = -(1 << 62)  # time of the previous frame [units of the encoder]
        if len(matrix := clip.side_data.get("DISPLAYMATRIX", b"")) >= 36:
            self._stream.set_display_matrix(struct.unpack("=9i", matrix[:36]))

    def _add_others(self, source: VideoFile, encoder: Encoder, ending: str) -> None:
        """Adds the clip's other streams, as far as the new video can hold them."""
        films = source.other_films
        for stream in source.container.streams:
            is_film = stream.index == source.video.index
            fate = Fate.REPLACED if is_film else self._add_stream(source, stream, encoder, ending)
            if fate is None:
                continue
            if fate is Fate.CARRIED:
                self.carried.append(stream)
            reason = ONE_FILM if fate is Fate.CARRIED and stream in films else ""
            self.parts.append(Part(f"stream {stream.index} ({_name(stream)})", fate, reason))

    def _add_stream(self, source: VideoFile, stream: Any, encoder: Encoder, ending: str) -> Fate | None:
        """Adds a stream; returns what becomes of it, None for the titles of chapters, which the container writes."""
        packet = self._clip.first_packets.get(stream.index)
        tags = stream.metadata
        if stream.type == "data" and packet is None and source.container.chapters() and "timecode" not in tags:
            return None
        cover = packet if stream.disposition & COVER else None
        if stream.type == "data" and "timecode" in tags and ending in (*_MP4, ".mkv"):
            self._stream.metadata["timecode"] = self._tags(tags)["timecode"]  # the container makes its own track
            return Fate.TRANSFORMED
        if cover is not None and ending in _MP4:
            self.covers.append(cover)
        elif (cover is not None or stream.type == "attachment") and ending == ".mkv":
            kind = "image/png" if cover is not None and stream.codec_context.name == "png" else "image/jpeg"
            name = tags.get("filename") or f"cover.{kind[-3:]}"
            kind = tags.get("mimetype") or kind
            self._container.add_attachment(name, kind, stream.data if cover is None else cover)
        else:
            alone = partial(_first_packet, path=source.path, stream=stream, data=packet)
            trials: list[tuple[Callable[[Any], Callable[[], None]], ...]] = [(alone,)]
            if stream.type != "video":  # MXF takes others only next to frames
                trials.append((partial(_frame, clip=self._clip, encoder=encoder), alone))
            if not any(_takes(ending, stream.type, *each) for each in trials):
                return Fate.LEFT_OUT
            self._streams[stream.index] = copy = _add_copy(self._container, source.path, stream)
            copy.metadata.update(self._tags(tags))
        return Fate.CARRIED

    def _tags(self, tags: Any) -> dict[str, str]:
        """Returns tags as a new file has them: with the timecode of the part's first frame."""
        kept = {key: value for key, value in dict(tags).items() if key not in _REGENERATED}
        start_s, _ = self._part
        if start_s is not None and "timecode" in kept:
            first_s = float(self._clip.timing.start * (self._clip.coding.time_base or 0))
            kept["timecode"] = timecode_after(kept["timecode"], max(start_s - first_s, 0.0), self._clip.coding.rate)
        return kept

    def _chapters(self, source: VideoFile) -> list[dict[str, Any]]:
        chapters = source.container.chapters()
        start_s, end_s = self._part
        if not self.is_part:
            return chapters
        return chapters_of_part(chapters, start_s or 0.0, math.inf if end_s is None else end_s)

    @property
    def has_dolby_vision(self) -> bool:
        """Whether the new frames have the Dolby Vision of the clip's."""
        return self._dynamic_hdr is not None and self._dynamic_hdr.has_dolby_vision

    def add_frame(self, frame: VideoFrame) -> None:
        """Writes the next rectified frame, with the times of the original, after the packets that come before it."""
        self._add_packets(frame.time or 0.0)
        if self._narrows:
            levels = {"src_color_range": FULL_RANGE, "dst_color_range": LIMITED_RANGE}
            frame = frame.reformat(format=self._pixel_format, **levels)
        elif frame.format.name != self._pixel_format:
            frame = frame.reformat(format=self._pixel_format)
        frame.pict_type = 0  # the encoder chooses the key frames
        if frame.pts is not None and frame.time_base:
            base = self._stream.codec_context.time_base
            before = frame.pts
            ticks = round((before - round(self._shift / frame.time_base)) * frame.time_base / base)
            frame.pts = self._last = max(ticks, self._last + self._least_step())
            if self._dynamic_hdr is not None:
                self._dynamic_hdr.follow(before, self._last)
            frame.time_base = base
        self._put(lambda: self._add_encoded(self._stream.encode(frame)))

    def _least_step(self) -> int:
        """Returns the least time between two frames that the file tells apart, too [units of the encoder]."""
        self._container.start_encoding()
        own = self._stream.time_base
        return 1 if not own else max(math.ceil(own / self._stream.codec_context.time_base), 1)

    def _add_packets(self, until_s: float) -> None:
        def begins_s(packet: Packet) -> float:
            at = packet.pts if packet.dts is None else packet.dts
            return float((at or 0) * packet.time_base)

        while self.waiting and begins_s(self.waiting[0]) <= until_s:
            self._add_packet(self.waiting.popleft())

    def _add_packet(self, packet: Packet) -> None:
        """Writes the next packet of another stream, or holds it until its decoding time is known."""
        number = packet.stream_index
        if number not in self._streams or (packet.is_discard and (time_of(packet) or 0.0) < -_PRIMING_S):
            return
        undated = self._undated.setdefault(number, [])
        if packet.dts is None:
            undated.append(packet)
            return
        step = max(packet.duration or 1, 1)
        for before, earlier in enumerate(reversed(undated), 1):
            earlier.dts = packet.dts - before * step
        for each in (*undated, packet):
            self._mux(each)
        undated.clear()

    def _mux(self, packet: Packet) -> None:
        by = round(self._shift / packet.time_base)
        assert packet.dts is not None
        earliest = self._earliest_dts.get(packet.stream_index, packet.dts - by)
        packet.dts = max(packet.dts - by, earliest)
        self._earliest_dts[packet.stream_index] = packet.dts + 1
        if packet.pts is not None:
            packet.pts = max(packet.pts - by, packet.dts)
        packet.stream = self._streams[packet.stream_index]
        self._put(lambda: self._container.mux(packet))

    def end(self) -> None:
        """Completes the file after the last frame."""
        self._add_packets(math.inf)
        for undated in self._undated.values():
            for packet, at in zip(undated, sorted(each.pts or 0 for each in undated), strict=True):
                packet.dts = at
                self._mux(packet)
        self._put(lambda: self._add_encoded(self._stream.codec_context.encode_lazy(None)))
        self._put(self._container.close)

    def _add_encoded(self, encoded: Iterable[Packet]) -> None:
        """Writes the next packets of the video; compares its bit rate with the clip's once it can be predicted."""
        for each in encoded:
            packet = each if self._dynamic_hdr is None else self._dynamic_hdr.completed(each)
            packet.stream = self._stream
            self._bytes = self._bytes + packet.size
            self._packets = self._packets + 1
            self._container.mux(packet)
            self._work.advance(Stage.ENCODE)
        seconds = self._packets * self._clip.interval_s
        if self._observer is None or seconds < _TELLING_S or not self._clip.coding.bits_per_s:
            return
        rate = 8 * self._bytes / seconds
        if not 1 / _ALIKE < rate / self._clip.coding.bits_per_s < _ALIKE:
            self._observer.note_rate(self._clip.coding.bits_per_s, rate)
        self._observer = None

    def _put(self, step: Any) -> None:
        try:
            step()
        except av().error.FFmpegError as error:
            cause = "the disc is full" if error.errno == errno.ENOSPC else error.strerror
            if error.errno == errno.EINVAL:
                cause = f"{self._kind} does not take its frames or their times; try another {{--codec}}, or .mkv"
            raise UnshutterError(f"cannot encode the clip: {cause}") from None


def check_endings(video: Path, preview: Path | None) -> None:
    """Raises UnshutterError if a video cannot have its name, or a preview is neither a picture nor a video."""
    check_ending(video.suffix)
    if preview is not None and preview.suffix.lower() not in (*USUAL, *_PREVIEWS):
        raise UsageError(f"a preview is a picture (.jpg, .png) or a video (.mp4), not {preview.name}")


def check_ending(ending: str) -> None:
    """Raises UnshutterError if no video that is one file has this file ending."""
    if ending.lower() in _PICTURES:
        raise UnshutterError(
            f"'{ending}' is not a video: write video.mkv, and take it apart, ffmpeg -i video.mkv out/%05d{ending}"
        )
    if ending.lower() not in VIDEO_FORMATS:
        problem = f"no video that is one file ends in '{ending}'" if ending else "the name of the video has no ending"
        raise UnshutterError(f"{problem}: use .mp4, .mov or .mkv")


@contextmanager
def writing(place: Path | BinaryIO, ending: str, ticks: int = 1000) -> Iterator[Any]:
    """Opens a container for writing.

    Args:
        ticks: time units per second for the file as a whole, if it has any.
    """
    check_ending(ending)
    options = {"fflags": "+bitexact"}  # otherwise Matroska and MXF get random numbers and the time of writing
    if ending.lower() in _MP4:
        early = "+faststart" if isinstance(place, Path) else ""
        options = {"movie_timescale": str(ticks), "movflags": f"use_metadata_tags{early}"}
    file = str(place) if isinstance(place, Path) else place
    try:
        container = av().open(file, "w", format=VIDEO_FORMATS[ending.lower()], container_options=options)
    except (ValueError, av().error.FFmpegError) as error:
        raise UnshutterError(f"cannot write the clip: {error}") from None
    try:
        yield container
    finally:
        with suppress(Exception):  # the first error has already been raised
            container.close()


def start_of(clip: ClipFacts, ending: str) -> float:
    """Returns the clip's time [s] that becomes 0 in a video with another container, which may hide what is before 0."""
    if clip.kind in _CLOCKS and clip.kind != VIDEO_FORMATS[ending]:
        return clip.start_s
    return min(clip.start_s, 0.0) if clip.timing.start < 0 else 0.0


def is_completed(ending: str, clip: ClipFacts, encoder: Encoder) -> bool:
    """Whether a video of this file ending gets what FFmpeg drops from ``mp4_writer.write_completed``."""
    return ending.lower() in _MP4 and (clip.has_covers or bool(light_boxes(clip, encoder.name)))


def fitted(encoder: Encoder, clip: ClipFacts, ending: str) -> Encoder:
    """Returns the encoder adapted to a file ending: with the clip's codec tag if possible.

    The error names endings and encoders that were tried and work.
    """

    def fits(ending: str, encoder: Encoder, in_full_range: bool = False) -> bool:
        return _takes(ending, "video", partial(_frame, clip=clip, encoder=encoder), in_full_range=in_full_range)

    untagged = replace(encoder, tagged=False)
    for trial in (encoder, untagged):
        if fits(ending, trial):
            return replace(trial, narrows=clip.is_full_range and not fits(ending, trial, in_full_range=True))
    endings = [other for other in USUAL if fits(other, untagged)]
    others = (Encoder.choose(clip, Encode(name)) for name in others_for(clip.pixels.name))
    codec = next((f"add {{--codec}} {other.name}" for other in others if fits(ending, other)), "")
    names = f"end the name in {' or '.join(endings)}" if endings else ""
    ways = ", or ".join(filter(None, (names, codec))) or "choose another {--codec}"
    raise UnshutterError(
        f"cannot write {encoder.name} into {ending} videos ({clip.width}x{clip.height} px, {encoder.pixel_format}): "
        f"{ways}"
    )


def _takes(ending: str, kind: str, *adding: Callable[[Any], Callable[[], None]], in_full_range: bool = False) -> bool:
    """Whether a video can hold streams, one of them of a kind; many formats report late or never what they leave out.

    Args:
        adding: each adds a stream to a container, and returns what writes into it once all are there.
        in_full_range: whether frames must be read back as of full range.
    """
    file = io.BytesIO()
    try:
        with writing(file, ending) as container:
            for write in [add(container) for add in adding]:
                write()
            container.close()
        file.seek(0)
        with av().open(file) as back:
            found = [stream for stream in back.streams if stream.type == kind]
            return any(kind != "video" or _has_frames(each, in_full_range) for each in found)
    except (ValueError, UnshutterError, av().error.FFmpegError):
        return False


def _has_frames(stream: Any, in_full_range: bool) -> bool:
    if not stream.codec_context or not stream.codec_context.pix_fmt:
        return False
    frames = stream.container.decode(stream) if in_full_range else ()  # a container's word for it may not count
    return not in_full_range or any(each.color_range == FULL_RANGE for each in frames)


def _frame(container: Any, clip: ClipFacts, encoder: Encoder) -> Callable[[], None]:
    """Adds the encoder's stream to a container; returns what writes a black frame."""
    stream = encoder.add_to(container, clip, (clip.height, clip.width))

    def write() -> None:
        frame = av().VideoFrame(clip.width, clip.height, encoder.pixel_format)
        for plane in frame.planes:  # encoders of 10 bits may not survive larger numbers
            plane.update(bytes(plane.buffer_size))
        frame.pts = 0
        frame.time_base = stream.codec_context.time_base
        for packet in [*stream.encode(frame), *stream.encode(None)]:
            packet.dts = packet.pts  # which libx265 gets wrong for a single frame
            container.mux(packet)

    return write


def _first_packet(container: Any, path: str, stream: Any, data: bytes | None) -> Callable[[], None]:
    """Adds a stream like another to a container; returns what writes a first packet of these data."""
    packet = av().Packet(bytes(4) if data is None else data)
    packet.stream = _add_copy(container, path, stream)
    packet.pts = 0
    packet.dts = 0
    return partial(container.mux, packet)


def _add_copy(container: Any, path: str, stream: Any) -> Any:
    """Returns a stream of a container that is like another, of the clip's file."""
    sound = stream.codec_context if stream.type == "audio" else None  # None, too, if FFmpeg does not know the codec
    if sound is not None and sound.delay > _PRIMING_S * stream.rate:
        # FFmpeg 9 calls all sound that an edit list hides priming, and the new video would be silent for as long
        with opened(path, ignore_editlist="1") as source:
            copy = container.add_stream_from_template(source.container.streams[stream.index], opaque=True)
    else:
        copy = container.add_stream_from_template(stream, opaque=True)
    with suppress(ValueError, AttributeError):
        copy.disposition = stream.disposition
    if sound is not None and "channels" in sound.layout.name and stream.channels <= 2:
        copy.codec_context.layout = ("mono", "stereo")[stream.channels - 1]  # as players take it; MP4 must say it
    return copy


def _name(stream: Any) -> str:
    if stream.disposition & COVER:
        return "cover picture"
    tags = stream.metadata
    codec = stream.codec_context
    codec_name = f", {codec.name}" if codec is not None else ""
    return tags.get("handler_name", "").strip() or tags.get("filename") or f"{stream.type}{codec_name}"


_REGENERATED = {"encoder", "major_brand", "minor_version", "compatible_brands"}
