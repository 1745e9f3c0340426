"""flight: the motion of a drone's photo from its metadata, compared with flights that the tests render."""

import cv2
import numpy as np
import pytest

import unshutter
from support.drawn_photos import drawn, textured
from support.tagged_files import jpeg_of_drone
from unshutter.estimators.base import View
from unshutter.estimators.find import find_motion
from unshutter.estimators.flight import flight_motion
from unshutter.estimators.methods.none import DoNothing
from unshutter.estimators.register import load
from unshutter.options import Camera
from unshutter.photo import Photo
from unshutter.reasons import Cause, Code

HEIGHT, WIDTH, FOCAL, READOUT_S = 150, 200, 180.0, 0.08
_FORM = (
    'drone-dji:RelativeAltitude="{}" drone-dji:GimbalYawDegree="{}" drone-dji:FlightXSpeed="{}" '
    'drone-dji:FlightYSpeed="{}" drone-dji:FlightZSpeed="{}" drone-dji:GimbalRollDegree="{{}}" '
    'drone-dji:GimbalPitchDegree="{{}}">'
)


def rotation(yaw, pitch, roll):
    """[3, 3] (north, east, down) of the gimbal's directions ahead, right and down: about down, right, ahead."""
    y, p, r = np.radians([yaw, pitch, roll])
    about_down = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    about_right = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    about_ahead = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    return about_down @ about_right @ about_ahead


def on_the_ground(col, row, velocity, altitude, angles, at_s):
    """(north, east) [m] of the places on flat ground that pixels see at moments [s]."""
    in_camera = np.stack(
        [np.ones_like(col), (col - (WIDTH - 1) / 2) / FOCAL, (row - (HEIGHT - 1) / 2) / FOCAL], axis=-1
    )
    rays = in_camera @ rotation(*angles).T
    camera = np.asarray(velocity) * np.asarray(at_s)[..., None]
    reach = (altitude - camera[..., 2]) / rays[..., 2]
    return (camera + reach[..., None] * rays)[..., :2]


def rendered(velocity, altitude, angles, readout_s):
    """The picture of a drone that flies: each row from where the drone then is."""
    col, row = np.meshgrid(np.arange(float(WIDTH)), np.arange(float(HEIGHT)))
    place = on_the_ground(col, row, velocity, altitude, angles, row / HEIGHT * readout_s)
    ground = textured(600, 600)
    at = (place * 300 / altitude + 300).astype(np.float32)
    return cv2.remap(ground, at[..., 1], at[..., 0], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def photo_of(velocity, altitude, angles, pixels=None):
    yaw, pitch, roll = angles
    form = _FORM.format(f"+{altitude}", yaw, *(f"{each:+.1f}" for each in velocity))
    return jpeg_of_drone(drawn(HEIGHT, WIDTH) if pixels is None else pixels, f"{roll:+.2f}", f"{pitch:.2f}", form)


def motion_of(data, **known):
    return flight_motion(View(Photo.from_bytes(data), Camera(**known)))


@pytest.mark.parametrize(
    ("velocity", "angles"),
    [
        ((12.0, 0.0, 0.0), (0, -90, 0)),
        ((0.0, 9.0, 0.0), (0, -90, 0)),
        ((8.0, -5.0, 0.0), (130.5, -90, 0)),
        ((8.0, -5.0, 0.0), (-49.5, -90, 180)),  # the same attitude in other angles
        ((-7.0, 6.0, 0.0), (-70, -88, 0)),
    ],
)
def test_rows_see_the_ground_where_a_rendered_flight_puts_it(velocity, angles):
    motion = motion_of(photo_of(velocity, 60, angles), readout_ms=1000 * READOUT_S, focal_px=FOCAL)
    row = np.linspace(0, HEIGHT - 1, 7)[:, None]
    col = np.linspace(0, WIDTH - 1, 9)[None, :] + 0 * row
    row = row + 0 * col
    gs_col, gs_row = motion.rs_to_gs(col, row)
    seen = on_the_ground(col, row, velocity, 60, angles, row / HEIGHT * READOUT_S)
    gs_sees = on_the_ground(gs_col, gs_row, velocity, 60, angles, np.zeros_like(gs_col))
    apart = np.hypot(*np.moveaxis(gs_sees - seen, -1, 0)) * FOCAL / 60  # px
    assert motion.largest_px > 1.5 and apart.max() < 0.1
    assert motion.confidence > 0.95


def test_a_rendered_photo_becomes_what_a_global_shutter_sees():
    velocity, angles = (10.0, 9.0, 0.0), (20, -90, 0)
    data = photo_of(velocity, 40, angles, rendered(velocity, 40, angles, READOUT_S))
    truth = rendered(velocity, 40, angles, 0.0)
    result = unshutter.rectified(data, readout_ms=1000 * READOUT_S, focal_px=FOCAL, edges="fill")
    assert result.changed and result.motion.estimator == "flight"
    pictures = result.original.pixels, result.pixels
    before, after = (np.abs(each.astype(float) - truth)[15:-15, 15:-15].mean() for each in pictures)
    assert after < before / 4


def test_a_drone_that_hovers_took_a_photo_that_is_left_alone():
    data = photo_of((0.0, -0.1, 0.0), 60, (0, -30, 0))
    result = unshutter.rectified(data)
    assert not result.changed and result.verdict.cause is Cause.NO_MOTION
    assert result.motion.reason.code is Code.HOVERED and result.reason == "the drone hovered"


@pytest.mark.parametrize(
    ("velocity", "altitude", "angles"),
    [
        ((9.0, 0.0, 0.0), 60, (0, -45, 0)),  # far and near pass at other speeds
        ((9.0, 0.0, 0.0), 2, (0, -90, 0)),
        ((90.0, 0.0, 0.0), 60, (0, -90, 0)),
    ],
)
def test_what_does_not_show_the_motion_is_left_to_the_estimator(velocity, altitude, angles):
    assert motion_of(photo_of(velocity, altitude, angles), focal_px=FOCAL) is None


def test_without_a_focal_length_nothing_is_known_of_a_flight():
    assert motion_of(photo_of((9.0, 0.0, 0.0), 60, (0, -90, 0)), readout_ms=30) is None


def test_a_guessed_readout_time_makes_a_large_motion_unsure():
    far = photo_of((15.0, 0.0, 0.0), 20, (0, -90, 0))
    assert motion_of(far, focal_px=FOCAL).confidence < 0.3 < motion_of(far, focal_px=FOCAL, readout_ms=60).confidence


def test_the_method_that_does_nothing_does_nothing():
    view = View(Photo.from_bytes(photo_of((9.0, 0.0, 0.0), 60, (0, -90, 0))), Camera(focal_px=FOCAL, readout_ms=80))
    assert isinstance(load("none"), DoNothing) and find_motion(load("none"), view).is_zero
