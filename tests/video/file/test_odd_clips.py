"""Clips that are odd, but whole: they are straightened, and keep their times."""

import struct

import numpy as np
import pytest

import unshutter
from support import clips
from support.covering import thorough
from support.hand_held import hand
from support.refusals import left_behind, refused
from unshutter.cli import main
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.file.video_writer import writing

GREYS = clips.moving(16)[1]


def straightened(source, target, *more):
    assert main(["video", str(source), "-o", str(target), *clips.KNOWN, *map(str, more)]) == 0
    return read_clip_facts(target)


def times(path):
    return np.array([frame.time for frame in read_clip_facts(path).frames_between()])


def test_avi_counts_frames_that_are_not_there(tmp_path):
    """A frame that repeats the one before has no data in AVI, and FFmpeg passes over it."""
    path = clips.write(tmp_path / "in.avi", GREYS, "mjpeg", "yuvj420p", sound="mp2")
    data = bytearray(path.read_bytes())
    at = data.index(b"vids") + 32
    assert struct.unpack_from("<I", data, at) == (len(GREYS),)
    struct.pack_into("<I", data, at, len(GREYS) + 1)
    path.write_bytes(data)
    straightened(path, tmp_path / "out.avi")
    assert len(clips.luma(tmp_path / "out.avi")) == len(GREYS)


def test_b_frames_in_avi(tmp_path):
    """AVI says in which order frames are decoded, not when they are shown."""
    path = clips.write(tmp_path / "in.avi", clips.moving(26)[1], "libx264", options={"bf": "3"})
    straightened(path, tmp_path / "out.avi")
    assert np.allclose(np.diff(times(path)), 1 / 30)
    assert np.allclose(times(tmp_path / "out.avi"), times(path), atol=0.01)
    straightened(path, tmp_path / "part.avi", "--start", 0.4)
    assert len(clips.luma(tmp_path / "part.avi")) == 14


@pytest.mark.parametrize(
    ("name", "codec"),
    [("in.mpg", "mpeg2video"), ("in.mpg", "mpeg1video"), ("in.mkv", "mpeg2video"), ("in.ts", "mpeg4")],
)
def test_encoders_with_clocks_of_their_own(tmp_path, name, codec):
    path = clips.write(tmp_path / name, GREYS, codec)
    straightened(path, tmp_path / f"out{path.suffix}")
    assert np.allclose(np.diff(times(tmp_path / f"out{path.suffix}")), 1 / 30, atol=0.001)


def test_a_video_that_begins_before_0(tmp_path):
    shown = [k / 30 - 0.2 for k in range(16)]
    path = clips.write(tmp_path / "in.mkv", GREYS, times=shown, container={"avoid_negative_ts": "disabled"})
    straightened(path, tmp_path / "out.mkv")
    assert len(clips.luma(tmp_path / "out.mkv")) == len(GREYS)
    assert np.allclose(np.diff(times(tmp_path / "out.mkv")), 1 / 30, atol=0.0015)


def sound_from(path):
    """Times of the sound's packets after that of the first frame [s]."""
    with clips.av.open(str(path)) as video:
        packets = [packet for packet in video.demux(video.streams.audio[0]) if packet.size]
        heard = [float((packet.pts or 0) * packet.time_base) for packet in packets]
    return np.array(heard) - times(path)[0]


@pytest.mark.parametrize(
    ("name", "from_s", "ending"),
    [("in.mkv", -0.2, ".mp4"), ("in.ts", 100.0, ".mp4"), ("in.ts", 100.0, ".mkv"), ("in.ts", 100.0, ".ts")],
)
def test_where_a_video_begins(tmp_path, name, from_s, ending):
    """MP4 hides what is before 0, and shows nothing until a clock's 100 s; all sound stays where it was."""
    container = {"avoid_negative_ts": "disabled", "output_ts_offset": str(from_s)}
    path = clips.write(tmp_path / name, GREYS, sound="mp2", container=container)
    target = tmp_path / f"out{ending}"
    straightened(path, target)
    assert len(clips.times(target)) == len(GREYS)
    assert np.allclose(sound_from(target), sound_from(path), atol=0.002)
    assert (clips.times(target)[0] > 99) if ending == ".ts" else (0 <= clips.times(target)[0] < 0.05)


def test_sound_before_the_beginning_of_an_edited_video(tmp_path):
    """An edit list hides 0.3 s of a cut video; other containers have no such list."""
    whole = clips.write(tmp_path / "whole.mp4", GREYS, sound=True)
    with clips.av.open(str(whole)) as old, clips.av.open(str(tmp_path / "in.mp4"), "w") as new:
        copies = [new.add_stream_from_template(each, opaque=True) for each in old.streams]
        for packet in old.demux():
            if packet.size:
                by = round(0.3 / packet.time_base)
                packet.pts, packet.dts = (packet.pts or 0) - by, (packet.dts or 0) - by
                packet.stream = copies[packet.stream_index]
                new.mux(packet)
    straightened(tmp_path / "in.mp4", tmp_path / "out.mkv")
    assert len(times(tmp_path / "out.mkv")) == len(times(tmp_path / "in.mp4")) < len(GREYS)
    assert -0.12 < sound_from(tmp_path / "out.mkv")[0] < 0


