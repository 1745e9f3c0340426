"""Clips with gyro logs: what the log is found to be, what is done by it, and what is left to the pictures."""

import json

import numpy as np
import pytest

from support import clips, hand_held
from support.gyro_logs import gyro_log, write_gcsv
from unshutter.cli import main

FRAMES, SHIFT = 40, 0.137


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
    log = gyro_log(camera, SHIFT, bias=(0.01, -0.005, 0.003))
    return camera, clips.write(folder / "in.mkv", greys, "ffv1"), write_gcsv(folder / "in.gcsv", log)


def straighten(clip, folder, capsys, *flags):
    """(luma of the result, what the log says, what was printed)."""
    out, log = folder / "out.mkv", folder / "log.jsonl"
    assert main(["video", str(clip), "-o", str(out), "--overwrite", "--json-log", str(log), *flags]) == 0
    return clips.luma(out), json.loads(log.read_text().splitlines()[-1]), capsys.readouterr().err


def test_a_vibration_is_undone_by_the_log_and_not_by_the_pictures(tmp_path, capsys, shaken):
    camera, clip, log = shaken
    truth = clips.luma(clips.write(tmp_path / "truth.mkv", clips.truth(camera), "ffv1"))
    by_gyro, record, printed = straighten(clip, tmp_path, capsys, "--gyro", str(log))
    by_pictures, other, _ = straighten(clip, tmp_path, capsys, "--gyro", "off", "--readout-ratio", str(clips.RATIO))
    assert record["gyro"]["used"] and "gyro" not in other
    assert record["found_by"] == "gyro" and record["readout_ratio"] == pytest.approx(clips.RATIO, abs=0.02)
    assert record["gyro"]["focal_heights"] == pytest.approx(clips.FOCAL / clips.HEIGHT, rel=0.05)  # so few px
    assert f"gyro log ({log.name}) used" in printed and "readout time" in printed
    assert clips.psnr(by_gyro, truth) > clips.psnr(by_pictures, truth) + 3


def test_a_motion_file_keeps_the_vibration(tmp_path, capsys, shaken):
    _, clip, log = shaken
    saved = tmp_path / "motion.json"
    direct, _, _ = straighten(clip, tmp_path, capsys, "--gyro", str(log), "--save-motion", str(saved))
    again, _, _ = straighten(clip, tmp_path, capsys, "--motion", str(saved))
    assert clips.psnr(direct, again, border=2) > 45


def test_a_log_that_the_picture_does_not_follow_is_left_alone_and_named(tmp_path, capsys, shaken):
    _, clip, _ = shaken
    other = write_gcsv(tmp_path / "other.gcsv", gyro_log(hand_held.camera(hand_held.hand(seed=7)), 0.0))
    _, record, printed = straighten(clip, tmp_path, capsys, "--gyro", str(other), "--readout-ratio", "0.6")
    assert not record["gyro"]["used"] and record["gyro"]["declined"]["code"] == "gyro-disagrees"
    assert "not used: the picture does not follow the gyro log" in printed


def test_a_log_shorter_than_the_clip_is_left_alone(tmp_path, capsys, shaken):
    camera, clip, _ = shaken
    log = gyro_log(camera)
    kept = (log.t_s > 0) & (log.t_s < 0.6)
    short = write_gcsv(tmp_path / "short.gcsv", type(log)(log.t_s[kept], log.rates[kept], "", log.force))
    _, record, _ = straighten(clip, tmp_path, capsys, "--gyro", str(short), "--readout-ratio", "0.6")
    assert record["gyro"]["declined"]["code"] == "gyro-too-short"


def test_the_logs_own_readout_time_is_taken(tmp_path, capsys, shaken):
    camera, clip, _ = shaken
    log = write_gcsv(tmp_path / "told.gcsv", gyro_log(camera, SHIFT), readout_ms=19.0)
    _, record, _ = straighten(clip, tmp_path, capsys, "--gyro", str(log))
    assert record["readout_ms"] == pytest.approx(19.0) and record["found_by"] == "gyro log"


def test_a_file_that_is_no_log_is_refused_before_anything_is_written(tmp_path, capsys, shaken):
    _, clip, _ = shaken
    wrong = tmp_path / "notes.txt"
    wrong.write_text("hello")
    assert main(["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--gyro", str(wrong)]) == 1
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1 and "no gyro log that can be read" in printed
    assert not (tmp_path / "out.mkv").exists()
