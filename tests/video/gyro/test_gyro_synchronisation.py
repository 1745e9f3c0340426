"""A log and a clip: their axes, clocks, focal length and readout ratio, found together; clips that do not follow."""

import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from support import hand_held
from support.gyro_logs import AXES, as_pairs, gyro_log
from unshutter.frames.camera import ROWS
from unshutter.frames.self_calibration import GreyFrame
from unshutter.frames.sequence import CameraMotion
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.readout_time import ReadoutRatio
from unshutter.reasons import Code
from unshutter.video.gyro.alignment import Synchronisation, synchronised
from unshutter.video.gyro.gyro_log import Alignment, GyroLog
from unshutter.video.gyro.synchronisation import GyroRotations

SHIFT, BIAS = 0.137, (0.01, -0.005, 0.003)
FOCAL = hand_held.FOCAL * ROWS / hand_held.HEIGHT


def vibration(seconds=4.0):
    """An engine at 47 and 61 cycles a second, which frames at 30 a second cannot follow, and a slow drift."""

    def waves(strength, hertz, phase):
        return lambda t: strength * np.sin(2 * np.pi * hertz * t + phase) + 2 * np.sin(3 * t + phase)

    return hand_held.log_of(waves(40, 47, 0), waves(25, 61, 1), waves(35, 53, 2), seconds=seconds)


LOGS = {"hand": hand_held.hand, "vibration": vibration}


@cache
def scene(kind, ratio=0.6, frames=45):
    """(camera, pairs) with noise of 0.1 px and strays."""
    camera = hand_held.camera(LOGS[kind](), ratio, frames)
    return camera, as_pairs(hand_held.exact_tracks(camera, noise=0.1, strays=0.03))


def offset_error(found, camera):
    """Of the first row's moment, at the ends of the clip [s]."""
    alignment = found.alignment
    ends = np.array([0.0, (camera.frames - 1) / 30])
    return np.abs(alignment.log_time(ends, np.zeros(2)) - ends - SHIFT).max()


@pytest.mark.parametrize(("kind", "ratio"), [("hand", 0.3), ("hand", 0.9), ("vibration", 0.6)])
def test_axes_clock_focal_length_and_ratio_are_found(kind, ratio):
    camera, pairs = scene(kind, ratio)
    found = synchronised(gyro_log(camera, SHIFT, BIAS), pairs, 1 / 30, [(-1, 1)])
    assert found.reason is None and found.shows_ratio
    assert found.alignment.axes == pytest.approx(AXES, abs=0.02)
    assert offset_error(found, camera) < 0.002
    assert found.alignment.ratio == pytest.approx(ratio, abs=0.02)
    assert found.alignment.focal_px == pytest.approx(FOCAL, rel=0.02)


def test_a_log_on_another_clock_is_found_anywhere_in_it():
    camera, pairs = scene("hand")
    log = gyro_log(camera, 100.0)
    found = synchronised(log, pairs, 1 / 30, [(log.span_s[0], log.span_s[1] - camera.frames / 30)])
    assert found.reason is None
    assert found.alignment.offset_s == pytest.approx(100 + 0.3 / 30, abs=0.002)


def test_what_is_known_is_not_changed():
    camera, pairs = scene("hand")
    found = synchronised(gyro_log(camera), pairs, 1 / 30, [(-1, 1)], ratio=0.5, focal_px=400.0)
    assert found.alignment.ratio == 0.5 and found.alignment.focal_px == 400.0 and not found.shows_ratio


def test_a_camera_that_walks_is_no_other_camera():
    """What translation adds is smooth in time, but larger than what the readout does."""
    camera, pairs = scene("hand")

    def walked(pair, k):
        tracks = pair.tracks
        moved = 1.5 * np.sin(k / 6), 0.8 * np.cos(k / 5)
        grown = (tracks.start - [hand_held.WIDTH / 2, hand_held.HEIGHT / 2]) * 0.01
        return replace(pair, tracks=replace(tracks, end=tracks.end + moved + grown))

    pairs = [walked(pair, k) for k, pair in enumerate(pairs)]
    found = synchronised(gyro_log(camera, SHIFT), pairs, 1 / 30, [(-1, 1)])
    assert found.reason is None and offset_error(found, camera) < 0.004
    assert found.alignment.focal_px == pytest.approx(FOCAL, rel=0.04)


