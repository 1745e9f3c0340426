"""Readout times that cameras write into their clips: GoPro's, Apple's, CAMM's."""

import shutil
import struct
import subprocess

import pytest

from support import clips
from support.gpmf import entry, with_samples, with_settings
from unshutter.video.file.camera_tags import CameraTags
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.file.mp4 import Movie


def readout_tag(path):
    with open(path, "rb") as stream:
        return CameraTags.of(Movie.read(stream)).readout_time


def with_srot(ms, kind=b"f", pack=">f"):
    value = entry(b"SROT", kind, struct.pack(pack, ms), struct.calcsize(pack))
    stream = entry(b"STRM", b"\0", entry(b"STNM", b"c", b"Exposure") + value)
    return entry(b"DEVC", b"\0", entry(b"DVNM", b"c", b"Camera") + entry(b"STRM", b"\0", b"") + stream)


def test_gopros_is_in_its_telemetry(tmp_path):
    tag = readout_tag(with_samples(tmp_path / "a.mp4", b"gpmd", with_srot(20.6)))
    assert tag.camera == "GoPro" and tag.ms == pytest.approx(20.6, abs=1e-5)
    tag = readout_tag(with_samples(tmp_path / "b.mp4", b"gpmd", with_srot(11, b"S", ">H")))
    assert tag.ms == pytest.approx(11)


def test_newer_gopros_state_it_for_the_whole_file(tmp_path):
    path = clips.write(tmp_path / "a.mp4", clips.standing(3))
    with_settings(path, entry(b"MINF", b"c", b"HERO12 Black") + entry(b"SROT", b"f", struct.pack(">f", 15.25), 4))
    assert (readout_tag(path).ms, readout_tag(path).camera) == (pytest.approx(15.25), "GoPro")
    with_settings(path := clips.write(tmp_path / "b.mp4", clips.standing(3)), entry(b"SROT", b"f", b"\x7f\xc0\0\0", 4))
    assert readout_tag(path) is None  # not a number


def test_camms_is_the_skew_of_its_rows(tmp_path):
    gyro = struct.pack("<HH3f", 0, 2, 0.1, 0.2, 0.3)
    exposure = struct.pack("<HH2i", 0, 1, 8_000_000, 27_500_000)
    tag = readout_tag(with_samples(tmp_path / "a.mp4", b"camm", gyro + exposure + gyro))
    assert (tag.ms, tag.camera) == (27.5, "CAMM")


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (b"gpmd", with_srot(-3.0)),
        (b"gpmd", with_srot(float("nan"))),
        (b"gpmd", with_srot(5000.0)),
        (b"gpmd", with_srot(20.6)[:30]),
        (b"camm", struct.pack("<HH2i", 0, 1, 8_000_000, 0)),
        (b"camm", struct.pack("<HH2i", 0, 1, 8_000_000, 27_500_000)[:6]),
        (b"camm", struct.pack("<HH", 0, 99)),
        (b"tmcd", with_srot(20.6)),
    ],
)
def test_what_cannot_be_a_readout_time_is_none(tmp_path, kind, data):
    assert readout_tag(with_samples(tmp_path / "a.mp4", kind, data)) is None


def test_a_file_of_another_kind_has_none(tmp_path):
    assert read_clip_facts(clips.write(tmp_path / "a.mkv", clips.standing())).camera == CameraTags()


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="exiftool writes Apple's key")
def test_a_clip_is_rectified_with_the_time_that_its_file_says(tmp_path, straighten):
    clip = clips.write(tmp_path / "in.mov", clips.standing())
    assert readout_tag(str(clip)) is None
    subprocess.run(["exiftool", "-q", "-overwrite_original", "-Keys:FrameReadoutTime#=0.0123", clip], check=True)
    tag = readout_tag(str(clip))
    assert tag.camera == "Apple" and tag.ms == pytest.approx(12.3)
    _, record, printed = straighten(clip)
    assert record["readout_ms"] == 12.3 and record["found_by"] == "the clip's file"
    assert "this clip does not show its readout time" not in printed


