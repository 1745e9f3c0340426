"""The table of cameras: what is in it, how it is listed, and when a clip takes its readout time from it."""

import json
import re
from importlib.resources import files
from statistics import median, quantiles

import pytest

from support import clips, gpmf
from unshutter.cli import main
from unshutter.errors import UsageError
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.video.calibrate import cameras
from unshutter.video.calibrate.cameras import CameraMode

SIZE = (clips.WIDTH, clips.HEIGHT)
NEMO = [
    CameraMode("Nemo", "One", "", *SIZE, 30.0, 20.0, 20.0, 20.0),
    CameraMode("Nemo", "One Pro", "Wide", *SIZE, 30.0, 10.0, 10.0, 10.0),
    CameraMode("Nemo", "One Pro", "Tele", *SIZE, 30.0, 15.0, 15.0, 15.0),
    CameraMode("Nemo", "Two", "", *SIZE, 30.0, 12.0, 8.0, 16.0, profiles=3),
    CameraMode("Nemo", "Two", "", *SIZE, 60.0, 9.0, 9.0, 9.0),
]


@pytest.fixture
def nemo(monkeypatch):
    monkeypatch.setattr(cameras, "table", lambda: tuple(NEMO))


# ---- the table ----------------------------------------------------------------------------------------------


def test_every_time_can_be_one():
    modes = cameras.table()
    assert len(modes) > 450 and len({(mode.brand, mode.model) for mode in modes}) > 200
    for mode in modes:
        assert 2 <= mode.least_ms <= mode.readout_ms <= mode.most_ms <= 1000 / mode.fps * 1.03, mode
        assert mode.brand and mode.model and mode.profiles >= 1
        assert mode.width >= mode.height >= 480
    assert len(set(modes)) == len(modes)


def test_what_is_no_measurement_is_not_in_the_table():
    """The placeholder, the end of a slider, which is the frame interval, and the last time that a search tries."""
    for mode in cameras.table():
        for time in {mode.least_ms, mode.readout_ms, mode.most_ms}:
            interval = 1000 / mode.fps
            assert abs(time - 4.89) > 0.001 and abs(time - interval) > 0.015, mode
            assert mode.profiles > 1 or abs(time - (int(interval) - 0.01)) > 0.005, mode


def test_the_table_says_where_it_is_from_and_its_licence():
    head = (files("unshutter") / "video" / "calibrate" / "cameras.csv").read_text().split("brand,model", 1)[0]
    assert "github.com/gyroflow/lens_profiles" in head and "CC0-1.0" in head


# ---- the readout time of a clip -----------------------------------------------------------------------------


def test_a_camera_is_found_by_make_model_size_and_rate(nemo):
    time = cameras.find("Nemo", "One", SIZE, 29.97)
    assert time == cameras.find("nemo inc.", "Nemo One", SIZE[::-1], 30)  # held upright
    assert time == ReadoutTime.of_ms(20, ReadoutSource.TABLE, "Nemo One")
    assert ReadoutTime.of_ms(20, ReadoutSource.TABLE, plausible_ms=(12, 30)).plausible_ms == (12, 30)
    assert cameras.find("", "one", SIZE, 30) == time
    assert cameras.find("Ahab", "One", SIZE, 30) is cameras.find("Nemo", "Three", SIZE, 30) is None
    assert cameras.find("Nemo", "", SIZE, 30) is cameras.find("", "", SIZE, 30) is None


def test_profiles_and_lenses_that_disagree_give_a_range(nemo):
    two = cameras.find("Nemo", "Two", SIZE, 30)
    assert (two.ms, two.plausible_ms, two.camera) == (12, (8, 16), "Nemo Two in this mode")
    pro = cameras.find("Nemo", "One Pro", SIZE, 30)
    assert (pro.plausible_ms, pro.camera) == ((10, 15), "Nemo One Pro in this mode")


def test_other_modes_of_a_camera_say_something_of_a_mode_that_is_not_listed(nemo):
    faster = cameras.find("Nemo", "Two", SIZE, 100)
    assert faster.plausible_ms == (8, 10)  # never longer than a frame takes
    assert faster.camera == "Nemo Two in this frame size at other rates"
    other = cameras.find("Nemo", "One", (640, 480), 30)
    assert (other.ms, other.plausible_ms, other.camera) == (20, (20, 20), "Nemo One in its other modes")


