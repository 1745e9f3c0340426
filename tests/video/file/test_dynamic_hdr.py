"""HDR metadata of frames and of clips: HDR10+, Dolby Vision, mastering displays and light levels."""

import struct
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from support import clips
from support.movie_boxes import box, with_entry_boxes
from unshutter.cli import main
from unshutter.frames.pyav import side_data
from unshutter.video.file import dynamic_hdr, matroska, mp4_writer
from unshutter.video.file.pixels import in_srgb

FRAMES = 16
QUIET = "log-level=error:bframes=2"
LIGHT = "chromaloc=2:hdr10=1:max-cll=1000,400:"
LIGHT += "master-display=G(8500,39850)B(6550,2300)R(35400,14600)WP(15635,16450)L(10000000,1)"
PQ, HLG = (1, 9, 16, 9), (1, 9, 18, 9)


def bits(*values: tuple[int, int]) -> bytes:
    """Numbers with lengths in bits, one after another, filled up to bytes."""
    text = "".join(f"{value:0{length}b}" for value, length in values)
    text += "0" * (-len(text) % 8)
    return bytes(int(text[at : at + 8], 2) for at in range(0, len(text), 8))


def hdr10_plus(number: int) -> bytes:
    """A T.35 message of HDR10+ with one window, which differs from frame to frame."""
    window = [(1000 + number, 17), (2000, 17), (3000, 17), (500 + number, 17), (0, 4), (0, 10)]
    return bytes.fromhex("b5003c00010401") + bits((1, 2), (400, 27), (0, 1), *window, (0, 1), (0, 1), (0, 1))


def escaped(data: bytes) -> bytes:
    out = bytearray()
    for byte in data:
        if byte <= 3 and out[-2:] == b"\0\0":
            out.append(3)
        out.append(byte)
    return bytes(out)


def sei(number: int) -> bytes:
    message = hdr10_plus(number)
    return b"\x4e\x01" + escaped(bytes([4, len(message)]) + message + b"\x80")


def rpu(number: int) -> bytes:
    """A unit in the place of Dolby Vision's, whose content nothing here decodes."""
    return b"\x7c\x01\x19" + bytes([8, 9, 100 + number]) * 8 + b"\x80"


def with_packets(path: Path, change: Callable[[int, bytes], bytes]) -> Path:
    """The same clip with each packet changed, by the number of its frame."""
    out = path.with_name(f"changed{path.suffix}")
    with av.open(str(path)) as clip, av.open(str(out), "w") as file:
        video = clip.streams.video[0]
        stream = file.add_stream_from_template(video, opaque=True)
        packets = [packet for packet in clip.demux(video) if packet.size]
        numbers = {pts: number for number, pts in enumerate(sorted(packet.pts for packet in packets))}
        for packet in packets:
            new = av.Packet(change(numbers[packet.pts], bytes(packet)))
            new.pts, new.dts, new.time_base = packet.pts, packet.dts, packet.time_base
            new.is_keyframe, new.stream = packet.is_keyframe, stream
            file.mux(new)
    return out


def with_units(path: Path, make: Callable[[int], bytes], behind: bool = False) -> Path:
    """An HEVC clip in MP4 with a unit before or behind the pixels of each frame."""

    def change(number: int, data: bytes) -> bytes:
        unit = struct.pack(">I", len(make(number))) + make(number)
        return data + unit if behind else unit + data

    return with_packets(path, change)


def units_of(path: Path, kind: int) -> list[bytes]:
    """The units of a kind in each frame of an HEVC clip in MP4, by time."""
    found = []
    with av.open(str(path)) as clip:
        for packet in clip.demux(video=0):
            found += [(packet.pts, unit) for unit in dynamic_hdr._units(bytes(packet), 4) if unit[0] >> 1 == kind]
    return [unit for _, unit in sorted(found)]


def of_frames(path: Path, name: str) -> list[bytes | None]:
    with av.open(str(path)) as clip:
        return [side_data(frame).get(name) for frame in clip.decode(video=0)]


def hevc(path: Path, colours: tuple[int, ...] = PQ, pixel_format: str = "yuv420p10le") -> Path:
    options = {"x265-params": f"{QUIET}:{LIGHT}", "crf": "12", "preset": "veryfast"}
    return clips.write(
        path, clips.moving(FRAMES)[1], "libx265", pixel_format, options=options, colours=colours, tag="hvc1"
    )