def test_sonys_is_in_the_metadata_of_each_frame(tmp_path):
    """A head of 28 bytes, then the name of a set and its tags: number, length, content; some tags hold others."""
    name = b"\x06\x0e\x2b\x34\x02\x53\x01\x01" + bytes(8)
    inner = struct.pack(">HHH", 0x8000, 2, 7) + struct.pack(">HHi", 0xE40E, 4, 13_250)
    packet = struct.pack(">H", 0x1C) + bytes(26) + name + struct.pack(">HH", 0x8300, len(inner)) + inner
    tag = readout_tag(with_samples(tmp_path / "a.mp4", b"rtmd", packet))
    assert (tag.ms, tag.camera) == (13.25, "Sony")
    assert readout_tag(with_samples(tmp_path / "b.mp4", b"rtmd", packet[:-3])) is None
    assert readout_tag(with_samples(tmp_path / "c.mp4", b"rtmd", b"\0\0" + packet[2:])) is None


@pytest.mark.parametrize("length", [b"\x0e", b"\x81\x0e", b"\x83\0\0\x0e"])
def test_canons_is_in_the_metadata_of_each_frame(tmp_path, length):
    """Parts (number, length): a timecode, then sets of tags, each with a name and a length of one byte or more."""
    name = b"\x06\x0e\x2b\x34\x02\x53\x01\x01" + bytes(8)
    tags = struct.pack(">HHH", 0xE204, 2, 3000) + struct.pack(">HHI", 0xE209, 4, 15_500_000)
    part = name + b"\0" + name + length + tags
    packet = struct.pack("<II", 1, 12) + bytes(12) + struct.pack("<II", 2, len(part)) + part
    tag = readout_tag(with_samples(tmp_path / "a.mp4", b"cndm", packet))
    assert (tag.ms, tag.camera) == (15.5, "Canon")
    assert readout_tag(with_samples(tmp_path / "b.mp4", b"cndm", packet[:-3])) is None
    assert readout_tag(with_samples(tmp_path / "c.mp4", b"cndm", b"\3" + packet[1:])) is None


def test_insta360s_is_behind_the_last_box(tmp_path):
    """Records, each with its format, kind and length behind it; then the length of all and a mark."""
    held = message(1, b"serial") + bytes([25 << 3 & 0x7F | 0x81, 25 << 3 >> 7]) + struct.pack("<d", 18.25)
    records = held + struct.pack("<BBI", 1, 1, len(held)) + b"samples" + struct.pack("<BBI", 0, 3, 7)
    film = clips.write(tmp_path / "in.mp4", clips.standing(5)).read_bytes()

    def tag_of(records, size):
        end = bytes(32) + struct.pack("<II", size + 72, 3) + b"8db42d694ccc418790edff439fe026bf"
        (tmp_path / "a.mp4").write_bytes(film + records + end)
        return readout_tag(str(tmp_path / "a.mp4"))

    tag = tag_of(records, len(records))
    assert (tag.ms, tag.camera) == (18.25, "Insta360")
    for damaged, size in ((records[:-3], len(records) - 3), (records, 3), (records[14:], len(records)), (b"", 0)):
        assert tag_of(damaged, size) is None


def message(number, content):
    """A field of Protocol Buffers: a number, four bytes of a float, or a message."""
    if isinstance(content, float):
        return bytes([number << 3 | 5]) + struct.pack("<f", content)
    if isinstance(content, bytes):
        return bytes([number << 3 | 2, len(content)]) + content
    value = bytes([number << 3])
    while content > 0x7F:
        value, content = value + bytes([content & 0x7F | 0x80]), content >> 7
    return value + bytes([content])


def test_djis_is_that_of_the_sensor_at_its_own_rate(tmp_path):
    """Its metadata state the rates of the sensor and of the video."""
    readout = message(1, message(1, b"\x08\x01") + message(4, message(1, 8_000_000)) + message(11, message(1, 60.0)))
    video = message(2, message(3, message(1, 3840) + message(3, 30.0)))
    tag = readout_tag(with_samples(tmp_path / "a.mp4", b"djmd", readout + video))
    assert (tag.ms, tag.camera) == (16.0, "DJI")
    alone = readout_tag(with_samples(tmp_path / "b.mp4", b"djmd", message(1, message(4, message(1, 8_000_000)))))
    assert alone.ms == 8.0
    for damaged in (readout[:9], b"\xff" * 12, b"\x0f\x00", b""):
        assert readout_tag(with_samples(tmp_path / "c.mp4", b"djmd", damaged)) is None