@pytest.mark.parametrize(
    ("tags", "camera"),
    [
        ({"make": "SONY", "model": "ILCE-7M4"}, "Sony a7IV"),
        ({"make": "Canon", "model": "Canon EOS R6m2"}, "Canon R6ii"),
        ({"make": "Panasonic", "model": "DC-GH6"}, "Panasonic GH6"),
        ({"make": "NIKON CORPORATION", "model": "NIKON Z 6_2"}, "Nikon Z6 II"),
        (
            {"com.apple.quicktime.make": "Apple", "com.apple.quicktime.model": "iPhone 15 Pro Max"},
            "Apple iPhone 15 Pro Max",
        ),
        ({"firmware": "HD5.02.02.00.00"}, "GoPro HERO5 Black"),
    ],
)
def test_cameras_are_known_by_the_names_that_their_files_give_them(tags, camera):
    entry = cameras.find(*cameras.camera_of(tags), (3840, 2160), 29.97)
    assert entry is not None and cameras._spelled(entry.camera.partition(" in ")[0]) == cameras._spelled(camera)


@pytest.mark.parametrize("tags", [{"make": "Nemo"}, {"model": "On"}, {"firmware": "1.0"}, {}])
def test_tags_that_name_no_camera_find_none(nemo, tags):
    assert cameras.find(*cameras.camera_of(tags), SIZE, 30.0) is None


# ---- names --------------------------------------------------------------------------------------------------


