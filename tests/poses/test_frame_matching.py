"""Pictures of a model are matched to the frames of a clip although their names mislead, or refused."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.covering import thorough
from support.walking_camera import WalkingCamera
from unshutter import UnshutterError
from unshutter.motion.rotations import rotation_matrix
from unshutter.poses.frame_matching import match_frames

CAMERA = WalkingCamera(numbers=tuple(range(0, 90, 3)), apparent=(0.02, 0.1, 0.0))
OTHER = WalkingCamera(numbers=CAMERA.numbers, swing=-0.08)


def renamed(camera: WalkingCamera, folder: Path, name: str) -> Path:
    """A model whose pictures are named by their order."""
    model = camera.write_model(folder)
    text = (model / "images.txt").read_text()
    for order, number in enumerate(camera.numbers):
        text = text.replace(f" 7 {number:05}.png", f" 7 {name.format(order + 1)}")
    (model / "images.txt").write_text(text)
    return model


def test_thinned_and_renumbered_pictures_get_the_poses_of_their_frames(tmp_path: Path) -> None:
    clip = CAMERA.write_clip_motion(tmp_path / "clip.json", 90)
    named = unshutter.camera_poses(CAMERA.write_model(tmp_path / "named"), clip)
    assert "names" not in named.described()
    model = renamed(CAMERA, tmp_path / "renamed", "frame_{:04}.png")
    poses = unshutter.camera_poses(model, clip, first_number=1)
    assert "the pictures show frames 0, 3, 6 ... 87, as the camera turned, whatever their names" in poses.described()
    for one, other in zip(named.pictures, poses.pictures, strict=True):
        assert np.allclose(one.world_to_camera, other.world_to_camera)
        assert np.allclose(one.times_s, other.times_s)


def test_pictures_of_another_clip_are_refused(tmp_path: Path) -> None:
    clip = OTHER.write_clip_motion(tmp_path / "clip.json", 90)
    with pytest.raises(UnshutterError, match=r"another camera or clip: that of clip\.json turned otherwise"):
        unshutter.camera_poses(CAMERA.write_model(tmp_path / "sparse"), clip)


def test_only_the_pictures_of_the_clip_get_its_motion(tmp_path: Path) -> None:
    clip = CAMERA.write_clip_motion(tmp_path / "clip.json", 90)
    model, other = (
        renamed(each, tmp_path / name, f"{name}/{{:04}}.png") for each, name in ((CAMERA, "a"), (OTHER, "b"))
    )
    with (model / "images.txt").open("a") as images:
        images.write((other / "images.txt").read_text())
    poses = unshutter.camera_poses(model, clip, first_number=1)
    assert {each.picture.name[0] for each in poses.pictures} == {"a"}
    assert "30 left out (30 of another camera or clip" in poses.described()
    assert "the pictures of a/#.png show frames 0, 3, 6" in poses.described()


def test_the_other_camera_of_a_rig_is_no_neighbour_in_time(tmp_path: Path) -> None:
    """Two cameras 12 cm apart on a trolley that does not turn: every row is where the trolley was then."""
    still = WalkingCamera(swing=1e-4)
    model, motions = still.write_model(tmp_path / "sparse"), still.write_motions(tmp_path / "one")
    for name in ("left", "right"):
        shutil.copytree(motions, tmp_path / "motions" / name)
    lines = (model / "images.txt").read_text()
    left = lines.replace(" 7 0", " 7 left/0")
    right = "\n".join(_moved(line) for line in lines.replace(" 7 0", " 7 right/0").splitlines())
    (model / "images.txt").write_text(f"{left}\n{right}\n")
    poses = unshutter.camera_poses(model, tmp_path / "motions", readout_ratio=0.6, fps=30.0, rows=2)
    assert len(poses.pictures) == 10
    for each in poses.pictures:
        places = [-pose[:3, :3].T @ pose[:3, 3] for pose in each.world_to_camera]
        speed = (places[1] - places[0]) / (each.times_s[1] - each.times_s[0])
        assert np.allclose(speed, [1, 0, 0.3], atol=0.15)  # it bobs, too


def _moved(line: str) -> str:
    words = line.split()
    if "right" in line:
        words[5] = str(float(words[5]) - 0.12)
    return " ".join(words)


@pytest.mark.parametrize("seed", [thorough(0), 1, 2, thorough(3)])
def test_noise_parallax_and_gaps_do_not_mislead(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, stride = 300, int(rng.choice([3, 5, 10]))
    times = np.arange(count) / 30
    waves = rng.uniform(0.3, 4, (12, 3)), rng.uniform(0, 6.28, (12, 3))
    path = sum(np.sin(2 * np.pi * f * times[:, None] + p) / f for f, p in zip(*waves, strict=True))
    path = rotation_matrix(0.012 * path)
    steps = np.full((count, 3, 3), np.nan)
    apparent = np.deg2rad(4) / 30 * np.stack([np.cos(times), 1 + 0.3 * np.sin(times), 0 * times], axis=1)
    for k in range(1, count):
        noise = np.deg2rad(0.03) * rng.normal(size=3)
        steps[k] = rotation_matrix(apparent[k] + noise) @ path[k] @ path[k - 1].T
    steps[count // 2] = np.nan  # nothing was found there
    frames = list(range(7, count - 5, stride))
    posed = rotation_matrix(np.deg2rad(0.1) * rng.normal(size=(len(frames), 3))) @ path[frames]
    assert match_frames(posed, frames, steps) == frames
    assert match_frames(posed, list(range(len(frames))), steps) == frames
    assert match_frames(posed[::-1], frames, steps) in (None, frames)  # the other way round is never another place
    still = np.tile(np.eye(3), (len(frames), 1, 1))
    assert match_frames(still, list(range(len(frames))), steps) == list(range(len(frames)))  # that tells nothing
