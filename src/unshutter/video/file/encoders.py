"""Chooses the encoding of frames: that of the clip, unless the user chooses another."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, cast

from unshutter.errors import UnshutterError, UsageError, shortened
from unshutter.frames.pyav import VIDEO_FORMATS, av
from unshutter.options.clip_options import Encode
from unshutter.reasons import JsonObject
from unshutter.video.file import matroska
from unshutter.video.file.clip_facts import ClipFacts, Coding
from unshutter.video.file.pixels import LIMITED_RANGE

if TYPE_CHECKING:
    from av.container import OutputContainer
    from av.video.stream import VideoStream


@dataclass(frozen=True)
class Codec:
    """The settings of an encoder of FFmpeg."""

    decoders: tuple[str, ...] = ()  # FFmpeg's names of the codec that it writes; those of usual encoders are known
    # at which unmoved frames keep .97 of their sharpness and 45 dB (docs/research/clips.md), and for smaller files
    crf: tuple[int, int] | None = None
    presets: tuple[str, ...] = ()  # from fast to slow
    qscale: int | None = None  # quality without CRF that looks like the clip
    by_rate: bool = False  # whether it can take the bit rate of a clip of the same codec
    profiles: dict[str, str] = field(default_factory=dict)  # FFmpeg's name of a profile -> the encoder's
    has_times: bool = True  # frames have times of their own; otherwise they are only numbered, at a constant rate
    has_coarse_times: bool = False  # time bases have at most 16 bits


_X26X = (*("ultrafast", "superfast", "veryfast", "faster", "fast"), *("medium", "slow", "slower", "veryslow"))
_PRORES = {"Proxy": "0", "LT": "1", "Standard": "2", "HQ": "3", "4444": "4", "4444 XQ": "5", "XQ": "5"}
_DNXHR = {f"DNXHR {each}": f"dnxhr_{each.lower()}" for each in ("LB", "SQ", "HQ", "HQX", "444")}
_CODECS = {
    "libx264": Codec(("h264",), (12, 20), _X26X, by_rate=True),
    "libx265": Codec(("hevc",), (12, 20), _X26X, by_rate=True),
    "libsvtav1": Codec(("av1", "libdav1d"), (8, 20), tuple(str(k) for k in range(14)), by_rate=True),
    "libvpx-vp9": Codec(("vp9", "libvpx-vp9"), (10, 24), by_rate=True),
    "prores_ks": Codec(("prores",), profiles=_PRORES),
    "dnxhd": Codec(profiles=_DNXHR),
    "mjpeg": Codec(qscale=2),
    "mpeg4": Codec(qscale=2, by_rate=True, has_coarse_times=True),
    "mpeg2video": Codec(qscale=2, by_rate=True, has_times=False),
    "h263": Codec(qscale=2, by_rate=True, has_coarse_times=True),
    "mpeg1video": Codec(has_times=False),
    **dict.fromkeys(("msmpeg4", "msmpeg4v2", "wmv1", "wmv2", "h263p", "flv"), Codec(has_coarse_times=True)),
}
_ENCODERS = {decoder: name for name, codec in _CODECS.items() for decoder in codec.decoders}
REDUCED = {"yuv444p12le": "yuv444p10le", "yuva444p12le": "yuva444p10le"}  # decoded ProRes 4444 -> what is encoded
# codec tags of Dolby Vision, whose metadata the new frames lack -> those of the frames without it
_BASE_LAYERS = {"dvh1": "hvc1", "dvhe": "hev1", "dva1": "avc1", "dvav": "avc3", "dav1": "av01"}
_STATE_LIGHT = ("libx264", "libx265", "libsvtav1")  # encoders that take mastering displays and light levels
_NAMES, _POINTS = ("G", "B", "R", "WP"), (2, 3, 4, 5, 0, 1, 6, 7)  # of a mastering display, as they take and store it
_MOST_TICKS = 65_535  # per second, of coarse times
_LARGE = 10_000_000  # bytes per frame: libx264's lookahead holds nearly twice that for each frame


def _codec(name: str) -> Codec:
    return _CODECS.get(name, Codec())


@dataclass(frozen=True)
class Encoder:
    """An encoder and its settings."""

    name: str  # FFmpeg's name of the encoder
    pixel_format: str  # format of the frames to encode
    options: dict[str, str] = field(default_factory=dict)  # options of the encoder
    qscale: int | None = None  # quality for encoders without CRF; None if CRF or a bit rate is set
    bits_per_s: int | None = None  # target bit rate; None if the quality determines it
    tagged: bool = True  # whether the video gets the codec tag of a clip of the same codec
    narrows: bool = False  # whether it is to write limited range, since it cannot state the clip's full range

    @classmethod
    def choose(cls, clip: ClipFacts, encode: Encode) -> Encoder:
        """Chooses the encoder for a clip."""
        name = encode.codec or clip.coding.name
        name = _ENCODERS.get(name, name)
        format_ = _checked(name, clip)
        options = _speed(name, encode.preset)
        codec = _codec(name)
        rate = 0 if encode.bitrate is None else _own_rate(name, clip)
        if codec.qscale is not None and not rate:
            return cls(name, format_, options, round(encode.crf) if encode.crf is not None else codec.qscale)
        if codec.crf is not None and not rate:
            options["crf"] = f"{encode.crf if encode.crf is not None else codec.crf[0]:g}"
        elif encode.crf is not None and codec.crf is None:
            raise UsageError(f"{name} does not support {{--crf}}: leave it out")
        if name == "libx264" and clip.frame_bytes > _LARGE:
            options["rc-lookahead"] = "4"
        if name == "libvpx-vp9":
            options |= {"row-mt": "1"} if rate else {"b": "0", "row-mt": "1"}
        if name == "libx265":
            options["x265-params"] = ":".join(["log-level=error", *_hdr(clip, _x265_display, "max-cll={},{}")])
        if name == "libsvtav1" and (hdr := _hdr(clip, _svt_display, "content-light={},{}")):
            options["svtav1-params"] = ":".join(hdr)
        if name == "libx264" and (hdr := _hdr(clip, _x264_display, "cll={},{}")):
            options["x264-params"] = ":".join(hdr)
        return cls(name, format_, options, bits_per_s=rate or None)

    def add_to(self, container: OutputContainer, clip: ClipFacts, size: tuple[int, int]) -> VideoStream:
        """Adds a stream with this encoder to a container, for frames of a clip's kind and of a size (height, width)."""
        coding = clip.coding
        rate = coding.rate
        options = self.options | ({"chroma_sample_location": coding.chroma} if coding.chroma else {})
        try:
            stream = cast("VideoStream", container.add_stream(self.name, rate=rate, options=options))
        except ValueError:
            raise UnshutterError(f"'{container.format.name}' files cannot contain {self.name}") from None
        context = stream.codec_context
        stream.height, stream.width, stream.pix_fmt = *size, self.pixel_format
        context.time_base = _time_base(self.name, coding.time_base or 1 / rate, rate)
        if self.name == "libx264" and "420" not in self.pixel_format:
            context.thread_count = 1  # with more, x264 does not always write the same bytes
        for name, code in coding.colours.items():
            setattr(context, name, code)
        if self.narrows:
            context.color_range = LIMITED_RANGE
        if coding.pixel_aspect:
            context.sample_aspect_ratio = coding.pixel_aspect
        if self.qscale is not None:
            context.qscale = True
            context.global_quality = self.qscale * 118  # FFmpeg's units per quality step
        if self.bits_per_s is not None:
            context.bit_rate = self.bits_per_s
        if self.name == "mjpeg":
            stream.options["strict"] = "unofficial"
        if _ENCODERS.get(coding.name, coding.name) == self.name:
            _follow(stream, coding, self.tagged)
        return stream


