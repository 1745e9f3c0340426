"""Clips that tests make: a camera held by hand before a drawn wall, and whatever else a file can hold."""

from fractions import Fraction
from functools import cache

import av
import numpy as np

from support.drawn_photos import textured
from support.hand_held import log_of, still
from unshutter.frames.pyav import side_data
from unshutter_lab.synthesis.sequences import RotatingCamera

HEIGHT, WIDTH, FOCAL, RATIO, FPS = 144, 192, 165.0, 0.6, 30
KNOWN = ["--readout-ratio", str(RATIO), "--focal-px", str(FOCAL)]  # of such a clip: half the work is to find these
LIGHT = bytes.fromhex("e8030000 90010000".replace(" ", ""))  # 1000 and 400 cd/m^2


def shaken(seconds=4.0):
    """A hand that shakes a lot: some px from row to row of so small a frame."""
    return log_of(
        lambda t: 70 * np.sin(9 * t + 0.5),
        lambda t: 30 * np.sin(7 * t + 1),
        lambda t: 40 * np.sin(11 * t + 2),
        seconds=seconds,
    )


@cache
def wall():
    """What the camera sees: with more contrast than other tests need, since encoders take some of it."""
    drawn = textured(2 * HEIGHT, 2 * WIDTH, bands=1)[..., 0].astype(np.float64)
    return np.clip(128 + 2.5 * (drawn - drawn.mean()), 0, 255).astype(np.uint8)


def moving(frames=16, log=None, ratio=RATIO):
    """(camera, frames as grey pictures)."""
    if log is None:
        camera, greys = _shaken(frames, ratio)
        return camera, list(greys)
    camera = RotatingCamera(log, 0.05, frames, FPS, ratio, HEIGHT, WIDTH, FOCAL)
    return camera, list(camera.rendered(wall()))


@cache
def _shaken(frames, ratio):
    """Of the usual log, for all tests; they do not change them."""
    camera, greys = moving(frames, shaken(), ratio)
    for grey in greys:
        grey.flags.writeable = False
    return camera, greys


def standing(frames=16):
    return moving(frames, still())[1]


