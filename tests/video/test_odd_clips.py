"""Clips that are odd, but whole: they are straightened, and keep their times."""

import struct

import numpy as np
import pytest

from support import clips
from support.refusals import left_behind, refused
from unshutter.cli import main
from unshutter.video.clip import Clip

GREYS = clips.moving(16)[1]
RATIO = ["--readout-ratio", "0.6"]


def straightened(source, target, *more):
    assert main(["video", str(source), "-o", str(target), *RATIO, *map(str, more)]) == 0
    return Clip.look(target)


def times(path):
    return np.array([frame.time for frame in Clip.look(path).items()])


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
    path = clips.write(tmp_path / "in.avi", clips.moving(40)[1], "libx264", options={"bf": "3"})
    straightened(path, tmp_path / "out.avi")
    assert np.allclose(np.diff(times(path)), 1 / 30)
    assert np.allclose(times(tmp_path / "out.avi"), times(path), atol=0.01)
    straightened(path, tmp_path / "part.avi", "--start", 0.5)
    assert len(clips.luma(tmp_path / "part.avi")) == 25


@pytest.mark.parametrize(
    ("name", "codec"),
    [("in.mpg", "mpeg2video"), ("in.mpg", "mpeg1video"), ("in.mkv", "mpeg2video"), ("in.ts", "mpeg4")],
)
def test_encoders_with_clocks_of_their_own(tmp_path, name, codec):
    path = clips.write(tmp_path / name, GREYS, codec)
    straightened(path, tmp_path / f"out{path.suffix}")
    assert np.allclose(np.diff(times(tmp_path / f"out{path.suffix}")), 1 / 30, atol=0.001)


def test_a_film_that_begins_before_0(tmp_path):
    shown = [k / 30 - 0.2 for k in range(16)]
    path = clips.write(tmp_path / "in.mkv", GREYS, times=shown, container={"avoid_negative_ts": "disabled"})
    straightened(path, tmp_path / "out.mkv")
    assert len(clips.luma(tmp_path / "out.mkv")) == len(GREYS)
    assert np.allclose(np.diff(times(tmp_path / "out.mkv")), 1 / 30, atol=0.0015)


def test_a_stream_without_times(tmp_path):
    path = clips.write(tmp_path / "in.h264", GREYS, "libx264")
    straightened(path, tmp_path / "out.mp4")
    assert np.allclose(np.diff(times(tmp_path / "out.mp4")), times(tmp_path / "out.mp4")[1])
    straightened(path, tmp_path / "part.mp4", "--start", 0.2)
    assert len(clips.luma(tmp_path / "part.mp4")) == 10


# ---- names ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["50%.mp4", "%d.mp4", "100%05d.mp4", "a:b.mp4", "concat:x.mp4"])
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


def pictures(folder, numbers, name="%05d.png"):
    """A folder of pictures."""
    import cv2

    folder.mkdir()
    for number, grey in zip(numbers, GREYS, strict=False):
        cv2.imwrite(str(folder / name.replace("%05d", f"{number:05d}")), grey)
    return folder


@pytest.mark.parametrize("name", ["%05d.png", "100% %05d.png"])
def test_pictures_in_folders_with_a_percent_sign(tmp_path, name):
    folder = pictures(tmp_path / "50%d %s", range(7, 19), name)
    (tmp_path / "a%d").mkdir()
    straightened(folder, tmp_path / "a%d" / "out%")
    assert len(list((tmp_path / "a%d" / "out%").iterdir())) == 12


def test_a_picture_that_is_missing(tmp_path, capsys):
    folder = pictures(tmp_path / "in", [1, 2, 3, 5, 6])
    for source in (folder, folder / "%05d.png"):
        refused(capsys, [source, "-o", tmp_path / "out", *RATIO], 1, "00004.png is missing")


def test_a_single_picture_is_no_film(tmp_path, capsys):
    path = clips.write(tmp_path / "in.mp4", GREYS)
    refused(capsys, [path, "-o", tmp_path / "out.png", *RATIO], 1, "name a new folder")
    assert left_behind(tmp_path) == []
