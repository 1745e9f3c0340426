"""Videos whose files end early are refused in one line, and whole ones never; what is there can be had."""

import re

import pytest

from support import clips
from support.refusals import left_behind, refused
from unshutter.cli import main
from unshutter.video.file.clip_facts import read_clip_facts

GREYS = clips.moving(30)[1]
RATIO = [*clips.KNOWN, "--strength", "0"]
FRAGMENTS = {"container": {"movflags": "frag_keyframe+empty_moov"}, "options": {"g": "10"}}
KINDS = {
    "mkv": ("libx264", "aac", {}),
    "webm": ("libvpx-vp9", "libopus", {"options": {"cpu-used": "8"}}),
    "flv": ("libx264", "aac", {}),
    "ts": ("libx264", "mp2", {}),
    "mp4": ("libx264", "aac", FRAGMENTS),
    "mpg": ("mpeg2video", "mp2", {}),
    "wmv": ("wmv2", False, {}),
    "avi": ("mjpeg", "mp2", {"pixel_format": "yuvj420p"}),
}
STATED = ["mkv", "webm", "flv", "mp4", "avi"]  # the others do not say how long they are


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    """One of each kind."""
    folder = tmp_path_factory.mktemp("videos")
    return {
        kind: clips.write(folder / f"whole.{kind}", GREYS, codec, sound=sound, **more)
        for kind, (codec, sound, more) in KINDS.items()
    }


@pytest.mark.parametrize("kind", KINDS)
def test_whole_videos_are_whole(videos, kind):
    clip = read_clip_facts(videos[kind], until_s=None)
    clip.check_whole()
    assert clip.extent.frames == len(list(clip.frames_between())) == len(GREYS)
    later = list(clip.frames_between(clip.expected.start_s + 0.3))
    assert 20 <= len(later) < 25  # some begin a little later than at 0


@pytest.mark.parametrize("kind", STATED)
def test_cut_off(tmp_path, capsys, videos, kind):
    data, cut = videos[kind].read_bytes(), tmp_path / f"in.{kind}"
    for share in (0.4,) if kind == "mp4" else (0.4, 0.6):  # a cut between two fragments does not show
        cut.write_bytes(data[: int(share * len(data)) + 1])
        refused(capsys, [cut, "-o", tmp_path / f"out.{kind}", *RATIO], 1, f"in.{kind}", "the file is cut off")
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize("kind", ["mkv", "flv", "webm"])
def test_how_much_is_missing(tmp_path, capsys, videos, kind):
    """And how to keep what is there."""
    data, cut = videos[kind].read_bytes(), tmp_path / f"in.{kind}"
    cut.write_bytes(data[: len(data) * 6 // 10])
    shown = refused(capsys, [cut, "-o", tmp_path / f"out.{kind}", *RATIO], 1, "ends early")
    match = re.search(r"after (0\.\d) of 1\.\d s: the file is cut off; --end (0\.\d) keeps", shown)
    assert match is not None and float(match[1]) - float(match[2]) < 0.11
    out = tmp_path / f"out.{kind}"
    refused(capsys, [cut, "-o", out, *RATIO, "--end", f"{float(match[1]) + 0.2:.1f}"], 1, "ends early")
    assert main(["video", str(cut), "-o", str(out), *RATIO, "--end", match[2]]) == 0
    assert 8 < len(clips.luma(out)) < 30


@pytest.mark.parametrize("kind", ["mkv", "webm", "avi"])
def test_what_lies_behind_the_last_frame_may_be_missing(videos, tmp_path, kind):
    """Such as an index: no frame is lost."""
    (tmp_path / f"in.{kind}").write_bytes(videos[kind].read_bytes()[:-1])
    clip = read_clip_facts(tmp_path / f"in.{kind}", until_s=None)
    clip.check_whole()
    assert len(list(clip.frames_between())) == len(GREYS)


def test_an_end_that_was_never_written(tmp_path, capsys):
    """A file of full length, but empty from the middle of the video on, as some downloads and recorders leave it."""
    clusters = {"container": {"cluster_time_limit": "300"}, "options": {"bf": "0"}}
    data = bytearray(clips.write(tmp_path / "whole.mkv", GREYS, **clusters).read_bytes())
    at = [match.start() for match in re.finditer(rb"\x1f\x43\xb6\x75", data)][1]
    data[at:] = bytes(len(data) - at)
    (tmp_path / "in.mkv").write_bytes(data)
    refused(capsys, [tmp_path / "in.mkv", "-o", tmp_path / "out.mkv", *RATIO], 1, "ends early", "of 1.")


def test_a_hole_is_told(tmp_path, capsys):
    """The video goes on after it: nobody knows whether something is missing."""
    times = [k / 30 + (2.0 if k > 15 else 0.0) for k in range(30)]
    path = clips.write(tmp_path / "in.mp4", GREYS, times=times)
    assert main(["video", str(path), "-o", str(tmp_path / "out.mp4"), *RATIO]) == 0
    assert "no frames for 2.0 s after 0.5 s" in capsys.readouterr().err


def test_tables_of_mp4_that_come_first(tmp_path, capsys):
    whole = clips.write(tmp_path / "whole.mp4", GREYS, container={"movflags": "faststart"}).read_bytes()
    (tmp_path / "in.mp4").write_bytes(whole[: len(whole) * 2 // 3])
    refused(capsys, [tmp_path / "in.mp4", "-o", tmp_path / "out.mp4", *RATIO], 1, "ends early, after 0.", "of 1.0 s")