def test_cameras_are_listed_by_a_word(capsys):
    assert main(["cameras"]) == 0
    everything = capsys.readouterr().out.splitlines()
    assert len(everything) <= len({(mode.brand, mode.model) for mode in cameras.table()})
    assert any(re.fullmatch(r"Sony a6400 +3 modes +4\.8 to 38\.6 ms", line) for line in everything)
    assert main(["cameras", "hero5"]) == 0
    times = capsys.readouterr().out.splitlines()
    assert times and all("GoPro HERO5" in line or "GoPro Hero5" in line for line in times)
    assert any(line.split("  ")[0] == "GoPro HERO5 Black" and line.endswith("26.7 ms") for line in times)
    assert main(["cameras", "hero5", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [each["readout_ms"] for each in listed] == [mode.readout_ms for mode in cameras.listed("hero5")]
    assert main(["cameras", "no such camera"]) == 2
    assert "the table has no camera called 'no such camera'" in capsys.readouterr().err


def test_lenses_are_listed_if_asked_for(capsys):
    assert main(["cameras", "hero", "--lenses"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 20 and all("hero" in line.lower() and "degrees" in line for line in lines)
    assert main(["cameras", "hero", "--lenses", "--json"]) == 0
    assert [round(lens["degrees"]) for lens in json.loads(capsys.readouterr().out)][:1] == [int(lines[0].split()[-2])]
    assert main(["cameras", "no such camera", "--lenses"]) == 2
    assert "the table has no lens of a camera called 'no such camera'" in capsys.readouterr().err


def test_no_brand_is_said_twice(capsys):
    assert main(["cameras"]) == 0
    assert not [line for line in capsys.readouterr().out.splitlines() if re.match(r"(\w+) ?\1", line, re.IGNORECASE)]
    assert {"Hawkeye", "XTU MAX2"} <= {mode.camera for mode in cameras.table()}
    assert cameras.find_named("XTUMAX2", (3840, 2160), 30.0).camera == "XTU MAX2"


@pytest.mark.parametrize("words", [["alpha", "7c"], ["ILCE-7C"], ["a7c"]])
def test_a_camera_is_listed_by_any_of_its_names(capsys, words):
    assert main(["cameras", *words]) == 0
    assert "Sony A7C" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "time"), [("nemo one", 20), ("One", 20), ("ONE PRO tele", 15), ("wide", 10), ("one-pro wide", 10)]
)
def test_a_name_needs_as_much_as_tells_the_camera(nemo, name, time):
    assert cameras.find_named(name, SIZE, 29.97).ms == time


@pytest.mark.parametrize(
    ("name", "mode", "complaint"),
    [
        ("Three", (SIZE, 30), "the table has no camera called 'Three'"),
        ("One Pro", (SIZE, 30), r"be Nemo One Pro Wide \(10.0 ms\), Nemo One Pro Tele \(15.0 ms\): give the full name"),
        ("One", (SIZE, 60), "no time for 'One' with 192x144 px at 60 frames/s, only for 192x144 px at 30 frames/s"),
        ("One", ((640, 480), 30), "give --readout-ms"),
    ],
)
def test_what_the_table_does_not_have_is_refused(nemo, name, mode, complaint):
    with pytest.raises(UsageError, match=complaint):
        cameras.find_named(name, *mode)


# ---- clips --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("flags", [(), ("--camera", "nemo one")])
def test_a_clip_takes_the_tables_readout_time(tmp_path, straighten, nemo, flags):
    tags = {} if flags else {"make": "Nemo", "model": "One"}
    clip = clips.write(tmp_path / "in.mkv", clips.standing(), "ffv1", tags=tags)
    _, record, printed = straighten(clip, *flags)
    assert record["readout_ms"] == pytest.approx(20) and record["found_by"] == "table of cameras"
    assert "readout time 20.0 ms, from table of cameras" in printed and "--readout-ms" not in printed


def test_what_a_clip_shows_beats_profiles_that_disagree(tmp_path, straighten, monkeypatch):
    wrong = [CameraMode("Nemo", "One", "", *SIZE, 30.0, 8.0, 6.0, 10.0, profiles=3)]
    monkeypatch.setattr(cameras, "table", lambda: tuple(wrong))
    greys = clips.moving(36, clips.shaken(3.0))[1]
    clip = clips.write(tmp_path / "in.mkv", greys, "ffv1")
    _, record, _ = straighten(clip, "--camera", "one", *clips.KNOWN[2:])
    assert record["found_by"] in ("motion", "regression") and record["readout_ms"] == pytest.approx(20, abs=2)


def test_an_unknown_camera_is_refused_before_any_work(tmp_path, capsys):
    clip = clips.write(tmp_path / "in.mkv", clips.standing(), "ffv1")
    assert main(["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--camera", "Zorki 4"]) == 2
    assert "the table has no camera called 'Zorki 4'" in capsys.readouterr().err
    assert main(["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--camera", "x", "--readout-ms", "9"]) == 2
    assert "give --readout-ms, --readout-ratio or --camera: one of them" in capsys.readouterr().err
    assert not (tmp_path / "out.mkv").exists()


def test_an_unknown_camera_is_refused_for_every_clip(tmp_path, capsys):
    """Even where another readout time counts: in a clip that was stabilised in the camera, none of the table does."""
    clip = clips.write(tmp_path / "in.mp4", clips.standing())
    gpmf.with_settings(clip, gpmf.entry(b"EISE", b"c", b"Y"))
    assert main(["video", str(clip), "-o", str(tmp_path / "out.mp4"), "--camera", "iPhone 99"]) == 2
    assert "no camera called 'iPhone 99': did you mean Apple iPhone 12" in capsys.readouterr().err


def test_the_usual_time_of_phones_leaves_out_a_twentieth_at_each_end():
    """The value that is usual is the median; Python's statistics calculate the same from the table."""
    phones = {"apple", "samsung", "xiaomi", "redmi", "realme", "poco", "oneplus", "huawei", "honor", "zte", "ulefone"}
    phones |= {"oppo", "vivo", "nothing", "google"}
    rates = 30 / 1.3, 30 * 1.3
    times = [
        mode.readout_ms
        for mode in cameras.table()
        if mode.brand.split()[0].lower() in phones and rates[0] < mode.fps < rates[1]
    ]
    assert len(times) > 20
    twentieths = quantiles(times, n=20, method="inclusive")
    found = cameras.usual_time({"make": "Apple", "model": "unknown"}, 1 / 30)
    assert found.plausible_ms == pytest.approx((twentieths[0], twentieths[-1]))
    assert found.ms == pytest.approx(median(times))
    assert found.camera == "phones" and found.source == "usual value"
