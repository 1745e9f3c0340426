"""Poses of rows put points where an exact rolling shutter shows them; the middle row's pose alone does not."""

import json
from pathlib import Path
from typing import TypedDict

import numpy as np
import pytest

import unshutter
from support.walking_camera import CENTRE, FOCAL, FPS, HEIGHT, RATIO, WIDTH, WalkingCamera, points
from unshutter import CameraPoses, ScanDirection, UnshutterError, UsageError
from unshutter.reasons import Reason


class Clock(TypedDict):
    readout_ratio: float
    fps: float


CLOCK = Clock(readout_ratio=RATIO, fps=FPS)


def errors_px(poses: CameraPoses, camera: WalkingCamera, by_row: bool = True) -> np.ndarray:
    """How far from its place each point of each picture is projected [px], with its row's pose or the middle one."""
    found = []
    for each in poses.pictures:
        number = int(each.picture.name[:5])
        for point in points():
            seen = camera.seen(number, point)
            if not (0 <= seen[0] <= WIDTH - 1 and 0 <= seen[1] <= HEIGHT - 1):
                continue
            pose = each.at(camera.line_of(*seen) / (len(each.lines) - 1) if by_row else 0.5)
            x, y, z = pose[:3, :3] @ point + pose[:3, 3]
            found.append(np.hypot(*(np.array([x / z, y / z]) * FOCAL + CENTRE - 0.5 - seen)))
    assert len(found) > 15
    return np.array(found)


@pytest.mark.parametrize("readout", ScanDirection)
def test_points_are_where_a_rolling_shutter_shows_them(readout: ScanDirection, tmp_path: Path) -> None:
    camera = WalkingCamera(readout=readout)
    model = camera.write_model(tmp_path / "sparse")
    lines = WIDTH if readout.sideways else HEIGHT
    poses = unshutter.camera_poses(model, camera.write_motions(tmp_path / "motions"), rows=lines, **CLOCK)
    assert np.max(errors_px(poses, camera)) < 0.1
    alone = errors_px(poses, camera, by_row=False)
    assert np.median(alone) > 2.5 and np.max(alone) > 8
    first = poses.pictures[1]
    assert first.scan_direction is readout and first.moved
    assert first.lines[0] == (0 if readout in (ScanDirection.TOP_TO_BOTTOM, ScanDirection.LEFT_TO_RIGHT) else lines - 1)
    assert first.times_s[[0, -1]] == pytest.approx([0.1, 0.1 + RATIO / FPS * (lines - 1) / lines])


def test_a_clips_motion_file_gives_the_same(tmp_path: Path) -> None:
    camera = WalkingCamera()
    model = camera.write_model(tmp_path / "sparse", binary=True)
    poses = unshutter.camera_poses(model, camera.write_clip_motion(tmp_path / "clip.json", 13), rows=HEIGHT)
    assert np.max(errors_px(poses, camera)) < 0.1
    assert poses.readout_s == pytest.approx(0.02)


def test_the_clock_of_a_motion_file_is_the_cameras(tmp_path: Path) -> None:
    camera = WalkingCamera()
    model = camera.write_model(tmp_path / "sparse")
    file = camera.write_clip_motion(tmp_path / "clip.json", 13)
    head = json.loads(file.read_text())
    for interval_s, slowed, readout_s in ((1 / FPS, 1, 0.02), (1.25 / FPS, 1, 0.025), (0.125 / FPS, 8, 0.02)):
        file.write_text(json.dumps(head | {"frame_interval_s": interval_s, "slowed": slowed}))
        poses = unshutter.camera_poses(model, file)
        assert poses.readout_s == pytest.approx(readout_s)
        assert ("24 of 30 frames a second are the camera's" in poses.described()) == (interval_s > 1 / FPS)


def test_pictures_with_bars_are_refused(tmp_path: Path) -> None:
    camera = WalkingCamera()
    model = camera.write_model(tmp_path / "sparse")
    file = camera.write_clip_motion(tmp_path / "clip.json", 13)
    bars = {"picture": {"top": 10, "bottom": HEIGHT - 10, "left": 0, "right": WIDTH}}
    file.write_text(json.dumps(json.loads(file.read_text()) | bars))
    with pytest.raises(UnshutterError, match=rf"have bars.*crop={WIDTH}:{HEIGHT - 20}:0:10\)"):
        unshutter.camera_poses(model, file)


def test_what_only_looks_like_a_turn_is_taken_off(tmp_path: Path) -> None:
    """The tracks of a video take a step sideways for a turn, which would count twice beside the positions."""
    camera = WalkingCamera(apparent=(0.05, 0.25, 0.0))
    model = camera.write_model(tmp_path / "sparse")
    poses = unshutter.camera_poses(model, camera.write_clip_motion(tmp_path / "clip.json", 13), rows=HEIGHT)
    assert np.max(errors_px(poses, camera)) < 0.1
    counted_twice = unshutter.camera_poses(model, camera.write_motions(tmp_path / "motions"), rows=HEIGHT, **CLOCK)
    assert np.max(errors_px(counted_twice, camera)) > 0.8  # where the steps between pictures are not known


