"""Sequences with known motion: frames, and the motion that undoes them, are of one camera."""

import numpy as np
import pytest

from support.drawn_photos import textured
from support.hand_held import FOCAL, HEIGHT, WIDTH, camera, hand, pan, still
from unshutter import UnshutterError, UsageError, rectify
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera


def test_a_camera_that_turns_left_moves_the_scene_to_the_right():
    motion = camera(pan(12.0), ratio=0.5).motion(3)
    readout_s = 0.5 / 30 * (HEIGHT - 1) / HEIGHT
    assert motion.tx_px[-1] == pytest.approx(FOCAL * np.tan(np.radians(12) * readout_s), rel=1e-6)
    assert np.abs(motion.rotations[:, [0, 2]]).max() < 1e-9


def test_a_camera_that_tilts_up_moves_the_scene_down():
    t = np.arange(0, 2, 0.01)
    log = RotationLog(t, 0 * t, 0 * t, 0 * t + 0.2)
    col, row = camera(log).motion(0).gs_to_rs(np.array([WIDTH / 2]), np.array([HEIGHT / 2]))
    assert row[0] > HEIGHT / 2 + 0.2 and col[0] == pytest.approx(WIDTH / 2)


def test_the_true_motion_undoes_a_frame():
    photo = textured(2 * HEIGHT, 2 * WIDTH)
    moving = camera(hand(), ratio=0.9, frames=12)
    (rs,) = [frame for k, frame in enumerate(moving.rendered(photo)) if k == 7]
    # the same camera at the moment of that frame's first row, without a readout
    at_once = camera(hand(), ratio=0.0, frames=12)
    (gs,) = [frame for k, frame in enumerate(at_once.rendered(photo)) if k == 7]
    undone = rectify(rs, motion=moving.motion(7), edges="keep").array
    inner = (slice(20, -20), slice(20, -20))
    before, after = (np.abs(picture[inner].astype(float) - gs[inner]).mean() for picture in (rs, undone))
    assert after < 0.3 * before and after < 2


def test_a_still_camera_sees_the_same_in_every_frame_but_for_noise():
    photo = textured(HEIGHT, WIDTH)
    first, second = camera(still(), frames=2).rendered(photo)
    assert np.array_equal(first, second)
    first, second = camera(still(), frames=2).rendered(photo, noise=3, seed=1)
    assert np.std(first.astype(float) - second) == pytest.approx(3 * np.sqrt(2), rel=0.1)


def test_smoothing_keeps_slow_turns_and_takes_jitter_away():
    t = np.arange(0, 4, 1 / 120)
    slow, jitter = np.sin(2 * np.pi * 0.5 * t), 0.3 * np.sin(2 * np.pi * 40 * t)
    log = RotationLog(t, slow + jitter, slow, slow).smoothed(0.03)
    inner = slice(60, -60)
    assert np.abs(log.yaw_rad_s - slow)[inner].max() < 0.02


def test_rotations_multiply_where_angles_would_not_add():
    t = np.linspace(0, 1, 101)
    turning = np.pi / 2
    log = RotationLog(t, np.where(t < 0.5, 2 * turning, 0), np.where(t >= 0.5, 2 * turning, 0), 0 * t)
    (end,) = log.rotations(np.array([1.0]))
    # a quarter turn about y, then one about z: what lay ahead lies to the right, then below
    assert end @ [0, 0, 1] == pytest.approx([0, 1, 0], abs=0.05)


@pytest.mark.parametrize("wrong", [{"frames": 0}, {"fps": 0.0}, {"readout_ratio": 1.5}, {"focal_px": -1.0}])
def test_numbers_that_cannot_be_are_refused(wrong):
    given = {"frames": 5, "fps": 30.0, "readout_ratio": 0.5, "focal_px": FOCAL, **wrong}
    with pytest.raises(UsageError):
        RotatingCamera(still(), 0.0, height=HEIGHT, width=WIDTH, **given)


def test_a_log_that_is_too_short_or_turns_too_far_is_refused():
    with pytest.raises(UnshutterError, match="ends before"):
        camera(still(seconds=1.0), frames=60)
    with pytest.raises(UnshutterError, match="turns away"):
        camera(pan(80.0), frames=60)
    with pytest.raises(UnshutterError, match="everywhere"):
        RotatingCamera.drawn(
            np.random.default_rng(0), pan(80.0), 60, tries=3, readout_ratio=0.5, height=9, width=9, focal_px=9.0
        )