def test_sound_of_an_unknown_codec(tmp_path, capsys):
    path = clips.write(tmp_path / "in.mp4", GREYS, sound=True)
    path.write_bytes(path.read_bytes().replace(b"mp4a", b"?!?!").replace(b"esds", b"!?!?"))
    straightened(path, tmp_path / "out.mkv")
    assert "stream 1 (SoundHandler)" in capsys.readouterr().err


@pytest.mark.parametrize(("ending", "codec"), [(".mkv", "libx264"), (".mxf", "mpeg2video")])
def test_containers_hold_nothing_random(tmp_path, ending, codec):
    path = clips.write(tmp_path / f"in{ending}", GREYS, codec)
    for name in ("a", "b"):
        with clips.av.open(str(path)) as old, writing(tmp_path / name, ending) as new:
            copy = new.add_stream_from_template(old.streams.video[0], opaque=True)
            for packet in old.demux():
                if packet.size:
                    packet.stream = copy
                    new.mux(packet)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_prores_4444(tmp_path, capsys):
    """It is decoded to 12 bits, and encoded from 10."""
    path = clips.write(tmp_path / "in.mov", GREYS, "prores_ks", "yuv444p10le", options={"profile": "4444"})
    straightened(path, tmp_path / "out.mov")
    assert clips.facts(tmp_path / "out.mov")["streams"][0]["profile"] == "4444"
    assert "2 of 12 bits" in capsys.readouterr().err


def test_a_stream_without_times(tmp_path):
    path = clips.write(tmp_path / "in.h264", GREYS, "libx264")
    straightened(path, tmp_path / "out.mp4")
    assert np.allclose(np.diff(times(tmp_path / "out.mp4")), times(tmp_path / "out.mp4")[1])
    straightened(path, tmp_path / "part.mp4", "--start", 0.2)
    assert len(clips.luma(tmp_path / "part.mp4")) == 10


# ---- names ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", [thorough("50%.mp4"), thorough("%d.mp4"), "100%05d.mp4", thorough("a:b.mp4"), "concat:x.mp4"]
)
def test_names_that_mean_something_to_ffmpeg(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    clips.write(tmp_path / "in.mp4", GREYS).rename(name)
    straightened(name, tmp_path / "out.mp4")
    assert len(clips.luma(tmp_path / "out.mp4")) == len(GREYS)


def test_a_percent_sign_in_names_that_are_written(tmp_path):
    path = clips.write(tmp_path / "in.mp4", GREYS)
    (tmp_path / "50% %d").mkdir()
    straightened(path, tmp_path / "50% %d" / "50%.mp4", "--preview", tmp_path / "50% %d" / "50%.png")
    assert len(clips.luma(tmp_path / "50% %d" / "50%.mp4")) == len(GREYS)


def test_a_single_picture_is_no_video(tmp_path, capsys):
    path = clips.write(tmp_path / "in.mp4", GREYS)
    refused(capsys, [path, "-o", tmp_path / "out.png", *clips.KNOWN], 1, "ffmpeg -i video.mkv out/%05d.png")
    refused(capsys, [tmp_path, "-o", tmp_path / "out.mp4", *clips.KNOWN], 1, "is a folder", "ffmpeg -framerate 30 -i")
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize("at", [20, thorough(40)])
def test_nothing_can_be_followed_in_black_frames(tmp_path, at):
    greys = clips.moving(40, hand(4, seconds=6.0), ratio=0.6)[1]
    black = [np.zeros_like(greys[0])] * 4
    clip = clips.write(tmp_path / "in.mkv", [*greys[:at], *black, *greys[at:]], "ffv1")
    outcome = unshutter.rectify_clip(clip, tmp_path / "out.mkv", focal_px=clips.FOCAL)
    assert outcome.frames == 44 and outcome.rectified >= 40


@pytest.mark.parametrize(("codec", "ending"), [("mpeg4", ".avi"), ("ffv1", ".mkv"), thorough("wmv2", ".asf")])
def test_frames_whose_times_are_nearly_equal_stay_apart(tmp_path, codec, ending):
    """A file counts in coarser units than the clip: each frame keeps a time of its own."""
    at = [k / 30 for k in range(9)]
    at.insert(6, at[5] + 2 / 30000)
    clip = clips.write(tmp_path / "in.mov", GREYS[:10], "mpeg4", times=at)
    straightened(clip, tmp_path / f"out{ending}", "--codec", codec)
    assert len(set(clips.times(clip))) == len(set(clips.times(tmp_path / f"out{ending}"))) == 10
