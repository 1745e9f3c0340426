"""Poses are refined against the points of a model and the rows that show them; what contradicts them is left alone."""

import json
import struct
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.covering import thorough
from support.walking_camera import FOCAL, FPS, HEIGHT, RATIO, WIDTH, WalkingCamera
from unshutter import CameraPoses, ScanDirection, UnshutterError
from unshutter.motion.grid import rs_to_gs_map
from unshutter.poses import adjustment, refinement
from unshutter.poses.colmap import MODELS, ColmapCamera, read_model, read_points

CAMERA = WalkingCamera()
FRAMES = 60
WALK = WalkingCamera(numbers=tuple(range(0, FRAMES, 4)), swing=0.02)


@dataclass(frozen=True)
class Scene:
    """A model as COLMAP makes it: its poses and points are 3 cm and a third of a degree off."""

    camera: WalkingCamera = WALK
    straightened: bool = False
    contradictory: bool = False
    exact: bool = False

    def write(self, folder: Path) -> Path:
        """Writes the model, as text."""
        random = np.random.default_rng(5)
        error = 0 if self.exact else 1
        places = np.stack([random.uniform(low, high, 250) for low, high in ((-2, 4), (-2, 2), (3, 8))], axis=1)
        model = self.camera.write_model(folder)
        lines = (model / "images.txt").read_text().splitlines()
        for k, number in enumerate(self.camera.numbers):
            words = lines[2 * k + 1].split()
            turn = cv2.Rodrigues(0.006 * error * random.normal(size=3))[0]
            turned = turn @ self._rotation(words)
            vector = cv2.Rodrigues(turned)[0].ravel()
            angle = float(np.linalg.norm(vector))
            quaternion = [np.cos(angle / 2), *(np.sin(angle / 2) * vector / angle)]
            moved = turn @ np.array(list(map(float, words[5:8]))) + 0.03 * error * random.normal(size=3)
            words[1:8] = [repr(float(value)) for value in (*quaternion, *moved)]
            lines[2 * k + 1] = " ".join(words)
            lines[2 * k + 2] = " ".join(self._shown(number, places, random))
        (model / "images.txt").write_text("\n".join(lines) + "\n")
        shifted = places + 0.03 * error * random.normal(size=places.shape)
        text = [f"{k} {x!r} {y!r} {z!r} 9 9 9 0.5 1 {k}" for k, (x, y, z) in enumerate(shifted.tolist())]
        (model / "points3D.txt").write_text("# a remark\n" + "\n".join(text[::-1]) + "\n")
        return model

    def _rotation(self, words: list[str]) -> np.ndarray:
        w, *axis = map(float, words[1:5])
        sine = np.linalg.norm(axis)
        return cv2.Rodrigues(2 * np.arctan2(sine, w) * np.array(axis) / sine)[0]

    def _shown(self, number: int, places: np.ndarray, random: np.random.Generator) -> list[str]:
        shown: list[str] = []
        straight = self._straight(number)
        for k, place in enumerate(places):
            at = self.camera.seen(number, place)
            if not (0 <= at[0] <= WIDTH - 1 and 0 <= at[1] <= HEIGHT - 1):
                continue
            if self.straightened:
                at = np.array(straight(*at))
            at = at + 0.5 + random.normal(size=2) * 0.05
            shown += [*map(repr, at.tolist()), str((k + 31 * number * self.contradictory) % 250 if k % 7 else -1)]
        return shown

    def _straight(self, number: int):
        lines, across = self.camera.readout.frame_size(HEIGHT, WIDTH)
        turns = self.camera.turns(number, np.arange(lines), lines)
        motion = unshutter.RotationMotion(across, turns, FOCAL, scan_direction=self.camera.readout)
        return rs_to_gs_map(motion.rereferenced("middle"))

    def refined(self, folder: Path, rows: int = 3) -> CameraPoses:
        """Its poses, with the motion of the clip, which takes steps sideways for turns."""
        model = self.write(folder / "sparse")
        return unshutter.camera_poses(model, self.camera.write_clip_motion(folder / "clip.json", FRAMES), rows=rows)


