"""How large new videos become, and how many frames wait between the steps of a large clip."""

from dataclasses import replace

import pytest

from support import clips
from support.covering import covering
from unshutter.cli import main
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
def test_a_video_takes_as_many_bits_as_the_clip(tmp_path, greys, rate, ending, capsys):
    clip = clips.write(tmp_path / f"in{ending}", greys, options={"b": rate, "preset": "veryfast"})
    assert 0.7 < new_size(clip) < 1.4
    assert "bits a second" not in capsys.readouterr().err


def test_a_video_that_becomes_much_larger_or_smaller_is_announced(tmp_path, greys, capsys):
    clip = clips.write(tmp_path / "in.mp4", greys, options={"b": "400k", "preset": "veryfast"})
    times = new_size(clip, "--crf", "5")
    lines = capsys.readouterr().err.splitlines()
    announced = next(k for k, line in enumerate(lines) if "times as large as the clip's" in line)
    assert times > 1.6 and "without --crf" in lines[announced]
    assert announced < next(k for k, line in enumerate(lines) if "straightened" in line)
    assert new_size(clip, "--crf", "45") < 1 / 1.6
    assert "times smaller than the clip's" in capsys.readouterr().err


@pytest.mark.parametrize("encode", [Encode(crf=20), Encode(codec="libx265")])
def test_a_quality_or_another_codec_is_followed_instead(tmp_path, greys, encode):
    clip = read_clip_facts(str(clips.write(tmp_path / "in.mp4", greys[:5])))
    encoder = Encoder.choose(clip, encode)
    assert encoder.bits_per_s is None and encoder.options["crf"] == "20"
    assert Encoder.choose(clip, Encode()).bits_per_s and "crf" not in Encoder.choose(clip, Encode()).options


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
