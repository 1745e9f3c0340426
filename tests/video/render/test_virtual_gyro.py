"""The gyro log that a clip's frames stand in for: what Gyroflow and unshutter read from it, and when there is none."""

from importlib import import_module

import numpy as np
import pytest

import unshutter
from support import clips
from support.gyro_logs import AXES, gyro_log
from unshutter.video.gyro.gyro_log import can_parse, log_of_file

FRAMES = 24
# Gyroflow's number of a readout direction, and the axes in which frames were read out (columns) in the stored picture's
READ = {
    "top-to-bottom": (0, np.eye(3)),
    "bottom-to-top": (1, np.diag([-1, -1, 1])),
    "right-to-left": (3, np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])),
}


def head_of(log):
    lines = log.read_text().splitlines()
    return dict(line.split(",") for line in lines[1 : lines.index("t,gx,gy,gz")])


@pytest.mark.parametrize("direction", READ)
def test_the_log_has_the_rates_of_the_camera_about_the_axes_of_the_stored_picture(tmp_path, direction):
    camera, greys = clips.moving(FRAMES)
    number, axes = READ[direction]
    stored = [np.rot90(grey, -unshutter.ScanDirection(direction).quarter_turns) for grey in greys]
    clip, log = clips.write(tmp_path / "in.mkv", stored, "ffv1", "gray"), tmp_path / "a.gcsv"
    known = {"readout_ratio": clips.RATIO, "focal_px": clips.FOCAL, "readout": direction}
    outcome = unshutter.rectify_clip(clip, tmp_path / "out.mkv", save_gyro=log, **known)
    assert outcome.as_json()["virtual_gyro"] == {"written": True, "frames_unknown": 0}
    head = head_of(log)
    assert (head["orientation"], head["frame_readout_direction"]) == ("yxz", str(number))
    assert float(head["frame_readout_time"]) == 1000 * clips.RATIO / clips.FPS and "165 px" in head["lens_info"]
    assert log.read_text().index("t,gx") < 500  # of which telemetry-parser reads the readout time
    written, true = log_of_file(log), gyro_log(camera)
    assert written.span_s[0] == 0 and written.rate_hz == pytest.approx(1000)
    times = np.arange(0.02, (FRAMES - 1) / clips.FPS, 0.004)
    turned = [np.interp(times + clips.RATIO / clips.FPS / 2, true.t_s, axis) for axis in true.rates.T]
    off = np.stack([np.interp(times, written.t_s, axis) for axis in written.rates.T]) - axes @ AXES @ turned
    assert np.sqrt((off**2).mean()) < 0.03 * np.sqrt(np.mean(np.square(turned)))


def test_a_clip_is_straightened_by_its_own_log_as_by_its_frames(tmp_path, straighten):
    camera, greys = clips.moving(32)
    clip, log = clips.write(tmp_path / "in.mkv", greys, "ffv1"), tmp_path / "a.gcsv"
    truth = clips.luma(clips.write(tmp_path / "truth.mkv", clips.truth(camera), "ffv1"))
    by_frames = clips.psnr(clips.luma(straighten(clip, *clips.KNOWN, "--save-gyro", log)[0]), truth)
    out, record, _ = straighten(clip, "--focal-px", clips.FOCAL, "--gyro", log)
    assert record["gyro"]["used"] and abs(record["gyro"]["offset_s"]) < 0.001
    assert record["readout_ms"] == pytest.approx(20) and clips.psnr(clips.luma(out), truth) > by_frames - 0.5
    if can_parse():  # as Gyroflow does, whose axes are up, left and backward
        samples = import_module("telemetry_parser").Parser(str(log)).normalized_imu()
        rates = np.radians([sample["gyro"] for sample in samples])
        assert np.allclose(rates, -log_of_file(log).rates[:, [1, 0, 2]]) and samples[500]["timestamp_ms"] == 500


def test_at_a_cut_the_rate_is_0_and_a_part_has_the_clips_time(tmp_path, straighten):
    _, greys = clips.moving(26)
    scenes = [*greys[:13], *(255 - grey[::-1, ::-1] for grey in greys[13:])]
    clip, log = clips.write(tmp_path / "in.mkv", scenes, "ffv1"), tmp_path / "a.gcsv"
    _, record, printed = straighten(clip, *clips.KNOWN, "--save-gyro", log, "--start", "0.1")
    assert record["virtual_gyro"]["frames_unknown"] == 1 and "unknown before 1 frame: the gyro log has 0" in printed
    rates = log_of_file(log).rates
    gap = round(1000 * 12.5 / clips.FPS)
    assert not rates[gap].any() and not rates[:80].any() and rates[110 : gap - 20].all()


@pytest.mark.parametrize(
    ("frames", "flags", "why"),
    [(3, [], "does not show its readout time"), (1, clips.KNOWN, "do not show how the camera moved")],
)
def test_a_clip_too_short_for_its_readout_time_or_for_a_turn_gives_no_log(tmp_path, straighten, frames, flags, why):
    clip, log = clips.write(tmp_path / "in.mkv", clips.moving(frames)[1], "ffv1"), tmp_path / "a.gcsv"
    _, record, printed = straighten(clip, *flags, "--save-gyro", log)
    assert not record["virtual_gyro"]["written"] and not log.exists()
    assert [why in line for line in printed.splitlines() if "no gyro log written: " in line] == [True]