def test_a_clip_that_was_stabilised_does_not_follow_its_log():
    """Every frame turned as a whole, so that the camera's path becomes smooth."""
    camera, pairs = scene("hand")
    path = camera.rotations(np.arange(camera.frames) + 0.3)
    angles = np.pad(rotation_vector(path), ((10, 10), (0, 0)), mode="edge")
    smooth = np.stack([np.convolve(angle, np.full(21, 1 / 21), "valid") for angle in angles.T], axis=-1)
    turned = rotation_matrix(smooth) @ path.transpose(0, 2, 1)
    middle = np.array([hand_held.WIDTH, hand_held.HEIGHT]) / 2 - 0.5

    def moved(at, turn):
        rays = np.concatenate([(at - middle) / hand_held.FOCAL, np.ones((len(at), 1))], axis=1) @ turn.T
        return rays[:, :2] / rays[:, 2:] * hand_held.FOCAL + middle

    def stabilised(pair, k):
        tracks = pair.tracks
        ends = {"start": moved(tracks.start, turned[k]), "end": moved(tracks.end, turned[k + 1])}
        return replace(pair, tracks=replace(tracks, **ends))

    pairs = [stabilised(pair, k) for k, pair in enumerate(pairs)]
    found = synchronised(gyro_log(camera, SHIFT), pairs, 1 / 30, [(-1, 1)])
    assert found.reason is not None and found.reason.code is Code.GYRO_DISAGREES and not found.shows_ratio


def test_a_log_of_another_clip_is_left_alone():
    _, pairs = scene("hand")
    other = gyro_log(hand_held.camera(hand_held.hand(seed=7)))
    found = synchronised(other, pairs, 1 / 30, [(-0.5, 0.5)])
    assert found.reason is not None and found.reason.code is Code.GYRO_DISAGREES


def test_a_camera_that_stood_still_shows_no_offset():
    camera = hand_held.camera(hand_held.still(), frames=30)
    pairs = as_pairs(hand_held.exact_tracks(camera, noise=0.1))
    found = synchronised(gyro_log(camera, noise=0.001), pairs, 1 / 30, [(-0.5, 0.5)])
    assert found.reason is not None and found.reason.code is Code.GYRO_TOO_CALM


# ---- rows ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "most_px"), [("hand", 0.15), ("vibration", 0.3)])
def test_rows_follow_the_gyro(kind, most_px):
    """Of frames of 180 rows; pictures alone miss a vibration by more than twice that."""
    camera = hand_held.camera(LOGS[kind](), frames=30)
    _, greys = hand_held.clip(LOGS[kind](), frames=30)
    found = synchronised(gyro_log(camera, SHIFT, BIAS), scene(kind)[1], 1 / 30, [(-1, 1)])
    frames = [GreyFrame(hand_held.HEIGHT, hand_held.WIDTH, grey, time_s=k / 30) for k, grey in enumerate(greys)]

    def errors(turns):
        finder = CameraMotion(ReadoutRatio(0.6), hand_held.FOCAL, known_rotations=turns)
        at = np.meshgrid(np.linspace(10, 310, 9), np.linspace(10, 170, 17))
        off = []
        for k, motion in enumerate(finder.motions(frames)):
            found = motion.finding("middle").motion.gs_to_rs(*at)
            off.append(np.hypot(*np.subtract(found, camera.motion(k, "middle").gs_to_rs(*at))))
        return float(np.sqrt(np.mean(np.square(off))))

    by_gyro = errors(GyroRotations(gyro_log(camera, SHIFT, BIAS), found.alignment))
    assert by_gyro < most_px
    if kind == "vibration":
        assert errors(None) > 2 * by_gyro


def test_a_log_of_half_an_hour_takes_little_memory():
    camera, pairs = scene("hand")
    log = gyro_log(camera)
    times = np.arange(0, 1800, 0.008)
    rates = np.random.default_rng(1).normal(0, 0.1, (len(times), 3))
    rates[100_000:100_400] = log.rates[::2][:400]
    long = GyroLog(times - times[100_000] + log.t_s[0], rates, "long", np.zeros((0, 4)))
    tracemalloc.start()
    try:
        found = synchronised(long, pairs, 1 / 30, [(long.span_s[0], long.span_s[1] - camera.frames / 30)])
        assert tracemalloc.get_traced_memory()[1] < 120e6
    finally:
        tracemalloc.stop()
    assert found.reason is None and found.alignment.offset_s == pytest.approx(0.3 / 30, abs=0.005)


@pytest.mark.parametrize(
    ("ratio", "error", "shows"),
    [
        (0.03, 0.0, True),  # a fast sensor: 1 ms at 30 frames a second
        (0.01, 0.0, False),  # a global shutter
        (1.02, 0.0, True),  # as long as a frame, within the error
        (1.04, 0.0, False),
        (0.5, 0.019, True),
        (0.5, 0.021, False),
    ],
)
def test_only_a_possible_and_sure_ratio_is_shown(ratio, error, shows):
    alignment = Alignment(np.eye(3), 0.0, 0.0, 0.0, np.zeros(3), FOCAL, ratio, 1 / 30)
    found = Synchronisation(alignment, error, follows=0.95, rotations_px=5.0, ratio_known=False)
    assert found.shows_ratio == shows
    assert not replace(found, ratio_known=True).shows_ratio
    assert not replace(found, follows=0.8).shows_ratio