def off(camera: WalkingCamera, poses: CameraPoses) -> tuple[float, float]:
    """How far the positions of all rows are off [m], and their rotations [rad], rms, after the best similarity."""
    lines = WIDTH if camera.readout.sideways else HEIGHT
    found, true, turns = [], [], []
    for each in poses.pictures:
        number = int(each.picture.name[:5])
        for share in (0.0, 0.5, 1.0):
            pose = each.at(share)
            time = camera.time_s(number, share * (lines - 1))
            found.append(-pose[:3, :3].T @ pose[:3, 3])
            true.append(camera.position(time))
            turns.append(cv2.Rodrigues(camera.rotation(time).T @ pose[:3, :3])[0].ravel())
    turn = cv2.Rodrigues(np.mean(turns, axis=0))[0]
    one, other = (np.array(places) - np.mean(places, axis=0) for places in (np.array(found) @ turn.T, true))
    scale = np.sum(one * other) / np.sum(one**2)
    spread = np.array(turns) - np.mean(turns, axis=0)
    return tuple(float(np.sqrt(np.mean(np.sum(each**2, axis=1)))) for each in (scale * one - other, spread))


@pytest.mark.parametrize("straightened", [False, True])
@pytest.mark.parametrize("readout", [ScanDirection.TOP_TO_BOTTOM, thorough(ScanDirection.RIGHT_TO_LEFT)])
def test_poses_of_all_rows_are_exact(readout: ScanDirection, straightened: bool, tmp_path: Path) -> None:
    camera = replace(WALK, apparent=(0.02, 0.1, 0.0), readout=readout)
    poses = Scene(camera, straightened).refined(tmp_path)
    assert "; refined: points are 0.0" in poses.described()
    place, turn = off(camera, poses)
    assert place < 0.004 and turn < 0.001
    as_before = without_points(tmp_path)
    assert "not refined: the model has no points" in as_before.described()
    place, turn = off(camera, as_before)
    assert place > 0.03 and turn > 0.005


def without_points(folder: Path) -> CameraPoses:
    """The poses of a model that is written already, not refined."""
    (folder / "sparse" / "points3D.txt").unlink()
    return unshutter.camera_poses(folder / "sparse", folder / "clip.json", rows=3)


def test_what_contradicts_the_points_is_left_alone(tmp_path: Path) -> None:
    poses = Scene(contradictory=True).refined(tmp_path)
    assert "not refined: points are" in poses.described()
    for one, other in zip(poses.pictures, without_points(tmp_path).pictures, strict=True):
        assert np.array_equal(one.world_to_camera, other.world_to_camera)


def test_pictures_that_were_straightened_better_than_the_motion_says_are_left_alone(tmp_path: Path) -> None:
    model = Scene(straightened=True, exact=True).write(tmp_path / "sparse")
    motions = replace(WALK, swing=0.03).write_motions(tmp_path / "motions")
    poses = unshutter.camera_poses(model, motions, readout_ratio=RATIO, fps=FPS)
    assert "; not refined: points are 0.0" in poses.described()


def test_pictures_with_few_points_keep_their_poses(tmp_path: Path) -> None:
    model = Scene().write(tmp_path / "sparse")
    lines = (model / "images.txt").read_text().splitlines()
    lines[8] = " ".join(lines[8].split()[:60])
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    poses = unshutter.camera_poses(model, WALK.write_clip_motion(tmp_path / "clip.json", FRAMES), rows=3)
    assert poses.described().endswith(", but of 1 picture with few points or contradictory ones")
    for k, (one, other) in enumerate(zip(poses.pictures, without_points(tmp_path).pictures, strict=True)):
        assert np.array_equal(one.world_to_camera, other.world_to_camera) == (k == 3)


def test_many_pictures_are_adjusted_in_windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adjustment, "_WINDOW", 8)
    monkeypatch.setattr(refinement, "_AT_ONCE", 1000)
    poses = Scene().refined(tmp_path)
    place, turn = off(WALK, poses)
    assert place < 0.01 and turn < 0.003
    assert poses.points.shape == (250, 3)


def test_points_show_what_the_motion_file_does_not(tmp_path: Path) -> None:
    model, clip = Scene().write(tmp_path / "sparse"), WALK.write_clip_motion(tmp_path / "clip.json", FRAMES)
    content = json.loads(clip.read_text())
    for frame in content["frames"]:
        frame |= {"rotations_rad": None, "reason": "too dark"}
    clip.write_text(json.dumps(content))
    poses = unshutter.camera_poses(model, clip, rows=3)
    assert len(poses.pictures) == len(WALK.numbers) and not poses.left_out
    place, turn = off(WALK, poses)
    assert place < 0.004 and turn < 0.002
    with pytest.raises(UnshutterError, match=r"no picture of .* has a motion \(15: too dark\)"):
        without_points(tmp_path)


