"""Poses of rows in panoramas of real places: the exact camera, real pictures, and the motion that unshutter finds."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support import clips
from support.covering import thorough
from support.turning_poses import errors_px, write_model
from unshutter_lab.synthesis.panorama import Camera, Place
from unshutter_lab.synthesis.sequences import RotatingCamera

FRAMES = range(3, 15, 2)
CAMERA = Camera.of_view(240, 320, 62.0, yaw=30, tilt=5)


@pytest.mark.parametrize("place", ["hansaplatz", thorough("leadenhall_market"), thorough("palermo_sidewalk")])
def test_points_of_a_place_are_projected_where_their_rows_saw_them(place: str, tmp_path: Path) -> None:
    seen = Place.load(Path(str(files("unshutter_lab"))) / "places" / place)
    size = {"height": CAMERA.height, "width": CAMERA.width, "focal_px": CAMERA.focal_px}
    rotating = RotatingCamera(clips.shaken(), 0.05, 18, clips.FPS, clips.RATIO, **size)
    rotations = [rotating.rotations(rotating.row_times(frame)) for frame in range(rotating.frames)]
    frames = [seen.seen(CAMERA, each.transpose(0, 2, 1)) for each in rotations]
    motions = tmp_path / "frames"
    motions.mkdir()
    found = unshutter.estimate_frames(frames, readout_ratio=clips.RATIO, focal_px=CAMERA.focal_px)
    for number, motion in enumerate(found):
        motion.save(motions / f"{number:05}.json")
    poses = unshutter.camera_poses(
        write_model(rotating, FRAMES, tmp_path / "sparse"),
        motions,
        rows=CAMERA.height,
        readout_ratio=clips.RATIO,
        fps=clips.FPS,
    )
    assert len(poses.pictures) == len(FRAMES)
    by_row = errors_px(rotating, poses, True)
    alone = errors_px(rotating, poses, False)
    assert np.sqrt(np.mean(by_row**2)) < 0.1
    assert np.sqrt(np.mean(alone**2)) > 1