def as_frame(grey, pixel_format):
    """A frame of a format: the picture itself in ``gray``, else in colours that differ from place to place."""
    if pixel_format == "gray":
        return av.VideoFrame.from_ndarray(np.ascontiguousarray(grey), format="gray")
    colours = np.stack([grey, 255 - grey, grey // 2 + 60], axis=-1)
    return av.VideoFrame.from_ndarray(colours, format="rgb24").reformat(format=pixel_format)


def write(path, greys, codec="libx264", pixel_format="yuv420p", times=None, sound=False, **more):
    """Writes a clip.

    ``more``: options (of the encoder), tags, stream_tags, turn (degrees), aspect, colours (four numbers), chapters,
    subtitles, tag (the codec's), container (options), interlaced, data (codec of a
    track), handler, packets (its bytes).
    """
    with av.open(str(path), "w", container_options=more.get("container", {})) as out:
        video = out.add_stream(codec, rate=FPS, options=more.get("options", {}))
        video.width, video.height, video.pix_fmt = greys[0].shape[1], greys[0].shape[0], pixel_format
        base = Fraction(1, 30000) if times is not None else Fraction(1, FPS)
        video.codec_context.time_base = base
        video.metadata.update(more.get("stream_tags", {}))
        out.metadata.update(more.get("tags", {}))
        if "tag" in more:
            video.codec_context.codec_tag = more["tag"]
        if "turn" in more:
            video.set_display_rotation(more["turn"])
        if "aspect" in more:
            video.codec_context.sample_aspect_ratio = more["aspect"]
        _colour(video.codec_context, more)
        if "chapters" in more:
            out.set_chapters(more["chapters"])
        heard = out.add_stream(sound if isinstance(sound, str) else "aac", rate=48000) if sound else None
        words = out.add_mux_stream(more["subtitles"]) if "subtitles" in more else None
        noted = _data_stream(out, **more)
        out.start_encoding()
        if noted is not None:
            _note(out, noted, **more)
        if words is not None:
            _say(out, words, more["subtitles"])
        for k, grey in enumerate(greys):
            frame = as_frame(grey, pixel_format)
            frame.pts, frame.time_base = (k if times is None else round(times[k] * 30000)), base
            _colour(frame, more)
            out.mux(video.encode(frame))
            if heard is not None:
                _ring(out, heard, k)
        out.mux(video.encode(None))
        if heard is not None:
            out.mux(heard.encode(None))
    return path


def _colour(thing, more):
    names = ("color_range", "color_primaries", "color_trc", "colorspace")
    for name, value in zip(names, more.get("colours", ()), strict=False):
        setattr(thing, name, value)


def _ring(out, stream, k):
    """A thirtieth of a second of a tone."""
    samples = np.sin(2 * np.pi * 440 * (np.arange(1600) + 1600 * k) / 48000)
    kind = stream.format.name
    values = samples.astype(np.float32) if kind.startswith("flt") else (samples * 20000).astype(np.int16)
    planes = np.stack([values, values]) if kind.endswith("p") else np.stack([values, values], -1).reshape(1, -1)
    frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(planes), format=kind, layout="stereo")
    frame.sample_rate, frame.pts, frame.time_base = 48000, 1600 * k, Fraction(1, 48000)
    out.mux(stream.encode(frame))


def _data_stream(out, data=None, handler="", **_):
    if data is None:
        return None
    stream = out.add_data_stream(data)
    stream.metadata.update({"handler_name": handler} if handler else {})
    return stream


def _note(out, stream, packets=None, **_):
    """Packets of a second each, or three short ones."""
    step = 100 if packets is None else 1000
    for k, content in enumerate(packets or [bytes([k]) * 20 for k in range(3)]):
        packet = av.Packet(content)
        packet.stream, packet.pts, packet.dts, packet.time_base = stream, step * k, step * k, Fraction(1, 1000)
        out.mux(packet)


def _say(out, stream, text):
    packet = av.Packet(b"\x00\x05hello" if text == "mov_text" else b"hello")
    packet.stream, packet.pts, packet.dts, packet.duration = stream, 0, 0, 300
    packet.time_base = Fraction(1, 1000)
    out.mux(packet)


def luma(path):
    """[N, H, W] luma of a clip's frames as they are stored, in units of 8 bits."""
    pictures = []
    with av.open(str(path)) as clip:
        for frame in clip.decode(video=0):
            plane = frame.planes[0]
            wide = frame.format.components[0].bits
            kind = np.dtype(np.uint8 if wide == 8 else "<u2")
            rows = np.ndarray((frame.height, frame.width), kind, buffer=plane, strides=(plane.line_size, kind.itemsize))
            pictures.append(rows.astype(np.float64) / 2 ** (wide - 8))
    return np.stack(pictures)


def psnr(one, other, border=14):
    """dB, of the pictures' middles."""
    inner = (..., slice(border, -border), slice(border, -border))
    return 10 * np.log10(255**2 / ((one[inner] - other[inner]) ** 2).mean())


def truth(camera):
    """What a global shutter saw at the moment of each frame's middle row, as grey pictures."""
    still_camera = _Instant(
        camera.log, camera.start_s, camera.frames, camera.fps, 0.0, camera.height, camera.width, camera.focal_px
    )
    object.__setattr__(still_camera, "offset", camera.readout_ratio / 2)
    return list(still_camera.rendered(wall()))


class _Instant(RotatingCamera):
    """A camera without readout that takes its frames some time later."""

    offset = 0.0

    def rotations(self, times):
        return super().rotations(np.asarray(times) + self.offset)


def facts(path):
    """What a clip says of itself, stream by stream, for comparison."""
    streams = []
    with av.open(str(path)) as clip:
        for stream in clip.streams:
            told = {"type": stream.type, "tags": dict(stream.metadata), "disposition": int(stream.disposition)}
            context = stream.codec_context
            if context is not None:
                told |= {"codec": context.name, "codec_tag": context.codec_tag}
            if stream.type == "video":
                told |= {"size": (stream.width, stream.height), "aspect": stream.sample_aspect_ratio}
                told |= {"format": context.pix_fmt, "profile": context.profile}
                names = ("color_range", "color_primaries", "color_trc", "colorspace")
                told |= {name: getattr(context, name) for name in names}
            streams.append(told)
        tags, chapters = dict(clip.metadata), clip.chapters()
    return {"streams": streams, "tags": tags, "chapters": [(c["start"], c["end"], c["metadata"]) for c in chapters]}


def times(path):
    """Times of the frames [s]."""
    with av.open(str(path)) as clip:
        return [frame.time for frame in clip.decode(video=0)]


def packets(path):
    """(index, pts [s], bytes) of all that is no video."""
    with av.open(str(path)) as clip:
        video = clip.streams.video[0].index
        return [
            (p.stream_index, None if p.pts is None else float(p.pts * p.time_base), bytes(p))
            for p in clip.demux()
            if p.stream_index != video and p.size
        ]


def beside(path):
    """The first frame's side data."""
    with av.open(str(path)) as clip:
        return side_data(next(clip.decode(video=0)))
