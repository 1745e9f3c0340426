"""Writes the output film: encodes frames and copies everything else."""

from __future__ import annotations

import errno
import io
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

from unshutter.errors import UnshutterError
from unshutter.video import pictures
from unshutter.video.clip import Clip
from unshutter.video.containers import av, film_of
from unshutter.video.encoders import Encoder

if TYPE_CHECKING:
    from av import Packet, VideoFrame

RateCallback: TypeAlias = Callable[[float, float], None]  # receives the bit rates of the clip and of the new film
_TELLING_S = 2.0  # s of the new film from which its size is predicted
_ALIKE = 1.6  # ratio of bit rates; smaller differences are not reported


class FilmWriter:
    """Writes a film from frames and packets, in order.

    Args:
        container: PyAV's, open for writing.
        source: the input file, open.
        clip: the input clip.
        encoder: encoder of the frames.
        copy: whether to copy tags and other streams too.
        size: height and width of the frames [px].
        start_s: time in the input at which the new film starts [s].
        on_rate: called once, early, with the bit rates of the clip and of the new film if they differ considerably.

    Attributes:
        left_out: streams of the input file that could not be copied, for the user.
    """

    def __init__(
        self,
        container: Any,
        source: Any,
        clip: Clip,
        encoder: Encoder,
        copy: bool,
        size: tuple[int, int],
        start_s: float = 0.0,
        on_rate: RateCallback | None = None,
    ):
        self._container, self._pixel_format = container, encoder.pixel_format
        like = film_of(source, clip.path)
        self._stream = encoder.add_to(container, like, clip, size)
        self._streams: dict[int, Any] = {}
        self.left_out: list[str] = []
        self._stream.metadata.update(_portable_tags(like.metadata))
        with suppress(ValueError, AttributeError):
            self._stream.disposition = like.disposition
        if copy:
            container.metadata.update(_portable_tags(source.metadata))
            self._add_others(source, like)
            if source.chapters():
                container.set_chapters(source.chapters())
        self._shift = start_s  # becomes time 0
        self._kind = f"{encoder.name} in a file of the kind '{container.format.name}'"
        self._clip, self._on_rate, self._bytes, self._packets = clip, on_rate, 0, 0
        self._last = -(1 << 62)  # time of the previous frame [units of the encoder]
        if len(matrix := clip.side_data.get("DISPLAYMATRIX", b"")) >= 36:
            self._stream.set_display_matrix(struct.unpack("=9i", matrix[:36]))

    def _add_others(self, source: Any, film: Any) -> None:
        for stream in source.streams:
            if stream.index == film.index:
                continue
            try:
                if stream.type == "attachment":
                    copy = self._container.add_attachment(stream.name or "", stream.mimetype or "", stream.data)
                else:
                    if not _takes(self._container, stream):
                        raise ValueError
                    copy = self._container.add_stream_from_template(stream)
                    self._streams[stream.index] = copy
                    with suppress(ValueError, AttributeError):
                        copy.disposition = stream.disposition
                copy.metadata.update(_portable_tags(stream.metadata))
            except (ValueError, av().error.FFmpegError):
                name = stream.metadata.get("handler_name", "").strip() or stream.type
                self.left_out.append(f"stream {stream.index} ({name})")

    def add_frame(self, frame: VideoFrame) -> None:
        """Writes the next rectified frame, with the times of the original."""
        if frame.format.name != self._pixel_format:
            frame = frame.reformat(format=self._pixel_format)
        frame.pict_type = 0  # the encoder chooses the key frames
        if frame.pts is not None and frame.time_base is not None:
            base = self._stream.codec_context.time_base
            ticks = round((frame.pts - round(self._shift / frame.time_base)) * frame.time_base / base)
            frame.pts = self._last = max(ticks, self._last + 1)
            frame.time_base = base
        self._put(lambda: self._add_encoded(self._stream.encode(frame)))

    def add_packet(self, packet: Packet) -> None:
        """Writes the next packet of another stream."""
        copy = self._streams.get(packet.stream_index)
        if copy is None:
            return
        if self._shift:
            by = round(self._shift / packet.time_base)
            packet.dts = (packet.dts or 0) - by
            packet.pts = None if packet.pts is None else packet.pts - by
            if packet.dts < 0:
                return
        packet.stream = copy
        self._put(lambda: self._container.mux(packet))

    def end(self) -> None:
        """Completes the file after the last frame."""
        self._put(lambda: self._add_encoded(self._stream.encode(None)))
        self._put(self._container.close)

    def _add_encoded(self, encoded: list[Packet]) -> None:
        """Writes the next packets of the film; compares its bit rate with the clip's once it can be predicted."""
        for packet in encoded:
            self._bytes, self._packets = self._bytes + packet.size, self._packets + 1
        self._container.mux(encoded)
        seconds = self._packets * self._clip.interval_s
        if self._on_rate is None or seconds < _TELLING_S or not self._clip.bits_per_s:
            return
        rate = 8 * self._bytes / seconds
        if not 1 / _ALIKE < rate / self._clip.bits_per_s < _ALIKE:
            self._on_rate(self._clip.bits_per_s, rate)
        self._on_rate = None

    def _put(self, step: Any) -> None:
        try:
            step()
        except av().error.FFmpegError as error:
            cause = "the disc is full" if error.errno == errno.ENOSPC else error.strerror
            if error.errno == errno.EINVAL:
                cause = f"{self._kind} does not take its frames or their times; try another --codec, or .mkv"
            raise UnshutterError(f"cannot encode the clip: {cause}") from None