def test_why_nothing_is_refined(tmp_path: Path) -> None:
    model = Scene().write(tmp_path / "sparse")
    clip = WALK.write_clip_motion(tmp_path / "clip.json", FRAMES)
    images = (model / "images.txt").read_text()
    few = "\n".join(f"{number} 1 2 3 9 9 9 1" for number in range(1, 30))
    for points, cameras, why in (
        (few, f"7 PINHOLE {WIDTH} {HEIGHT} 500 500 320 240", "too few points"),
        ("5000 1 2 3 9 9 9 1", f"7 PINHOLE {WIDTH} {HEIGHT} 500 500 320 240", "no picture shows its points"),
        ("5 nan 2 3 9 9 9 1", f"7 PINHOLE {WIDTH} {HEIGHT} 500 500 320 240", "the model has no points"),
        (few, f"7 FOV {WIDTH} {HEIGHT} 500 500 320 240 0.9", "not of lenses FOV"),
    ):
        (model / "points3D.txt").write_text(f"{points}\n")
        (model / "cameras.txt").write_text(f"{cameras}\n")
        assert f"; not refined: {why}" in unshutter.camera_poses(model, clip).described()
    (model / "points3D.txt").write_text("5 1 2\n")
    with pytest.raises(UnshutterError, match=r"points3D\.txt is not a COLMAP file, or damaged"):
        unshutter.camera_poses(model, clip)
    (model / "images.txt").write_text(images.replace(" -1 ", " x ", 1))
    with pytest.raises(UnshutterError, match=r"images\.txt is not a COLMAP file, or damaged"):
        unshutter.camera_poses(model, clip)


def test_binary_points_are_read(tmp_path: Path) -> None:
    model = CAMERA.write_model(tmp_path / "sparse", binary=True)
    picture = read_model(model)[2]
    assert picture.seen.tolist() == [[1, 2], [1, 2]] and picture.numbers.tolist() == [3, 3]
    data = struct.pack("<Q", 2)
    for number, length in ((9, 2), (3, 0)):
        data += struct.pack("<Q3d3BdQ", number, number, 1, 2, 7, 8, 9, 0.5, length) + bytes(8 * length)
    (model / "points3D.bin").write_bytes(data)
    points = read_points(model)
    assert points.numbers.tolist() == [3, 9] and points.places.tolist() == [[3, 1, 2], [9, 1, 2]]
    assert points.colours.tolist() == [[7, 8, 9], [7, 8, 9]]
    (model / "points3D.bin").write_bytes(data[:-20])
    with pytest.raises(UnshutterError, match=r"points3D\.bin is not a COLMAP file, or damaged"):
        read_points(model)


@pytest.mark.parametrize(
    ("model", "values"),
    [
        ("PINHOLE", ()),
        ("OPENCV", (-0.12, 0.04, 0.002, -0.003)),
        ("FULL_OPENCV", (-0.1, 0.03, 0.002, -0.003, 0.01, 0.02, 0.01, -0.01)),
        ("OPENCV_FISHEYE", (0.03, -0.01, 0.004, -0.001)),
    ],
)
def test_directions_are_those_of_the_lens(model: str, values: tuple[float, ...]) -> None:
    names = MODELS[model].split()
    camera = ColmapCamera(model, 640, 480, dict(zip(names, (500.0, 510.0, 320.0, 240.0, *values), strict=True)))
    towards = np.stack([*np.meshgrid(np.linspace(-0.6, 0.6, 9), np.linspace(-0.5, 0.5, 7)), np.ones((7, 9))], axis=-1)
    towards = towards.reshape(-1, 1, 3)
    lens = np.array([*values, 0, 0, 0, 0][: 4 if "FISHEYE" in model else 8])
    project = cv2.fisheye.projectPoints if "FISHEYE" in model else cv2.projectPoints
    seen = project(towards, np.zeros(3), np.zeros(3), camera.matrix, lens)[0].reshape(-1, 2)
    expected = towards[:, 0] / np.linalg.norm(towards[:, 0], axis=1)[:, None]
    assert np.allclose(camera.directions(seen), expected, atol=1e-6)