def _own_rate(name: str, clip: ClipFacts) -> int:
    """Returns the bits per second of the clip's frames; raises UsageError if they are unknown or not to be had."""
    if not _codec(name).by_rate:
        raise UsageError(f"{name} does not support {{--bitrate}}: leave it out")
    if not clip.coding.bits_per_s:
        raise UsageError("{clip} does not state its bits per second: leave out {--bitrate}", clip=clip.path)
    return round(clip.coding.bits_per_s)


def _checked(name: str, clip: ClipFacts) -> str:
    """Returns the pixel format for an encoder; raises if the encoder is missing or does not support the frames."""
    try:
        codec = av().Codec(name, "w")
    except ValueError:
        raise UnshutterError(
            f"this FFmpeg has no encoder '{shortened(name)}': {_other_encoder(clip.pixels.name)}"
        ) from None
    if codec.type != "video":
        raise UsageError(f"'{name}' is not a video encoder: choose libx264, libx265, libsvtav1 or prores_ks")
    takes = [each.name for each in codec.video_formats or []]
    if not takes or clip.pixels.name in takes:
        return clip.pixels.name
    if name == "prores_ks" and REDUCED.get(clip.pixels.name) in takes:
        return REDUCED[clip.pixels.name]
    raise UnshutterError(
        f"{name} cannot write frames of the format {clip.pixels.name}: {_other_encoder(clip.pixels.name)}"
    )


def writable(clip: ClipFacts) -> JsonObject:
    """Describes, as JSON, the encoder for a clip's own codec, and the usual ones that this FFmpeg has for its frames.

    Each has its presets and two CRF values, for results that look like the clip and for files about half as large.
    """
    own = _ENCODERS.get(clip.coding.name, clip.coding.name)
    usual = [name for name in dict.fromkeys([*_ENCODERS.values(), "ffv1"]) if _takes(name, clip)]
    described = {
        name: {
            "presets": list(_codec(name).presets),
            "crf": list(_codec(name).crf or ()),
        }
        for name in (own, *usual)
    }
    by_rate = _codec(own).by_rate and clip.coding.bits_per_s > 0
    return {"own": own, "keeps_rate": by_rate, "usual": usual, "described": described}


def _takes(name: str, clip: ClipFacts) -> bool:
    """Returns whether this FFmpeg has an encoder, for the clip's frames and its file's format."""
    try:
        _checked(name, clip)
    except UnshutterError:
        return False
    kind = VIDEO_FORMATS.get(Path(clip.path).suffix.lower())
    if kind is None:
        return True
    with av().open(BytesIO(), "w", format=kind) as container:
        return av().Codec(name, "w").canonical_name in container.supported_codecs