def test_another_row_may_be_the_models(tmp_path: Path) -> None:
    camera = WalkingCamera()
    motions = camera.write_motions(tmp_path / "motions")
    model = camera.write_model(tmp_path / "sparse", share=0.0)
    poses = unshutter.camera_poses(model, motions, reference="first", rows=HEIGHT, **CLOCK)
    assert np.max(errors_px(poses, camera)) < 0.1
    assert np.allclose(poses.pictures[2].at(0.0), poses.pictures[2].picture.world_to_camera)
    assert np.max(errors_px(unshutter.camera_poses(model, motions, rows=HEIGHT, **CLOCK), camera)) > 3


def test_a_wrong_focal_length_of_a_motion_does_not_change_how_far_it_moves_a_picture(tmp_path: Path) -> None:
    """The motion of a video is found with a usual focal length if the video does not show it."""
    camera = WalkingCamera(speed=0.0)
    model = camera.write_model(tmp_path / "sparse")
    motions = camera.write_motions(tmp_path / "motions")
    for file in motions.iterdir():
        motion = unshutter.Motion.load(file)
        assert isinstance(motion, unshutter.RotationMotion)
        file.unlink()
        turns = motion.rotations * [0.8, 0.8, 1.0]
        unshutter.RotationMotion(WIDTH, turns, FOCAL / 0.8).save(file)
    poses = unshutter.camera_poses(model, motions, rows=HEIGHT, **CLOCK)
    assert np.max(errors_px(poses, camera)) < 0.1


def test_a_single_picture_stays_at_its_place(tmp_path: Path) -> None:
    camera = WalkingCamera(numbers=(4,), speed=0.0)
    model = camera.write_model(tmp_path / "sparse")
    poses = unshutter.camera_poses(model, camera.write_motions(tmp_path / "motions"), rows=HEIGHT, **CLOCK)
    assert not poses.pictures[0].moved
    assert "unknown for 1, which have no neighbours within a second" in poses.described()
    assert np.max(errors_px(poses, camera)) < 0.1


def test_pictures_without_a_motion_are_left_out(tmp_path: Path) -> None:
    camera = WalkingCamera()
    model = camera.write_model(tmp_path / "sparse")
    motions = camera.write_motions(tmp_path / "motions")
    (motions / "00003.json").unlink()
    zero = unshutter.Finding(unshutter.RowMotion.zero(HEIGHT, WIDTH), reason=Reason.stated("too dark"))
    zero.save(motions / "00006.json")
    poses = unshutter.camera_poses(model, motions, **CLOCK)
    assert [each.picture.name for each in poses.pictures] == ["00000.png", "00009.png", "00012.png"]
    assert "; 2 left out (1 no motion file, 1 too dark); not refined" in poses.described()
    for file in motions.iterdir():
        file.unlink()
    zero.save(motions / "00006.json")
    with pytest.raises(UnshutterError, match=r"no picture of .* has a motion \(4: no motion file\)"):
        unshutter.camera_poses(model, motions, **CLOCK)


def test_what_does_not_fit_is_told_in_a_line(tmp_path: Path) -> None:
    camera = WalkingCamera()
    model = camera.write_model(tmp_path / "sparse")
    motions = camera.write_motions(tmp_path / "motions")
    with pytest.raises(UsageError, match="give readout_ratio and fps"):
        unshutter.camera_poses(model, motions)
    with pytest.raises(UsageError, match="give both readout_ratio and fps, or neither"):
        unshutter.camera_poses(model, motions, fps=30)
    short = camera.write_clip_motion(tmp_path / "clip.json", 9)
    with pytest.raises(UnshutterError, match=r"has 9 frames, and 00009\.png would be number 9, counted from 0"):
        unshutter.camera_poses(model, short)
    with pytest.raises(UsageError, match="leave out readout_ratio and fps"):
        unshutter.camera_poses(model, short, **CLOCK)
    with pytest.raises(UnshutterError, match="cannot read motion file"):
        unshutter.camera_poses(model, tmp_path / "none.json")
    with pytest.raises(UnshutterError, match="has no motion files"):
        unshutter.camera_poses(model, model, **CLOCK)
    text = (model / "cameras.txt").read_text().replace("640 480", "480 640")
    (model / "cameras.txt").write_text(text)
    with pytest.raises(UnshutterError, match=r"00000.png of 480x640 px: .*ffmpeg -noautorotate"):
        unshutter.camera_poses(model, motions, **CLOCK)
    (model / "images.txt").write_text("1 1 0 0 0 0 0 0 7 house.png\n\n")
    with pytest.raises(UnshutterError, match=r"house\.png has no number in its name"):
        unshutter.camera_poses(model, motions, **CLOCK)
