"""From a video to poses: with the motion that unshutter finds in the frames, and the true pose of their middle rows."""

from pathlib import Path

import numpy as np

import unshutter
from support import clips
from support.turning_poses import errors_px, write_model
from unshutter.cli import main

FRAMES = range(3, 21, 3)


def test_the_motion_found_in_a_video_gives_the_poses_of_its_rows(tmp_path: Path) -> None:
    camera, frames = clips.moving(24)
    video = clips.write(tmp_path / "video.mp4", frames, "libx264", options={"crf": "12"})
    motions = tmp_path / "video.json"
    words = ["video", str(video), *clips.KNOWN, "-o", str(tmp_path / "straight.mp4"), "--save-motion", str(motions)]
    assert main(words) == 0
    model = write_model(camera, FRAMES, tmp_path / "sparse")
    poses = unshutter.camera_poses(model, motions, rows=clips.HEIGHT)
    assert len(poses.pictures) == len(FRAMES)
    by_row, alone = (errors_px(camera, poses, each) for each in (True, False))
    assert np.sqrt(np.mean(by_row**2)) < 0.1 * np.sqrt(np.mean(alone**2))
