"""Gyro logs: what can be one, how far a gyro turned, and the files that they are read from."""

import numpy as np
import pytest

from support import hand_held
from support.gyro_logs import gyro_log, write_gcsv
from unshutter.errors import UnshutterError
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.video.gyro.gyro_log import GRAVITY, GyroLog, chained, log_of_file

TIMES = np.arange(0, 2, 0.01)
NONE = np.zeros((0, 4))


def test_turns_are_chained_in_their_order():
    turns = rotation_matrix(np.random.default_rng(0).normal(0, 0.3, (23, 3)))
    whole = np.eye(3)
    for turn, answer in zip(turns, chained(turns), strict=True):
        whole = turn @ whole
        assert answer == pytest.approx(whole)


def test_a_device_that_turns_evenly_turns_the_scene_back():
    log = GyroLog(TIMES, np.tile([0.0, 0.5, 0.0], (len(TIMES), 1)), "", NONE)
    between = log.rotations(np.array([1.2])) @ log.rotations(np.array([0.2])).swapaxes(-1, -2)
    assert rotation_vector(between)[0] == pytest.approx([0, -0.5, 0])
    assert log.angles(np.array([1.0]))[0] == pytest.approx([0, 0.5, 0])


def test_late_samples_are_put_in_order_and_gaps_are_known():
    swapped = TIMES.copy()
    swapped[[50, 51]] = swapped[[51, 50]]
    assert (np.diff(GyroLog(swapped, np.zeros((200, 3)), "", NONE).t_s) > 0).all()
    kept = (TIMES < 0.8) | (TIMES > 1.2)
    log = GyroLog(TIMES[kept], np.zeros((kept.sum(), 3)), "", NONE)
    assert log.covers(0.1, 0.7) and not log.covers(0.5, 1.5) and not log.covers(0.1, 3)


@pytest.mark.parametrize(
    ("times", "rates", "complaint"),
    [
        (TIMES[:5], np.zeros((5, 3)), "only 5 gyro samples"),
        (TIMES, np.full((200, 3), np.nan), "only 0 gyro samples"),
        (TIMES[::-1], np.zeros((200, 3)), "do not increase"),
        (TIMES * 10, np.zeros((200, 3)), "fewer than 20 gyro samples a second"),
        (TIMES, np.full((200, 3), 500.0), "is their unit right"),
        (TIMES, np.zeros((199, 3)), "200 times but rates of shape"),
    ],
)
def test_what_cannot_be_a_log_is_refused(times, rates, complaint):
    with pytest.raises(UnshutterError, match=complaint):
        GyroLog(times, rates, "log", NONE)


def test_gyroflows_logs_are_read_with_their_units(tmp_path):
    log = gyro_log(hand_held.camera(hand_held.hand()))
    read = log_of_file(write_gcsv(tmp_path / "a.gcsv", log, readout_ms=-16.5))
    assert read.t_s == pytest.approx(log.t_s, abs=1e-6) and read.rates == pytest.approx(log.rates, abs=2e-4)
    assert read.readout_time.ms == 16.5 and not read.on_clip_clock
    assert read.force[0, 1:] == pytest.approx([0, GRAVITY, 0])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("GYROFLOW IMU LOG\nversion,1\n", "no line names the log's columns"),
        ("GYROFLOW IMU LOG\nt,gx,gy,gz\n0,1,2,x\n", "not numbers"),
        ("GYROFLOW IMU LOG\ntscale,fast\nt,gx,gy,gz\n0,1,2,3\n", "not numbers"),
        ("GYROFLOW IMU LOG\nt,gx,gy,gz\n0,1,2,3\n", "only 1 gyro samples"),
        ("hello", "cannot read a gyro log from it"),
        ("", "cannot read a gyro log from it"),
    ],
)
def test_files_that_are_no_logs_are_refused_in_a_line(tmp_path, text, complaint):
    path = tmp_path / "a.gcsv"
    path.write_text(text)
    with pytest.raises(UnshutterError, match=complaint) as error:
        log_of_file(path)
    assert "a.gcsv" in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(UnshutterError, match="cannot read gyro log"):
        log_of_file(tmp_path / "missing.gcsv")


def test_damaged_numbers_are_left_out_of_a_log_without_a_warning(tmp_path):
    log = gyro_log(hand_held.camera(hand_held.hand()))
    path = write_gcsv(tmp_path / "a.gcsv", log, readout_ms="nan")
    whole = path.read_text()
    path.write_text(whole + "1e305,1,1,1,0,1,0\n1e12,1e300,1,1,0,1e300,0\n")  # of 1e-6 s
    read = log_of_file(path)
    assert read.readout_time is None and read.t_s == pytest.approx(log.t_s, abs=1e-6)
    path.write_text(whole.replace("tscale,0.000001", "tscale,1e308"))
    with pytest.raises(UnshutterError, match="only 0 gyro samples"):
        log_of_file(path)


def test_stretches_without_gaps():
    times = np.concatenate([TIMES, TIMES + 10, [1e5]])
    log = GyroLog(times, np.zeros((len(times), 3)), "log", NONE)
    assert log.stretches == [(0, 1.99), (10, 11.99), (1e5, 1e5)]
    assert log.between(9, 20).span_s == (10, 11.99) and log.between(0, 0.05).span_s == log.span_s
