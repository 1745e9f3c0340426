"""``unshutter measure``: what clips tell of their camera, in words, as JSON and in Python."""

import json

import numpy as np
import pytest

import unshutter
from support import clips
from support.hand_held import hand
from unshutter.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two clips of one camera, one of them upside down, and one with a global shutter."""
    place = tmp_path_factory.mktemp("clips")
    for name, seed in (("a", 4), ("b", 6)):
        greys = clips.moving(50, hand(seed, seconds=6.0), ratio=0.6)[1]
        clips.write(place / f"{name}.mkv", greys, "ffv1", "gray")
        if name == "a":
            turned = [np.ascontiguousarray(np.rot90(grey, 2)) for grey in greys]
            clips.write(place / "turned.mkv", turned, "ffv1", "gray")
    camera = clips.moving(60, hand(4, seconds=6.0), ratio=0.6)[0]
    clips.write(place / "global.mkv", clips.truth(camera), "ffv1", "gray")
    return place


def test_words_and_json_say_the_same_and_clips_of_one_camera_are_measured_together(folder, capsys):
    assert main(["measure", str(folder / "a.mkv")]) == 0
    words = capsys.readouterr().out
    assert words.startswith(f"{folder / 'a.mkv'} (192x144 px, 30.00 frames/s): ")
    names = [str(folder / "a.mkv"), str(folder / "b.mkv")]
    assert main(["measure", "--json", "--one-camera", *names]) == 0
    record, second, both = json.loads(capsys.readouterr().out)
    assert record["readout_ratio"] == pytest.approx(0.6, rel=0.1)
    assert record["readout_ms"] == pytest.approx(1000 * record["readout_ratio"] / record["fps"], rel=0.01)
    assert (record["direction"], record["found_by"]) == ("top-to-bottom", "regression")
    assert record["frames_show_surely"] is True
    assert f"readout time {record['readout_ms']:.1f} +- " in words and "from regression" in words
    assert record["wobble_px"] > 0.2 and f"{record['wobble_px']:.2f} px" in words
    assert both["clips"] == names and both["pairs"] == record["pairs"] + second["pairs"]
    assert both["readout_ratio"] == pytest.approx(0.6, rel=0.1)


def test_a_clip_that_was_read_from_the_bottom_and_a_global_shutter_say_so(folder, capsys):
    found, other = unshutter.measure_clips([folder / "turned.mkv", folder / "global.mkv"])
    assert found.direction == "bottom-to-top" and found.readout_time is not None
    assert found.readout_time.seconds / found.interval_s == pytest.approx(0.6, rel=0.1)

    assert other.is_global and other.readout_time is None and other.as_json()["rolling_shutter"] is False
    assert main(["measure", str(folder / "global.mkv")]) == 0
    assert "no rolling shutter: its frames show no rolling shutter" in capsys.readouterr().out


def test_what_cannot_be_measured_ends_in_one_line(folder, tmp_path, capsys):
    assert main(["measure", "photo.jpg"]) == 2 and "is a photo" in capsys.readouterr().err
    assert main(["measure", str(tmp_path / "none.mp4")]) == 1
    one = clips.write(tmp_path / "one.mkv", clips.moving(1, hand(4))[1], "ffv1", "gray")
    capsys.readouterr()
    assert main(["measure", str(one)]) == 1
    shown = capsys.readouterr().err
    assert "too few frames to measure" in shown and shown.count("\n") == 1
    assert main(["measure", str(folder / "a.mkv"), "--start", "3", "--end", "2"]) == 2
