"""An NCore sequence, read by NVIDIA's own package, shows points where an exact rolling shutter does."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.walking_camera import FOCAL, HEIGHT, WIDTH, WalkingCamera, points
from unshutter import ScanDirection, UnshutterError, UsageError
from unshutter.cli import main
from unshutter.poses.colmap import read_model

CAMERA = WalkingCamera(swing=0.002)


def pictures(folder: Path, camera: WalkingCamera) -> Path:
    """Grey pictures of a camera's frames."""
    folder.mkdir()
    for number in camera.numbers:
        cv2.imwrite(str(folder / f"{number:05}.png"), np.full((HEIGHT, WIDTH), number, np.uint8))
    return folder


def poses_command(folder: Path, camera: WalkingCamera, *words: str) -> int:
    model = camera.write_model(folder / "sparse")
    (model / "points3D.txt").write_text("4 1.5 0.5 4 255 128 0 0.5\n")
    motions = camera.write_clip_motion(folder / "clip.json", 13)
    images = pictures(folder / "film", camera)
    command = ["poses", "--colmap", str(model), "--motions", str(motions), "--format", "ncore", *words]
    return main([*command, "--images", str(images), "-o", str(folder / "out")])


@pytest.mark.parametrize("readout", [ScanDirection.TOP_TO_BOTTOM, ScanDirection.RIGHT_TO_LEFT])
def test_its_own_solver_projects_points_onto_their_rows(readout: ScanDirection, tmp_path: Path) -> None:
    v4 = pytest.importorskip("ncore.data.v4", reason="nvidia-ncore is not installed")
    from ncore.data import FrameTimepoint  # pyright: ignore[reportMissingImports]
    from ncore.sensors import CameraModel  # pyright: ignore[reportMissingImports]

    camera = WalkingCamera(swing=0.002, readout=readout)
    assert poses_command(tmp_path, camera) == 0
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["poses.json", "poses.ncore4.zarr.itar"]
    sequence = v4.SequenceLoaderV4(v4.SequenceComponentGroupsReader([tmp_path / "out" / "poses.json"]))
    (name,) = sequence.camera_ids
    sensor = sequence.get_camera_sensor(name)
    lens = CameraModel.from_parameters(sensor.model_parameters, device="cpu")
    assert sensor.frames_count == len(camera.numbers)
    errors: list[float] = []
    for k, number in enumerate(camera.numbers):
        image = sensor.get_frame_image_array(k)
        assert image.shape[:2] == (HEIGHT, WIDTH) and (image == number).all()
        assert sensor.frames_timestamps_us[k] == pytest.approx(
            [1e6 * camera.time_s(number, line) for line in (0, (WIDTH if readout.sideways else HEIGHT) - 1)], abs=2
        )
        start, end = (
            np.linalg.inv(sensor.get_frames_T_source_target(name, "world", k, at)).reshape(4, 4)
            for at in (FrameTimepoint.START, FrameTimepoint.END)
        )
        found = lens.world_points_to_image_points_shutter_pose(
            points().astype(np.float32), start, end, return_valid_indices=True
        )
        for index, at in zip(found.valid_indices.tolist(), found.image_points.numpy(), strict=True):
            seen = camera.seen(number, points()[index])
            if 0 <= seen[0] <= WIDTH - 1 and 0 <= seen[1] <= HEIGHT - 1:
                errors.append(float(np.hypot(*(at - 0.5 - seen))))
    assert len(errors) > 50 and max(errors) < 0.1
    (cloud,) = sequence.point_clouds_ids
    source = sequence.get_point_clouds_source(cloud)
    assert np.allclose(source.get_pc(0).xyz, [[1.5, 0.5, 4]])
    assert source.get_pc(0).get_attribute("rgb").tolist() == [[255, 128, 0]]


@pytest.mark.parametrize(
    "lens",
    [
        "OPENCV 640 480 500 510 321 239 -0.1 0.03 0.002 -0.003",
        "SIMPLE_RADIAL_FISHEYE 640 480 400 320 240 0.01",
        "SIMPLE_PINHOLE 640 480 500 320 240",
    ],
)
def test_its_lenses_are_those_of_the_model(lens: str, tmp_path: Path) -> None:
    v4 = pytest.importorskip("ncore.data.v4", reason="nvidia-ncore is not installed")
    from ncore.sensors import CameraModel  # pyright: ignore[reportMissingImports]

    model = CAMERA.write_model(tmp_path / "sparse")
    (model / "cameras.txt").write_text(f"7 {lens}\n")
    poses = unshutter.camera_poses(model, CAMERA.write_clip_motion(tmp_path / "clip.json", 13))
    poses.save(tmp_path / "out", format="ncore", images=str(pictures(tmp_path / "film", CAMERA)))
    sequence = v4.SequenceLoaderV4(v4.SequenceComponentGroupsReader([tmp_path / "out" / "poses.json"]))
    described = CameraModel.from_parameters(sequence.get_camera_sensor("camera1").model_parameters, device="cpu")
    at = np.array([[2.0, 3.0], [320, 240], [637, 5], [500, 470]])
    directions = read_model(model)[0].camera.directions(at)
    shown = described.camera_rays_to_image_points(directions.astype(np.float32)).image_points.numpy()
    assert np.allclose(shown, at, atol=0.01)


def test_what_it_cannot_hold_is_told_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "ncore.data", None)
    assert poses_command(tmp_path, CAMERA) == 1
    assert "NCore needs the extra, which brings torch: pip install" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    poses = unshutter.camera_poses(tmp_path / "sparse", tmp_path / "clip.json")
    with pytest.raises(UsageError, match="format must be one of files, ncore, got nerf"):
        poses.save(tmp_path / "out", format="nerf")  # pyright: ignore[reportArgumentType]
    monkeypatch.undo()
    pytest.importorskip("ncore.data.v4", reason="nvidia-ncore is not installed")
    model, clip = tmp_path / "sparse", tmp_path / "clip.json"
    with pytest.raises(UnshutterError, match=r"00000\.png is missing: name the folder of the pictures \(images\)"):
        poses.save(tmp_path / "out", format="ncore", images=str(tmp_path))
    (model / "cameras.txt").write_text(f"7 FOV {WIDTH} {HEIGHT} {FOCAL} {FOCAL} 320 240 0.9\n")
    with pytest.raises(UnshutterError, match="NCore has no camera model FOV"):
        unshutter.camera_poses(model, clip).save(tmp_path / "out", format="ncore")
