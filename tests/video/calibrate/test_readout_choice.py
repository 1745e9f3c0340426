"""A clip whose readout time nobody knows: the usual one is taken, or the clip shows that it does not matter."""

import json
from dataclasses import replace

import numpy as np
import pytest

from support import clips
from support.covering import thorough
from support.hand_held import log_of, pan, shaking
from unshutter.cli import main
from unshutter.cli.clip_command import _line_of
from unshutter.errors import UnknownRatioError
from unshutter.options.clip_options import RectifyClip, Shutter
from unshutter.readout_time import ReadoutRatio, ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate import camera, cameras
from unshutter.video.calibrate.camera import find_camera
from unshutter.video.calibrate.cameras import CameraMode
from unshutter.video.calibrate.readout_regression import Estimate, Regression
from unshutter.video.calibrate.sampled_frames import SampledFrames
from unshutter.video.decision import why_unfit
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.file.video_writer import VideoWriter

SIZE = (clips.WIDTH, clips.HEIGHT)


def slow(px_a_frame):
    """An even pan by so many px from frame to frame."""
    return pan(px_a_frame * np.degrees(1 / clips.FOCAL) * clips.FPS)


@pytest.fixture
def run(tmp_path, capsys):
    """Rectifies a clip; (the log's record, what was printed, the new file)."""

    def rectified(clip, *flags, focal_px=clips.FOCAL):
        out, log = clip.with_stem("out"), tmp_path / "log.jsonl"
        log.unlink(missing_ok=True)
        known = ["--focal-px", str(focal_px)] if focal_px else []
        assert main(["video", str(clip), "-o", str(out), "--json-log", str(log), *flags, *known]) == 0
        return json.loads(log.read_text()), capsys.readouterr().err, out

    return rectified


def test_what_does_not_show_is_left_as_it_is_until_its_time_is_given(tmp_path, run):
    """An even pan shows no readout time, but leans; nobody knows how far."""
    greys = clips.moving(24, slow(3.0), ratio=0.5)[1]
    clip = clips.write(tmp_path / "in.mkv", greys, "ffv1")
    record, shown, out = run(clip)
    assert out.read_bytes() == clip.read_bytes()
    assert record["rectified"] == 0 and record["found_by"] == "usual value"
    (reason,) = record["declined"]
    assert reason["code"] == Code.READOUT_TIME_UNKNOWN and reason["figures"]["why"] in shown
    assert "to straighten it anyway, give its readout time: --readout-ms" in shown
    _, _, best = run(clip, "--readout-ratio", "0.5", "--overwrite")
    assert best.read_bytes() != clip.read_bytes()


@pytest.mark.parametrize(
    ("wobbles", "would_show"), [(True, False), (True, True), (False, True), (False, False), (None, None)]
)
def test_the_usual_value_stands_in_only_where_a_clip_wobbles(monkeypatch, tmp_path, wobbles, would_show):
    """How sure the regression is decides what happens to a clip whose path does not tell the readout time."""
    error = 0.1 if would_show else 0.3
    rows = Estimate(4 * error if wobbles else error, error)
    shown = None if wobbles is None else Regression(rows, Estimate(0.0, error), 1.0, 40, 0.5)
    if shown is not None:  # once, it is searched for
        monkeypatch.setattr(camera, "readout_time_in_frames", _too_even)
    monkeypatch.setattr(SampledFrames, "regression", shown)
    path = clips.write(tmp_path / "in.mkv", clips.moving(24, slow(3.0))[1], "ffv1")
    found, _ = find_camera(ClipRequest.of(read_clip_facts(path), RectifyClip(Shutter(focal_px=clips.FOCAL))))
    time = found.readout_time
    reason = why_unfit(found)
    if wobbles and would_show:  # an unsure ratio is better than a usual one
        assert reason is None and time.source is ReadoutSource.REGRESSION
        assert time.ratio(1 / clips.FPS).value == pytest.approx(4 * error, rel=0.3)
        return
    assert time.source is ReadoutSource.USUAL and time.instead_of.code is Code.READOUT_TIME_UNKNOWN
    if wobbles:
        assert reason is None
    else:
        assert reason.code is (Code.NO_WOBBLE if would_show else Code.READOUT_TIME_UNKNOWN)


def _too_even(*_):
    raise UnknownRatioError.because(Reason(Code.TOO_EVEN)).of_clip()


def test_a_make_tells_the_kind_of_camera(tmp_path, run):
    clip = clips.write(
        tmp_path / "in.mkv", clips.moving(24, slow(3.0))[1], "ffv1", tags={"make": "Apple", "model": "X"}
    )
    record, _, _ = run(clip)
    assert record["found_by"] == "usual value" and record["readout_ms"] < 12


