"""How large new videos become, and how many frames wait between the steps of a large clip."""

from dataclasses import replace

import av
import cv2
import numpy as np
import pytest

from support import clips
from support.covering import covering
from unshutter.cli import main
from unshutter.errors import UsageError
from unshutter.options.clip_options import Encode, RectifyClip
from unshutter.readout_time import ReadoutTime
from unshutter.video.calibrate.camera import ClipCamera
from unshutter.video.decision import RectifyFrames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.file.encoders import Encoder
from unshutter.video.render import rendering as steps
from unshutter.video.render.rendering import Rendering


@pytest.fixture(scope="module")
def greys():
    return clips.moving(60)[1]


def new_size(path, *flags):
    out = path.with_name(f"out{path.suffix}")
    command = ["video", str(path), "-o", str(out), *clips.KNOWN, "--preset", "veryfast", "--overwrite"]
    assert main([*command, *flags]) == 0
    return out.stat().st_size / path.stat().st_size


@pytest.mark.parametrize(("rate", "ending"), covering(["150k", "3M"], [".mp4", ".mkv"]))
def test_a_video_takes_as_many_bits_as_the_clip_if_asked(tmp_path, greys, rate, ending, capsys):
    clip = clips.write(tmp_path / f"in{ending}", greys, options={"b": rate, "preset": "veryfast"})
    assert 0.7 < new_size(clip, "--bitrate", "same") < 1.4
    assert "bits a second" not in capsys.readouterr().err


def test_a_video_that_becomes_much_larger_or_smaller_is_announced(tmp_path, greys, capsys):
    clip = clips.write(tmp_path / "in.mp4", greys, options={"b": "400k", "preset": "veryfast"})
    times = new_size(clip, "--crf", "5")
    lines = capsys.readouterr().err.splitlines()
    announced = next(k for k, line in enumerate(lines) if "times as large as the clip's" in line)
    assert times > 1.6 and "--bitrate same keeps" in lines[announced]
    assert announced < next(k for k, line in enumerate(lines) if "straightened" in line)
    assert new_size(clip, "--crf", "45") < 1 / 1.6
    assert "times smaller than the clip's" in capsys.readouterr().err


def test_a_quality_is_followed_unless_the_clips_rate_is_asked_for(tmp_path, greys):
    clip = read_clip_facts(str(clips.write(tmp_path / "in.mp4", greys[:5])))
    for encode, crf in ((Encode(crf=20), "20"), (Encode(codec="libx265"), "12"), (Encode(), "12")):
        encoder = Encoder.choose(clip, encode)
        assert encoder.bits_per_s is None and encoder.options["crf"] == crf
    for codec in (None, "libx265"):
        encoder = Encoder.choose(clip, Encode(codec, bitrate="same"))
        assert encoder.bits_per_s and "crf" not in encoder.options
    for codec, of, said in (("ffv1", clip, "does not support"), (None, _without_rate(clip), "does not state")):
        with pytest.raises(UsageError, match=said):
            Encoder.choose(of, Encode(codec, bitrate="same"))


@pytest.mark.parametrize(("pixel_format", "threads"), [("yuv422p", 1), ("yuv420p", 0)])
def test_x264_writes_the_same_bytes_each_time(tmp_path, greys, pixel_format, threads):
    """In 4:2:2 and 4:4:4 it does so only with one thread; 0: as many as there are."""
    clip = read_clip_facts(str(clips.write(tmp_path / "in.mkv", greys[:3], "ffv1", pixel_format)))
    with av.open(str(tmp_path / "out.mkv"), "w") as file:
        stream = Encoder.choose(clip, Encode("libx264")).add_to(file, clip, (144, 192))
        assert stream.codec_context.thread_count == threads


def _without_rate(clip):
    return replace(clip, coding=replace(clip.coding, bits_per_s=0.0))


def test_a_new_video_is_as_sharp_as_the_clip(tmp_path, greys):
    """Frames that did not move keep their sharpness and 45 dB, with the encoder's own preset."""
    clip = clips.write(tmp_path / "in.mp4", greys[:8], options={"crf": "0"})
    before = clips.luma(clip)
    for codec in ("libx264", "libx265"):
        options = Encoder.choose(read_clip_facts(str(clip)), Encode(codec)).options
        after = clips.luma(clips.write(tmp_path / f"{codec}.mp4", greys[:8], codec, options=options))
        sharp = [sum(cv2.Laplacian(each, cv2.CV_64F).var() for each in some) for some in (before, after)]
        assert 10 * np.log10(255**2 / np.square(after - before).mean()) > 45 and sharp[1] > 0.95 * sharp[0]


def test_frames_that_wait_are_bounded_by_their_bytes(tmp_path, greys, monkeypatch):
    small = read_clip_facts(str(clips.write(tmp_path / "in.mp4", greys[:5])))
    large = replace(small, height=2160, width=3840)
    assert large.frame_bytes == 2160 * 3840 * 1.5
    bounds = []
    monkeypatch.setattr(steps, "ahead", lambda items, most: bounds.append(most))
    monkeypatch.setattr(steps, "with_motion", lambda *_: None)
    for clip in (small, large):
        Rendering(ClipRequest.of(clip, RectifyClip()), ClipCamera(ReadoutTime(0.02)), RectifyFrames()).moving(iter([]))
    assert bounds == [2, 8, 2, 2]


def test_large_frames_are_looked_ahead_of_less(tmp_path, greys):
    small = read_clip_facts(str(clips.write(tmp_path / "in.mp4", greys[:5])))
    large = replace(small, height=2160, width=3840)
    assert "rc-lookahead" not in Encoder.choose(small, Encode()).options
    assert Encoder.choose(large, Encode()).options["rc-lookahead"] == "4"
