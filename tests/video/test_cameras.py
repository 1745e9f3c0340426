"""The table of cameras: what is in it, how it is listed, and when a clip takes its readout time from it."""

import json

import pytest

from support import clips
from unshutter.cli import main
from unshutter.errors import UsageError
from unshutter.video import cameras
from unshutter.video.cameras import CameraMode

NEMO = [
    CameraMode("Nemo", "One", "", clips.WIDTH, clips.HEIGHT, 30.0, 20.0, "", "one.json"),
    CameraMode("Nemo", "One Pro", "Wide", clips.WIDTH, clips.HEIGHT, 30.0, 10.0, "", "wide.json"),
    CameraMode("Nemo", "One Pro", "Tele", clips.WIDTH, clips.HEIGHT, 30.0, 15.0, "", "tele.json"),
]


@pytest.fixture
def nemo(monkeypatch):
    monkeypatch.setattr(cameras, "table", lambda: tuple(NEMO))


def log_of(tmp_path, capsys, clip, *flags):
    """(what the log says, what was printed) of a run."""
    log = tmp_path / "log.jsonl"
    words = ["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--json-log", str(log), *flags]
    assert main(words) == 0
    return json.loads(log.read_text()), capsys.readouterr().err


# ---- the table ----------------------------------------------------------------------------------------------


def test_every_time_can_be_one_and_says_where_it_is_from():
    modes = cameras.table()
    assert len(modes) >= 40
    for mode in modes:
        assert 2 <= mode.readout_ms <= 1000 / mode.fps, mode
        assert mode.brand and mode.model and mode.profile.endswith(".json")
        assert mode.width >= 1280 and mode.height >= 720
    assert len(set(modes)) == len(modes)


def test_no_mode_has_times_that_contradict_each_other():
    for mode in cameras.table():
        time = cameras.readout_ms(mode.name, mode.width, mode.height, mode.fps)
        assert time == pytest.approx(mode.readout_ms, rel=0.06)


# ---- names --------------------------------------------------------------------------------------------------


def test_cameras_are_listed_by_a_word(capsys):
    assert main(["cameras"]) == 0
    everything = capsys.readouterr().out
    assert main(["cameras", "alpha", "7c"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line == "Sony Alpha 7C  3840x2160 px at 25 frames/s  24.7 ms"
    assert len(everything.splitlines()) == len(cameras.table())
    assert main(["cameras", "no such camera"]) == 2
    assert "no camera of the table is called 'no such camera'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "time"), [("nemo one", 20), ("One", 20), ("ONE PRO tele", 15), ("wide", 10), ("one-pro wide", 10)]
)
def test_a_name_needs_as_much_as_tells_the_camera(nemo, name, time):
    assert cameras.readout_ms(name, clips.WIDTH, clips.HEIGHT, 29.97) == time
    assert cameras.readout_ms(name, clips.HEIGHT, clips.WIDTH, 30) == time  # held upright


@pytest.mark.parametrize(
    ("name", "mode", "complaint"),
    [
        ("Two", (192, 144, 30), "no camera of the table is called 'Two'"),
        (
            "One Pro",
            (192, 144, 30),
            r"be Nemo One Pro Wide \(10.0 ms\), Nemo One Pro Tele \(15.0 ms\): say which",
        ),
        ("One", (192, 144, 60), "no time for 'One' with 192x144 px at 60 frames/s, only for 192x144 px at 30 frames/s"),
        ("One", (640, 480, 30), "say it with --readout-ms"),
    ],
)
def test_what_the_table_does_not_have_is_refused(nemo, name, mode, complaint):
    with pytest.raises(UsageError, match=complaint):
        cameras.readout_ms(name, *mode)


def test_times_that_nearly_agree_are_one():
    assert cameras.readout_ms("pocket cinema camera 4k", 4096, 2160, 25) == pytest.approx((16.7 + 17.7) / 2)


@pytest.mark.parametrize(
    ("tags", "found"),
    [
        ({"make": "Nemo", "model": "One"}, ("Nemo One", 20)),
        ({"com.apple.quicktime.model": "one"}, ("Nemo One", 20)),
        ({"com.android.manufacturer": "NEMO", "com.android.model": "Nemo One"}, ("Nemo One", 20)),
        ({"make": "Nemo", "model": "One Pro"}, None),  # which lens?
        ({"make": "Nemo"}, None),
        ({"model": "On"}, None),
        ({}, None),
    ],
)
def test_tags_name_the_camera_if_its_lens_does_not_matter(nemo, tags, found):
    assert cameras.of_tags(tags, clips.WIDTH, clips.HEIGHT, 30.0) == found


def test_a_camera_in_a_mode_without_a_time_is_unknown(nemo):
    assert cameras.of_tags({"model": "One"}, clips.WIDTH, clips.HEIGHT, 60.0) is None


# ---- clips --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("flags", [(), ("--camera", "nemo one")])
def test_a_clip_that_does_not_show_its_readout_time_takes_the_tables(tmp_path, capsys, nemo, flags):
    tags = {} if flags else {"make": "Nemo", "model": "One"}
    clip = clips.write(tmp_path / "in.mkv", clips.standing(), "ffv1", tags=tags)
    told, printed = log_of(tmp_path, capsys, clip, *flags)
    assert told["readout_ms"] == pytest.approx(20) and told["found_by"] == "table of cameras"
    assert "this clip does not show its readout time" in printed
    assert "the table of cameras says 20.0 ms for" in printed and "--readout-ms" not in printed


def test_what_a_clip_shows_beats_the_table(tmp_path, capsys, monkeypatch):
    wrong = [CameraMode("Nemo", "One", "", clips.WIDTH, clips.HEIGHT, 30.0, 8.0, "", "one.json")]
    monkeypatch.setattr(cameras, "table", lambda: tuple(wrong))
    greys = clips.moving(60, clips.shaken(3.0))[1]
    clip = clips.write(tmp_path / "in.mkv", greys, "ffv1")
    told, _ = log_of(tmp_path, capsys, clip, "--camera", "one")
    assert told["found_by"] == "motion" and told["readout_ms"] == pytest.approx(20, abs=2)


def test_an_unknown_camera_is_refused_before_any_work(tmp_path, capsys):
    clip = clips.write(tmp_path / "in.mkv", clips.standing(), "ffv1")
    assert main(["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--camera", "Zorki 4"]) == 2
    assert "no camera of the table is called 'Zorki 4'" in capsys.readouterr().err
    assert main(["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--camera", "x", "--readout-ms", "9"]) == 2
    assert "either the readout time or --camera" in capsys.readouterr().err
    assert not (tmp_path / "out.mkv").exists()