def test_other_modes_of_a_known_camera_give_a_range(tmp_path, run):
    """GoPro's firmware names the camera; a clip of this size is in none of its modes."""
    clip = clips.write(
        tmp_path / "in.mp4", clips.moving(24, slow(3.0))[1], tags={"firmware": "HD5.02.02.00.00"}, **TAGS
    )
    record, shown, _ = run(clip)
    assert record["found_by"] == "table of cameras" and record["readout_ms"] == pytest.approx(16.68, abs=0.1)
    assert record["plausible_ms"] == [pytest.approx(8.34), pytest.approx(26.69, abs=0.01)]
    assert "taking 16.7 ms, typical of GoPro HERO5 Black in its other modes (anything from 8.3 to 26.7 ms)" in shown


WIDE = " (anything from 10.0 to 30.0 ms)"


@pytest.mark.parametrize(("low", "high", "span"), [(10, 30, WIDE), (30, 30, ""), (30, 30.003, "")])
def test_one_value_is_not_a_range(low, high, span):
    time = ReadoutTime.of_ms(30, ReadoutSource.TABLE, "GoPro Max", (low, high))
    time = replace(time, instead_of=Reason(Code.TOO_EVEN))
    assert _line_of(time).endswith(f": taking 30.0 ms, typical of GoPro Max{span}; to set it: --readout-ms")


TAGS = {"container": {"movflags": "use_metadata_tags"}}


@pytest.mark.parametrize("px", [0.0, thorough(0.25), 0.4])
def test_where_there_is_nothing_to_see_the_clip_is_copied(tmp_path, run, px):
    """Rows lie within half a frame's motion of the middle one; this lens shows corners move a third faster."""
    clip = clips.write(tmp_path / "in.mp4", clips.moving(24, slow(px))[1], sound=True)
    record, shown, out = run(clip)
    assert out.read_bytes() == clip.read_bytes()
    assert record["rectified"] == 0 and record["frames"] == 24 and record["written"]
    (reason,) = record["declined"]
    assert "is taken, as usual" not in shown
    if px > 0 and reason["code"] == Code.NO_WOBBLE:  # so it seems where processors or libraries compress it otherwise
        return
    assert reason["code"] == Code.NOTHING_TO_SEE
    assert px / 2 - 0.05 <= reason["figures"]["px"] <= 1.33 * px / 2 + 0.15
    assert "24 left unchanged (nothing to see: at most 0." in shown


def test_first_row_as_reference_shows_twice_as_much(tmp_path, run):
    clip = clips.write(tmp_path / "in.mkv", clips.moving(30, slow(0.45))[1], "ffv1")
    assert run(clip)[0]["rectified"] == 0
    (tmp_path / "out.mkv").unlink()
    (reason,) = run(clip, "--reference", "first")[0]["declined"]
    assert reason["code"] == Code.NO_VISIBLE_DISTORTION  # what may be seen is then looked at, and is less


@pytest.mark.parametrize("flags", [(), ("--readout-ms", "20")])
def test_unchanged_means_untouched(tmp_path, run, flags):
    """A copy byte for byte where a name is given, and nothing next to the clip where none is."""
    clip = clips.write(tmp_path / "in.mkv", clips.standing(30), "ffv1")
    assert run(clip, *flags)[2].read_bytes() == clip.read_bytes()
    before = sorted(tmp_path.iterdir())
    assert main(["video", str(clip), *flags]) == 0
    assert sorted(tmp_path.iterdir()) == before


def test_changed_frames_are_written_next_to_the_clip(tmp_path):
    moving = clips.write(tmp_path / "moving.mkv", clips.moving(16)[1], "ffv1")
    assert main(["video", str(moving), *clips.KNOWN]) == 0
    assert (tmp_path / "moving.rectified.mkv").exists()


def test_only_changed_writes_nothing(tmp_path, run):
    """Neither where nothing is to be seen nor, at a stated readout time, where nothing moved."""
    clip = clips.write(tmp_path / "in.mkv", clips.standing(30), "ffv1")
    for flags in ((), ("--readout-ms", "20")):
        record, shown, out = run(clip, "--only-changed", *flags)
        assert not record["written"] and "in.mkv -> not written: 0 of 30 frames straightened" in shown
        assert not out.exists()
    moving = clips.write(tmp_path / "in.mkv", clips.moving(16)[1], "ffv1")
    assert run(moving, "--only-changed", "--readout-ratio", "0.6")[2].exists()