def dnxhr(path: Path) -> Path:
    plain = path.with_name("plain.mov")
    frames = [cv2.resize(each, (256, 192)) for each in clips.moving(FRAMES)[1]]
    clips.write(plain, frames, "dnxhd", "yuv422p10le", options={"profile": "dnxhr_hqx"}, colours=PQ)
    points = struct.pack(">8H2I", 8500, 39850, 6550, 2300, 35400, 14600, 15635, 16450, 10_000_000, 1)
    light = [(b"mdcv", points), (b"clli", struct.pack(">2H", 1000, 400))]
    with plain.open("rb") as video, path.open("wb") as out:
        mp4_writer.write_completed(video, [], light, out)
    return path


def straightened(path: Path, out: Path, capsys: pytest.CaptureFixture[str], *flags: str) -> str:
    assert main(["video", str(path), "-o", str(out), *clips.KNOWN, *flags]) == 0
    told = capsys.readouterr().err
    assert f"{FRAMES} of {FRAMES} frames straightened" in told
    return told


def test_hdr10_plus_stays_with_its_frames(tmp_path: Path, capsys) -> None:
    source = with_units(hevc(tmp_path / "in.mp4"), sei)
    before = of_frames(source, "DYNAMIC_HDR_PLUS")
    assert None not in before and len(set(before)) == FRAMES
    told = straightened(source, tmp_path / "out.mp4", capsys)
    assert "HDR10+" not in told
    assert of_frames(tmp_path / "out.mp4", "DYNAMIC_HDR_PLUS") == before
    part = tmp_path / "part.mkv"
    assert main(["video", str(source), "-o", str(part), *clips.KNOWN, "--start", "0.2"]) == 0
    assert of_frames(part, "DYNAMIC_HDR_PLUS") == before[6:]
    assert "HDR10+" in straightened(source, tmp_path / "cut.mp4", capsys, "--edges", "crop")
    for flags in ((), ("--edges", "crop")):
        assert main(["video", str(source), "-o", str(tmp_path / "x.mp4"), *clips.KNOWN, "--dry-run", *flags]) == 0
        assert ("left out: HDR10+" in capsys.readouterr().out) == bool(flags)


def test_dolby_vision_of_a_picture_that_shows_itself_stays(tmp_path: Path, capsys) -> None:
    """Profile 8.4: without it, the frames are HLG."""
    bare = with_units(hevc(tmp_path / "in.mp4", HLG), rpu, behind=True)
    config = box(b"dvvC", bytes([1, 0, 8 << 1, 0x2D, 4 << 4]) + bytes(19))
    source = tmp_path / "dolby.mp4"
    source.write_bytes(with_entry_boxes(bare.read_bytes(), config))
    out, cut = tmp_path / "out.mp4", tmp_path / "cut.mp4"
    assert "Dolby Vision" not in straightened(source, out, capsys)
    assert config in out.read_bytes() and units_of(out, 62) == [rpu(k) for k in range(FRAMES)]
    assert "Dolby Vision (it describes the old frames)" in straightened(source, cut, capsys, "--edges", "crop")
    assert b"dvvC" not in cut.read_bytes() and units_of(cut, 62) == []
    other = tmp_path / "out.mkv"  # written by FFmpeg
    assert "not kept: configuration of Dolby Vision" in straightened(source, other, capsys)
    for path in (out, cut, other):
        with av.open(str(path)) as clip:
            context = clip.streams.video[0].codec_context
            assert (context.color_primaries, context.color_trc, context.colorspace) == HLG[1:]


def test_dolby_vision_without_a_picture_that_shows_itself_is_refused(tmp_path: Path, capsys) -> None:
    source = tmp_path / "dolby.mp4"
    config = box(b"dvcC", bytes([1, 0, 5 << 1, 0x2D, 0]) + bytes(19))
    source.write_bytes(with_entry_boxes(hevc(tmp_path / "in.mp4").read_bytes(), config))
    assert main(["video", str(source), "-o", str(tmp_path / "out.mp4"), *clips.KNOWN]) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "profile 5, whose colours are wrong" in told
    assert not (tmp_path / "out.mp4").exists()


@pytest.mark.parametrize(("profile", "whole_range", "residual", "found"), [(0, 1, 0, 5), (1, 0, 0, 8), (1, 0, 1, 7)])
def test_the_profile_of_files_without_a_box_is_that_of_the_first_frame(profile, whole_range, residual, found) -> None:
    header = bytearray(20)
    header[4], header[10], header[15], header[16] = profile, whole_range, residual, 1 - residual
    told = dynamic_hdr.DolbyVision.of({"DOVI_METADATA": struct.pack("=Q", 56) + bytes(48) + bytes(header)}, [])
    assert told is not None and told.profile == found and told.shows_itself == (found != 5)
    assert dynamic_hdr.DolbyVision.of({}, [(b"hvcC", b"")]) is None