def check_ending(ending: str) -> None:
    """Raises UnshutterError if no writable film format has this file ending."""
    if ending.lower() in pictures.ENDINGS:
        raise UnshutterError(
            f"'{ending}' is not a film: name a new folder for pictures, or a pattern: out/%05d{ending}"
        )
    names = (name for name in av().formats_available if not name.endswith("_pipe"))
    formats = [each for each in map(av().format.ContainerFormat, names) if each.is_output]
    if not any(ending.lower().lstrip(".") in each.extensions for each in formats):
        raise UnshutterError(f"cannot write the clip: no film ends in '{ending}': use .mp4, .mov or .mkv")


@contextmanager
def writing(place: Path | BinaryIO, ending: str, ticks: int = 1000) -> Iterator[Any]:
    """Opens a container for writing.

    Args:
        place: a path, or an open file.
        ending: file ending of the film.
        ticks: time units per second for the file as a whole, if it has any.

    Raises:
        UnshutterError: the file ending is unknown.
    """
    options = {}
    if ending.lower() in (".mov", ".mp4", ".m4v"):
        options = {"movie_timescale": str(ticks)}
        if isinstance(place, Path):
            options["movflags"] = "use_metadata_tags+faststart"
    check_ending(ending)
    try:
        if isinstance(place, Path):
            container = av().open(str(place), "w", container_options=options)
        else:
            container = av().open(place, "w", format="mp4" if ending.lower() != ".mov" else "mov", options=options)
    except (ValueError, av().error.FFmpegError) as error:
        raise UnshutterError(f"cannot write the clip: {error}") from None
    try:
        yield container
    finally:
        with suppress(Exception):  # the first error has already been raised
            container.close()


def _takes(container: Any, stream: Any) -> bool:
    """Whether a container can hold a stream; muxers only report this when writing a header."""
    trial = av().open(io.BytesIO(), "w", format=container.format.name)
    try:
        trial.add_stream_from_template(stream)
        trial.start_encoding()
    except (ValueError, av().error.FFmpegError):
        return False
    finally:
        with suppress(Exception):
            trial.close()
    return True


def _portable_tags(tags: Any) -> dict[str, str]:
    return {key: value for key, value in dict(tags).items() if key not in _REGENERATED}


_REGENERATED = {"encoder", "major_brand", "minor_version", "compatible_brands"}


# ---- pictures ----------------------------------------------------------------------------------------------


def write_picture(frame: VideoFrame, path: Path) -> None:
    """Writes a frame as a picture.

    Raises:
        UnshutterError: it cannot be written.
    """
    codec = pictures.ENDINGS[path.suffix.lower()]
    context = av().CodecContext.create(codec, "w")
    formats = av().Codec(codec, "w").video_formats or []
    format_ = frame.format.name
    if format_ not in [each.name for each in formats]:
        format_ = "rgb48be" if codec == "png" and frame.format.components[0].bits > 8 else "rgb24"
        format_ = "yuvj444p" if codec == "mjpeg" else format_
    if codec == "mjpeg":
        context.options = {"strict": "unofficial"}
        context.qscale, context.global_quality = True, 2 * 118
        context.color_range = frame.color_range
    picture = frame if format_ == frame.format.name else frame.reformat(format=format_)
    picture.pict_type = 0
    context.width, context.height, context.pix_fmt = frame.width, frame.height, format_
    context.time_base = frame.time_base
    try:
        data = b"".join(bytes(packet) for packet in [*context.encode(picture), *context.encode(None)])
        path.write_bytes(data)
    except (av().error.FFmpegError, OSError) as error:
        raise UnshutterError(f"cannot write {path.name}: {error.strerror}") from None