def test_nothing_is_encoded_to_be_thrown_away(tmp_path, run, monkeypatch):
    """A clip that is left, and is not to be written then, costs no encoding, whatever encoder is chosen."""
    clip = clips.write(tmp_path / "in.mkv", clips.standing(30), "ffv1")
    encoded = []
    monkeypatch.setattr(VideoWriter, "_add_encoded", lambda self, packets: encoded.extend(packets))
    assert not run(clip, "--only-changed", "--codec", "libx264")[0]["written"]
    assert not encoded


@pytest.mark.parametrize("flags", [("--save-motion", "m.json"), ("--end", "0.5"), ("--codec", "libx264")])
def test_nothing_to_see_but_more_asked_for(tmp_path, run, flags, monkeypatch):
    """The frames then go through the encoder, unchanged."""
    monkeypatch.chdir(tmp_path)
    clip = clips.write(tmp_path / "in.mkv", clips.standing(30), "ffv1")
    record, _, out = run(clip, *flags)
    assert record["rectified"] == 0 and record["declined"][0]["code"] == Code.NOTHING_TO_SEE
    before, after = clips.luma(clip), clips.luma(out)
    assert np.abs(after - before[: len(after)]).mean() < 1


def test_people_who_walk_by_are_not_straightened_and_do_not_count(tmp_path, run):
    greys = clips.standing(30)
    for k, grey in enumerate(greys):
        greys[k] = grey.copy()
        greys[k][60:120, 5 * k : 5 * k + 20] = np.random.default_rng(1).integers(0, 255, (60, 20))
    clip = clips.write(tmp_path / "in.mkv", greys, "ffv1")
    assert run(clip)[0]["declined"][0]["code"] == Code.NOTHING_TO_SEE


def test_a_mode_of_the_table_needs_no_search(tmp_path, run, monkeypatch):
    one = CameraMode("Nemo", "One", "", *SIZE, 30.0, 20.0, 20.0, 20.0)
    monkeypatch.setattr(cameras, "table", lambda: (one,))
    monkeypatch.delattr(camera, "readout_time_in_frames")
    clip = clips.write(tmp_path / "in.mkv", clips.moving(16)[1], "ffv1", tags={"make": "Nemo", "model": "One"})
    record, shown, _ = run(clip)
    assert record["readout_ms"] == pytest.approx(20) and "plausible_ms" not in record
    assert "unshutter: readout time 20.0 ms, from table of cameras (Nemo One)" in shown


def hand():
    return log_of(lambda t: 25 * np.sin(6 * t), lambda t: 8 * np.sin(5 * t + 1), lambda t: 20 * np.sin(8 * t + 2))


@pytest.mark.parametrize("camera", [*(thorough(k) for k in range(8)), 8, thorough(9)])
def test_ten_clips_of_unknown_cameras(tmp_path, run, camera):
    """Each comes out corrected, with a bound, or as it is because it does not tell its readout time."""
    log = [
        slow(0.0),
        slow(0.2),
        slow(0.8),
        slow(4.0),
        hand(),
        shaking(5.0),
        shaking(14.0),
        slow(2.0),
        hand(),
        slow(1.5),
    ][camera]
    tags = {"make": ["", "Kilroy", "Sony", "Apple", "GoPro"][camera % 5], "model": "M 1"}
    greys = clips.moving(24, log, ratio=[0.2, 0.5, 0.9][camera % 3])[1]
    record, shown, out = run(clips.write(tmp_path / "in.mkv", greys, "ffv1", tags=tags), focal_px=None)
    reasons = {each["code"]: each["figures"] for each in record["declined"]}
    bound = reasons.get(Code.NOTHING_TO_SEE, {"px": 0.0 if Code.NO_VISIBLE_DISTORTION in reasons else 1.0})
    if Code.READOUT_TIME_UNKNOWN in reasons or Code.NO_WOBBLE in reasons:
        assert "give its readout time: --readout-ms" in shown and record["found_by"] == "usual value"
        return
    assert out.exists() and (record["rectified"] > 20 or bound["px"] < 0.5), shown


@pytest.mark.parametrize(("ms", "ratio"), [(20, 0.6), (40, 1.0), (0.1, 0.003)])
def test_no_frame_takes_longer_than_the_time_to_the_next(ms, ratio):
    assert ReadoutTime.of_ms(ms, ReadoutSource.GIVEN).ratio(0.1 / 3).value == ratio
    assert ReadoutRatio(ratio).seconds(0.1 / 3).ratio(0.1 / 3).value == ratio
