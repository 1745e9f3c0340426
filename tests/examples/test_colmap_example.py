"""The COLMAP example: its drawn scene is what it says it is, and its figures come from a real reconstruction."""

from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

import unshutter
from unshutter.motion.rotations import rotation_matrix
from unshutter.motion.warp import validity_mask

EXAMPLE = Path(__file__).parents[2] / "examples" / "colmap"


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(EXAMPLE)
    return __import__("scene")


@pytest.fixture
def compare(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    pytest.importorskip("pycolmap")
    monkeypatch.syspath_prepend(EXAMPLE)
    return __import__("compare")


def test_the_true_motion_gives_the_global_shutter_picture_back(scene: ModuleType) -> None:
    camera = scene.Camera(320, 240, 280.0)
    (frame,) = scene.walk(camera, 1, (2.0, 4.0, 4.0), 3)
    planes = scene.draw_scene(0)
    rs, gs = (
        cv2.GaussianBlur(scene.photograph(planes, camera, frame, rolling), (0, 0), 2) for rolling in (True, False)
    )
    motion = frame.motion(camera)
    straight = unshutter.rectify(rs, motion=motion, edges="keep").array.astype(int)
    seen = cv2.erode(validity_mask(motion).astype(np.uint8), np.ones((15, 15))) > 0
    assert np.abs(straight - gs)[seen].mean() < 1.5
    assert np.abs(rs.astype(int) - gs)[seen].mean() > 5


def test_a_point_of_the_scene_is_where_the_camera_says(scene: ModuleType) -> None:
    """A red spot on the pavement, found in the picture and worked out from place and rotation."""
    camera = scene.Camera(320, 240, 280.0)
    (frame,) = scene.walk(camera, 1, (0.0, 0.0, 0.0), 5)
    planes = scene.draw_scene(0)
    spot = np.array([1.2, 0.0, -1.2])
    col, row = ((spot - planes[2].corner) @ axis * scene.TEXTURE_PX for axis in (planes[2].right, planes[2].down))
    planes[2].texture[:] = 0
    cv2.circle(planes[2].texture, (int(col), int(row)), 20, (255, 0, 0), -1)
    picture = scene.photograph(planes[2:], camera, frame, rolling=False).astype(float)
    weight = np.where(picture[..., 1] < 50, picture[..., 0], 0)
    rows, cols = np.mgrid[:240, :320]
    x, y, z = frame.rotation @ (spot - frame.place)
    assert (weight * cols).sum() / weight.sum() == pytest.approx(280 * x / z + 159.5, abs=0.5)
    assert (weight * rows).sum() / weight.sum() == pytest.approx(280 * y / z + 119.5, abs=0.5)


def test_a_camera_swings_on_without_a_jerk(scene: ModuleType) -> None:
    turning = scene.Turning(np.array([0.01, -0.02, 0.03]), np.array([0.02, 0.03, -0.01]))
    time = np.linspace(-8, 8, 16001)
    turned = turning.at(time)
    rate = np.diff(turned, axis=0) / 1e-3
    within = np.abs(time) < 0.5
    assert turned[within] == pytest.approx(
        np.outer(time, turning.steady)[within] + np.outer(time**2, turning.changing)[within]
    )
    assert np.abs(np.diff(rate, axis=0)).max() < 0.08 * 1e-3  # rad a readout: twice the change, and a little more
    assert np.abs(turned).max() < 0.2


def test_a_camera_that_walks_is_where_it_went(scene: ModuleType) -> None:
    camera, planes = scene.Camera(160, 120, 140.0), scene.draw_scene(0)
    (frame,) = scene.walk(camera, 1, (0.0, 0.0, 0.0), 5, speed_m_s=10.0)
    assert np.linalg.norm(frame.velocity) == pytest.approx(0.3)
    there = scene.Frame(frame.place + 2 * frame.velocity, frame.rotation, frame.turning, 0 * frame.velocity)
    later = scene.photograph(planes, camera, frame, rolling=False, later=2.0)
    assert (later == scene.photograph(planes, camera, there, rolling=False)).all()
    rolling = scene.photograph(planes, camera, frame, rolling=True).astype(int)
    difference = np.abs(rolling - scene.photograph(planes, camera, frame, rolling=False)).mean(axis=(1, 2))
    assert difference[60] < 1  # levels; the middle row's moment is the picture's
    assert difference[:20].min() > 20


def test_the_frames_around_a_picture_say_how_it_moved(compare: ModuleType) -> None:
    camera = compare.Camera(320, 240, 280.0)
    frames = compare.walk(camera, 1, (1.0, 2.0, 1.4), 1)
    walked = compare.Walk(compare.draw_scene(0), camera, frames, 2, 0, "none", False)
    found, true = walked.kinds["sequence"](0).motion, frames[0].motion(camera)
    col, row = np.meshgrid(np.linspace(0, 319, 9), np.linspace(0, 239, 7))
    off, moved = (
        np.hypot(*np.subtract(motion.gs_to_rs(col, row), true.gs_to_rs(col, row))).mean()
        for motion in (found, unshutter.RowMotion.zero(240, 320))
    )
    assert off < moved / 5
    assert moved > 0.8


def test_alignment_finds_a_known_similarity(compare: ModuleType) -> None:
    source = np.random.default_rng(0).normal(size=(6, 3))
    turn = rotation_matrix(np.array([0.3, -0.5, 1.2]))
    scale, found, shift = compare.align(source, 2.5 * source @ turn.T + [1, 2, 3])
    assert scale == pytest.approx(2.5)
    assert found == pytest.approx(turn)
    assert shift == pytest.approx([1, 2, 3])


def test_rectified_pictures_reconstruct_better_than_rolling_ones(compare: ModuleType, tmp_path: Path) -> None:
    camera = compare.Camera(320, 240, 280.0)
    frames = compare.walk(camera, 4, (1.5, 4.0, 3.0), 1)
    walked = compare.Walk(compare.draw_scene(0), camera, frames, 1, 0, "none", False)
    outcomes = []
    for kind in ("rolling_shutter", "true_motion"):
        walked.write(tmp_path, kind)
        outcomes.append(compare.measure(compare.reconstruct(tmp_path / kind, camera), frames))
    rolling, straight = outcomes
    assert straight.registered == 4
    assert straight.reprojection_px < 0.5
    assert straight.place_cm < 2
    assert straight.direction_deg < 1
    assert rolling.registered < 4 or rolling.reprojection_px > 2 * straight.reprojection_px


def test_a_sensor_says_how_the_camera_was_held(compare: ModuleType, scene: ModuleType) -> None:
    """A camera that looks up by 10 degrees, turned clockwise by 4: its right side is lower than its left."""
    up = np.radians(10)
    looking = np.array([[1, 0, 0], [0, np.cos(up), np.sin(up)], [0, -np.sin(up), np.cos(up)]])
    assert (looking @ [0, 0, 1])[1] > 0  # what is straight ahead lies in the lower half of the picture
    turned = rotation_matrix(np.array([0, 0, -np.radians(4)]))  # things seen turn the other way
    (frame,) = scene.walk(scene.Camera(), 1, (0.0, 0.0, 0.0), 0)
    held = scene.Frame(frame.place, turned @ looking, frame.turning, frame.velocity)
    told = compare.attitude(held, scene.Camera(), 1)
    assert told["roll_deg"] == pytest.approx(4, abs=1.2)
    assert told["tilt_deg"] == pytest.approx(10, abs=1.2)