def test_hdr10_plus_of_av1_stays_with_its_frames(tmp_path: Path, capsys) -> None:
    made = clips.write(
        tmp_path / "in.mkv", clips.moving(FRAMES)[1], "libsvtav1", "yuv420p10le", options={"preset": "12", "crf": "12"}
    )

    def change(number: int, data: bytes) -> bytes:
        content = b"\4" + hdr10_plus(number) + b"\x80"
        obu = bytes([5 << 3 | 2, len(content)]) + content
        at = next(start for kind, start, _, _ in dynamic_hdr._obus(data) if kind not in (1, 2))
        return data[:at] + obu + data[at:]

    source = with_packets(made, change)
    before = of_frames(source, "DYNAMIC_HDR_PLUS")
    assert before.count(None) == 0
    straightened(source, tmp_path / "out.mkv", capsys, "--preset", "12", "--crf", "12")
    assert of_frames(tmp_path / "out.mkv", "DYNAMIC_HDR_PLUS") == before


@pytest.mark.parametrize(
    ("source", "result", "flags"),
    [
        (".mp4", ".mkv", ("--codec", "libx264")),
        (".mp4", ".mp4", ("--codec", "libsvtav1", "--preset", "12")),
        (".mov", ".mov", ("--codec", "prores_ks")),
        (".mp4", ".mov", ("--codec", "prores_ks")),  # written by FFmpeg
        (".mp4", ".mp4", ("--codec", "ffv1")),
        (".mkv", ".mkv", ("--codec", "ffv1")),
        pytest.param(".mp4", ".mkv", ("--codec", "prores_ks"), marks=pytest.mark.thorough),
        (".mov", ".mov", ()),  # DNxHR
    ],
)
def test_mastering_display_and_light_levels_stay_in_every_codec(tmp_path: Path, capsys, source, result, flags) -> None:
    pixel_format = "yuv422p10le" if "prores_ks" in flags or not flags else "yuv420p10le"
    source = hevc(tmp_path / f"in{source}", pixel_format=pixel_format) if flags else dnxhr(tmp_path / f"in{source}")
    out = tmp_path / f"out{result}"
    told = straightened(source, out, capsys, *flags)
    assert "not kept" not in told
    before, after = clips.beside(source), clips.beside(out)
    assert after["CONTENT_LIGHT_LEVEL"] == before["CONTENT_LIGHT_LEVEL"] == clips.LIGHT
    one, other = (np.frombuffer(each["MASTERING_DISPLAY_METADATA"][:80], "i4") for each in (before, after))
    np.testing.assert_allclose(other[::2] / other[1::2], one[::2] / one[1::2], rtol=1e-3, atol=4e-5)
    if ".mkv" in result and "prores_ks" not in flags:  # the others do not state it, or PyAV does not say
        assert chroma_location(source) == chroma_location(out) == "topleft"


def chroma_location(path: Path) -> str:
    with av.open(str(path)) as clip:
        return matroska.chroma_location(clip.streams.video[0])


def test_units_never_look_like_start_codes() -> None:
    random = np.random.default_rng(3)
    for _ in range(200):
        data = random.choice([0, 0, 0, 1, 2, 3, 4, 255], 40).astype(np.uint8).tobytes() + b"\x80"
        assert dynamic_hdr._escaped(data) == escaped(data)
        content = b"\xb5\x00\x3c\x00\x01\x04" + data
        unit = b"\x4e\x01" + escaped(dynamic_hdr._message(content) + b"\x80")
        assert list(dynamic_hdr._messages(unit)) == [content]
        for size in (0, 2, 4):  # bytes that are no packet raise nothing
            list(dynamic_hdr.DynamicHdr(False, size, True)._of_hevc(b"\0\0\0\7\x4e\1" + data))
        list(dynamic_hdr.DynamicHdr(True, 0, True)._of_av1(b"\x2a" + data))


@pytest.mark.parametrize(("transfer", "white"), [(16, 0.58), (18, 0.75)])
def test_previews_show_hdr_as_sdr(transfer: int, white: float) -> None:
    """White of 203 cd/m2 is bright, not grey; SDR is shown as it is."""
    frame = av.VideoFrame(64, 48, "yuv420p10le")
    for plane, value in zip(frame.planes, (64 + round(876 * white), 512, 512), strict=True):
        plane.update(np.full(plane.buffer_size // 2, value, "<u2").tobytes())
    frame.color_range, frame.color_primaries, frame.colorspace = 1, 9, 9
    shown = {}
    for each in (transfer, 14):
        frame.color_trc = each
        shown[each] = in_srgb(frame, 32, 24)
    assert shown[transfer].shape == (24, 32, 3) and shown[transfer].dtype == np.uint8
    assert np.abs(shown[transfer].astype(int) - 233).max() <= 4
    assert np.abs(shown[14].astype(int) - 255 * white).max() <= 3
