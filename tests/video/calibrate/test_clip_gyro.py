"""Clips with gyro logs: what the log is found to be, what is done by it, and what is left to the pictures."""

import sys

import numpy as np
import pytest

from support import clips, gpmf, hand_held
from support.gyro_logs import gyro_log as drawn_log
from support.gyro_logs import write_gcsv
from support.refusals import refused
from unshutter.video.gyro import gyro_log

FRAMES, SHIFT = 32, 0.137
FOCAL = clips.KNOWN[2:]  # half of a search is to find it
RATIO_S = clips.RATIO / clips.FPS


def vibration():
    """An engine that frames at 30 a second cannot follow, in a hand."""

    def waves(strength, hertz, phase):
        return lambda t: strength * np.sin(2 * np.pi * hertz * t + phase) + 12 * np.sin(9 * t + phase)

    return hand_held.log_of(waves(90, 47, 0), waves(60, 41, 1), waves(80, 53, 2))


@pytest.fixture(scope="module")
def shaken(tmp_path_factory):
    """(camera, its clip, its log's file)."""
    folder = tmp_path_factory.mktemp("gyro")
    camera, greys = clips.moving(FRAMES, vibration())
    log = drawn_log(camera, SHIFT, bias=(0.01, -0.005, 0.003))
    return camera, clips.write(folder / "in.mkv", greys, "ffv1"), write_gcsv(folder / "in.gcsv", log)


def test_a_vibration_is_undone_by_the_log_not_by_pictures_and_kept_in_a_motion_file(tmp_path, straighten, shaken):
    camera, clip, log = shaken
    truth = clips.luma(clips.write(tmp_path / "truth.mkv", clips.truth(camera), "ffv1"))
    saved = tmp_path / "motion.json"
    out, record, printed = straighten(clip, "--gyro", log, "--save-motion", saved, "--edges", "fill")
    by_gyro = clips.luma(out)
    out, other, _ = straighten(clip, "--gyro", "off", *clips.KNOWN, "--edges", "fill")
    by_pictures = clips.luma(out)
    assert record["gyro"]["used"] and "gyro" not in other
    assert record["found_by"] == "gyro" and record["readout_ratio"] == pytest.approx(clips.RATIO, abs=0.02)
    assert record["gyro"]["focal_heights"] == pytest.approx(clips.FOCAL / clips.HEIGHT, rel=0.05)  # so few px
    assert f"gyro log ({log.name}) used" in printed and "readout time" in printed
    assert clips.psnr(by_gyro, truth) > clips.psnr(by_pictures, truth) + 3
    out, _, _ = straighten(clip, "--motion", saved, "--edges", "fill")
    assert np.array_equal(by_gyro, clips.luma(out))


def test_a_log_that_the_picture_does_not_follow_is_left_alone_and_named(tmp_path, straighten, shaken):
    _, clip, _ = shaken
    other = write_gcsv(tmp_path / "other.gcsv", drawn_log(hand_held.camera(hand_held.hand(seed=7)), 0.0))
    _, record, printed = straighten(clip, "--gyro", other, *clips.KNOWN)
    assert not record["gyro"]["used"] and record["gyro"]["declined"]["code"] == "gyro-disagrees"
    assert "not used: the picture does not follow the gyro log" in printed


@pytest.fixture(scope="module")
def even(tmp_path_factory):
    """A clip that does not show its readout time, and the log of a camera that moved otherwise."""
    folder = tmp_path_factory.mktemp("even")
    log = write_gcsv(folder / "other.gcsv", drawn_log(hand_held.camera(hand_held.hand(seed=7)), 0.0))
    return clips.write(folder / "in.mkv", clips.moving(30, hand_held.pan(9.0))[1], "ffv1", "gray"), log


def test_a_stabilised_clip_is_copied_where_its_readout_time_would_be_guessed(tmp_path, straighten, even):
    clip, log = even
    _, record, printed = straighten(clip, "--gyro", log, *FOCAL)
    assert (tmp_path / "out.mkv").read_bytes() == clip.read_bytes()
    assert (record["frames"], record["rectified"]) == (30, 0)
    assert [reason["code"] for reason in record["declined"]] == ["gyro-disagrees"]
    assert printed.count("the clip was stabilised") == 1 and "--readout-ms" in printed and "taking" not in printed
    assert "if the gyro log is not this clip's: --gyro off" in printed
    _, record, printed = straighten(clip, "--gyro", "off", *FOCAL)
    assert "gyro" not in record and "--gyro off" not in printed
    assert "gyro-disagrees" not in [reason["code"] for reason in record["declined"]]


@pytest.mark.thorough
def test_a_stabilised_clip_is_straightened_and_smoothed_where_that_is_asked_for(tmp_path, straighten, even):
    clip, log = even
    _, record, printed = straighten(clip, "--gyro", log, "--readout-ms", "20")
    assert record["rectified"] == 30 and "not used: the picture does not follow" in printed
    _, record, _ = straighten(clip, "--gyro", log, "--stabilize", "1", "--start", "0.1")
    assert record["stabilised"] and record["rectified"] == 0