def others_for(pixel_format: str) -> Iterator[str]:
    """Yields the names of usual encoders that take frames of a format."""
    for name in ("libx264", "libx265", "prores_ks", "ffv1", "libx264rgb", "libvpx-vp9"):
        if pixel_format in [each.name for each in av().Codec(name, "w").video_formats or []]:
            yield name


def _other_encoder(pixel_format: str) -> str:
    """Returns the advice to choose another encoder, and names one that takes such frames."""
    such_as = next((f", such as {name}" for name in others_for(pixel_format)), "")
    return f"choose another encoder with {{--codec}}{such_as}"


def _speed(name: str, preset: str | None) -> dict[str, str]:
    if preset is None:
        return {}
    presets = _codec(name).presets
    if not presets:
        raise UsageError(f"{name} has no presets: leave out {{--preset}}")
    if preset not in presets:
        raise UsageError(f"{name} has no preset '{shortened(preset)}': choose one of {', '.join(presets)}")
    return {"preset": preset}


def _time_base(name: str, video_base: Fraction, rate: Fraction) -> Fraction:
    """Returns the time base for an encoder: the video's own if the encoder supports it."""
    if not _codec(name).has_times:
        return 1 / rate
    if _codec(name).has_coarse_times and video_base.denominator > _MOST_TICKS:
        rate = rate.limit_denominator(1001)
        return Fraction(1, rate.numerator * max(_MOST_TICKS // rate.numerator, 1))
    return video_base


def _follow(stream: VideoStream, coding: Coding, tagged: bool) -> None:
    """Copies the settings that only an encoder of the same kind can adopt."""
    context = stream.codec_context
    tag = _BASE_LAYERS.get(coding.tag, coding.tag)
    if tagged and tag.strip("\0").isprintable() and len(tag.strip("\0")) == 4:
        context.codec_tag = tag
    profile = _codec(context.name).profiles.get(coding.profile or "")
    if profile is not None:
        stream.options["profile"] = profile


# ---- mastering display ---------------------------------------------------------------------------------


def _light(clip: ClipFacts) -> tuple[list[float], tuple[int, int] | None]:
    """Returns a clip's mastering display and light levels [cd/m²]; empty and None if it states none.

    The display is x and y of red, green, blue and white, then the least and the greatest luminance [cd/m²].
    """
    display: list[float] = []
    if len(raw := clip.side_data.get("MASTERING_DISPLAY_METADATA", b"")) >= 88 and all(
        struct.unpack("=2i", raw[80:88])
    ):
        numbers = struct.unpack("=20i", raw[:80])
        display = [n / d if d else 0.0 for n, d in zip(numbers[::2], numbers[1::2], strict=True)]
    raw = clip.side_data.get("CONTENT_LIGHT_LEVEL", b"")
    return display, struct.unpack("=2I", raw[:8]) if len(raw) >= 8 else None


def _hdr(clip: ClipFacts, display: Callable[[list[float]], str], light: str) -> list[str]:
    """Returns a clip's mastering display and light levels as encoder settings."""
    mastering, levels = _light(clip)
    return [*([display(mastering)] if mastering else []), *([light.format(*levels)] if levels else [])]


def light_boxes(clip: ClipFacts, encoder: str) -> list[tuple[bytes, bytes]]:
    """Returns the same as boxes of a sample entry; none if the encoder writes them into its data."""
    if encoder in _STATE_LIGHT:
        return []
    mastering, levels = _light(clip)
    boxes = []
    if mastering:
        points = (round(50_000 * mastering[k]) for k in _POINTS)
        boxes.append((b"mdcv", struct.pack(">8H2I", *points, *(round(1e4 * mastering[k]) for k in (9, 8)))))
    return [*boxes, (b"clli", struct.pack(">2H", *(min(each, 0xFFFF) for each in levels)))] if levels else boxes


def light_elements(clip: ClipFacts, encoder: str) -> bytes:
    """Returns the same as elements of Matroska."""
    return b"" if encoder in _STATE_LIGHT else matroska.light_elements(*_light(clip))


def _x26x_display(v: list[float]) -> str:
    numbers = [round(50_000 * v[k]) for k in _POINTS]
    points = "".join(f"{n}({x},{y})" for n, x, y in zip(_NAMES, numbers[::2], numbers[1::2], strict=True))
    return f"{points}L({round(1e4 * v[9])},{round(1e4 * v[8])})"


def _x264_display(v: list[float]) -> str:
    return f"mastering-display={_x26x_display(v)}"


def _x265_display(v: list[float]) -> str:
    return f"hdr10=1:repeat-headers=1:master-display={_x26x_display(v)}"


def _svt_display(v: list[float]) -> str:
    points = "".join(f"{n}({v[k]:.5f},{v[k + 1]:.5f})" for n, k in zip(_NAMES, _POINTS[::2], strict=True))
    return f"mastering-display={points}L({v[9]:.4f},{v[8]:.4f})"