def test_gopros_settings_tell_that_it_stabilised_the_clip(tmp_path, straighten):
    clip = clips.write(tmp_path / "in.mp4", clips.moving(30, hand_held.pan(9.0))[1])
    gpmf.with_settings(clip, gpmf.entry(b"EISE", b"c", b"Y"))
    for flags, rectified in (([], 0), (["--readout-ms", "20"], 30)):
        out, record, printed = straighten(clip, *flags, *FOCAL)
        assert record["rectified"] == rectified
        assert (out.read_bytes() == clip.read_bytes()) is not bool(rectified)
        assert ("its camera stabilised the clip" in printed) is not bool(rectified)


def test_frames_that_are_only_stabilised_are_not_called_unchanged(tmp_path, straighten):
    clip = clips.write(tmp_path / "in.mp4", clips.moving(14)[1])
    gpmf.with_settings(clip, gpmf.entry(b"EISE", b"c", b"Y"))
    _, _, printed = straighten(clip, "--stabilize", "3")
    assert "14 not straightened (its camera stabilised the clip" in printed and "path smoothed" in printed


def test_a_log_that_cannot_be_read_is_named_with_what_to_install(tmp_path, straighten, monkeypatch):
    clip = clips.write(tmp_path / "in.mp4", clips.standing(10), data="bin_data", handler="DJI meta")
    monkeypatch.setattr(gyro_log, "find_spec", lambda name: None)
    lines = [line for line in straighten(clip)[2].splitlines() if "gyro" in line]
    assert len(lines) == 1 and "DJI meta" in lines[0] and "pip install" in lines[0] and "[gyro]" in lines[0]


def gopro_clip(path, camera, greys, packets=2):
    """A clip with its log as a GoPro keeps it, in packets of a second with 400 samples."""
    times = np.arange(400 * packets) / 400
    log = drawn_log(camera)
    rates = np.stack([np.interp(times, log.t_s, axis) for axis in log.rates.T], axis=-1)
    whole = np.round(2000 * rates).astype(int)
    data = [gpmf.device(gpmf.stream(b"GYRO", whole[k : k + 400], 2000)) for k in range(0, len(whole), 400)]
    return clips.write(path, greys, "ffv1", data="bin_data", handler="GoPro MET", packets=data)


def test_a_gopros_log_is_used_without_another_library(tmp_path, straighten, monkeypatch):
    monkeypatch.setitem(sys.modules, "telemetry_parser", None)  # as on Python 3.13
    camera, greys = clips.moving(FRAMES, vibration())
    clip = gopro_clip(tmp_path / "in.mp4", camera, greys)
    _, record, _ = straighten(clip)
    assert record["gyro"]["origin"] == "GoPro" and record["gyro"]["used"]
    assert abs(record["gyro"]["offset_s"] - RATIO_S / 2) < 0.01


def test_a_damaged_log_of_a_gopro_is_named_in_one_line(tmp_path, straighten, capsys):
    damaged = [gpmf.device(gpmf.stream(b"GYRO", np.ones((400, 3)), 0)), b"DEVC\0"]  # a scale of 0
    clip = clips.write(tmp_path / "in.mp4", clips.standing(10), data="bin_data", packets=damaged)
    assert "gyro log (GoPro) not used: it is damaged" in straighten(clip)[2]
    words = [clip, "-o", tmp_path / "out.mp4", "--overwrite", "--gyro", clip]
    refused(capsys, words, 1, "the gyro log in the clip is damaged")


def test_a_log_shorter_than_the_clip_is_left_alone(tmp_path, straighten, shaken):
    camera, clip, _ = shaken
    log = drawn_log(camera)
    kept = (log.t_s > 0) & (log.t_s < 0.48)
    short = write_gcsv(tmp_path / "short.gcsv", type(log)(log.t_s[kept], log.rates[kept], "", log.force))
    _, record, _ = straighten(clip, "--gyro", short, *clips.KNOWN)
    assert record["gyro"]["declined"]["code"] == "gyro-too-short"


def test_the_logs_own_readout_time_is_taken_and_one_late_time_does_not_stretch_the_search(tmp_path, straighten, shaken):
    camera, clip, _ = shaken
    log = write_gcsv(tmp_path / "told.gcsv", drawn_log(camera, SHIFT), readout_ms=19.0)
    log.write_text(log.read_text() + "1e13,0,0,0,0,1000,0\n")  # of 1e-6 s: 116 days later
    _, record, _ = straighten(clip, "--gyro", log)
    assert record["readout_ms"] == pytest.approx(19.0) and record["found_by"] == "gyro log"
    assert record["gyro"]["used"] and abs(record["gyro"]["offset_s"] - SHIFT) < 0.02


def test_a_file_that_is_no_log_is_refused_before_anything_is_written(tmp_path, capsys, shaken):
    _, clip, _ = shaken
    wrong = tmp_path / "notes.txt"
    wrong.write_text("hello")
    refused(capsys, [clip, "-o", tmp_path / "out.mkv", "--gyro", wrong], 1, "cannot read a gyro log from it")
    assert not (tmp_path / "out.mkv").exists()
