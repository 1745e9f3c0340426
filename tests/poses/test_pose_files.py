"""Models are read, and poses written, as COLMAP, gsplat and nerfstudio define them."""

import csv
import json
import shutil
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.walking_camera import CENTRE, FOCAL, FPS, HEIGHT, RATIO, WIDTH, WalkingCamera
from unshutter import ScanDirection, UnshutterError
from unshutter.cli import main
from unshutter.poses.colmap import MODELS, read_model

CAMERA = WalkingCamera()


def poses_command(folder: Path, model: Path, motions: Path, *words: str) -> int:
    clock = ["--readout-ratio", str(RATIO), "--fps", str(FPS)] if motions.is_dir() else []
    command = ["poses", "--colmap", str(model), "--motions", str(motions), "-o", str(folder / "out"), *clock, *words]
    return main(command)


def table_of(file: Path) -> list[dict[str, str]]:
    rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
    assert all(None not in row for row in rows)  # as many values as names
    return rows


def test_text_and_binary_models_say_the_same(tmp_path: Path) -> None:
    text = read_model(CAMERA.write_model(tmp_path / "text"))
    binary = read_model(CAMERA.write_model(tmp_path / "binary", binary=True))
    assert [each.name for each in text] == [each.name for each in binary] == [f"{k:05}.png" for k in CAMERA.numbers]
    for one, other in zip(text, binary, strict=True):
        assert one.camera == other.camera
        assert np.allclose(one.world_to_camera, other.world_to_camera, atol=1e-12)
    moment = CAMERA.time_s(3, 0.5 * (HEIGHT - 1))
    assert np.allclose(text[1].world_to_camera[:3, :3], CAMERA.rotation(moment), atol=1e-12)


def test_every_camera_model_of_colmap_is_read(tmp_path: Path) -> None:
    text, binary = (tmp_path / name for name in ("text", "binary"))
    text.mkdir()
    binary.mkdir()
    (text / "images.txt").write_text("1 1 0 0 0 0 0 0 3 street of 1.jpg\n")
    picture = struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0, 0, 0, 3) + b"street of 1.jpg\0" + struct.pack("<Q", 0)
    (binary / "images.bin").write_bytes(picture)
    assert [list(MODELS)[number] for number in (4, 11, 12, 16, 17)] == [  # as pycolmap 4.2.1 counts them
        "OPENCV", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "EUCM", "EQUIRECTANGULAR",
    ]  # fmt: skip
    for number, (model, names) in enumerate(list(MODELS.items())[:-1]):
        values = [10.0 + k for k in range(len(names.split()))]
        (text / "cameras.txt").write_text(f"3 {model} 640 480 {' '.join(map(str, values))}\n")
        (binary / "cameras.bin").write_bytes(struct.pack(f"<QIiQQ{len(values)}d", 1, 3, number, 640, 480, *values))
        one, other = read_model(text)[0], read_model(binary)[0]
        assert one.name == other.name == "street of 1.jpg" and one.camera == other.camera
        assert one.camera.focal_px == (10.0, 10.0 if names.startswith("f ") else 11.0)
        assert one.camera.matrix[1, 2] == (12.0 if names.startswith("f ") else 13.0)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("cameras.txt", b"1 PINHOLE 640 480 500 500 320"),
        ("cameras.txt", b"1 SPHERE 640 480 500"),
        ("cameras.txt", b"1 PINHOLE 0 480 500 500 320 240"),
        ("cameras.txt", b"1 PINHOLE 640 480 nan 500 320 240"),
        ("cameras.txt", b"\xff\xd8 a photo"),
        ("images.txt", b"1 0 0 0 0 0 0 0 7 a.png"),
        ("images.txt", b"1 1 0 0 0 0 0 0 8 a.png"),
        ("images.txt", b"1 1 0 0"),
        ("cameras.bin", b""),
        ("cameras.bin", struct.pack("<QIiQQ", 1, 1, 99, 640, 480)),
        ("cameras.bin", struct.pack("<Q", 1 << 60)),
        ("images.bin", struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0, 0, 0, 7) + b"no end"),
        ("images.bin", struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0, 0, 0, 7) + b"a\0" + struct.pack("<Q", 1 << 50)),
    ],
)
def test_a_damaged_model_is_told_in_a_line(name: str, data: bytes, tmp_path: Path) -> None:
    model = CAMERA.write_model(tmp_path / "sparse", binary=name.endswith(".bin"))
    (model / name).write_bytes(data)
    with pytest.raises(UnshutterError, match=f"{name} is not a COLMAP file, or damaged: ") as told:
        read_model(model)
    assert "\n" not in str(told.value)


def test_spherical_pictures_are_refused_in_a_line(tmp_path: Path) -> None:
    model = CAMERA.write_model(tmp_path / "sparse")
    (model / "cameras.txt").write_text("7 EQUIRECTANGULAR 640 480 640 480\n")
    with pytest.raises(UnshutterError, match=r"spherical pictures .*: reconstruct from the frames of each lens"):
        read_model(model)


def test_a_folder_without_a_model_is_told_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motions = CAMERA.write_motions(tmp_path / "motions")
    assert poses_command(tmp_path, tmp_path, motions) == 1
    assert "holds no COLMAP model: name the folder of cameras.bin and images.bin" in capsys.readouterr().err
    assert poses_command(tmp_path, tmp_path / "none", motions) == 1
    (tmp_path / "cameras.txt").touch()
    (tmp_path / "images.txt").touch()
    assert poses_command(tmp_path, tmp_path, motions) == 1
    assert "has no registered pictures" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_what_the_command_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, motions = CAMERA.write_model(tmp_path / "sparse"), CAMERA.write_motions(tmp_path / "motions")
    assert poses_command(tmp_path, model, motions, "--images", "film/", "--rows", "3") == 0
    told = capsys.readouterr().err
    assert told == f"{model} -> {tmp_path / 'out'}: 5 pictures read in 20.0 ms; not refined: the model has no points\n"
    out = tmp_path / "out"
    assert sorted(file.name for file in out.iterdir()) == ["gsplat.npz", "poses.csv", "transforms.json"]
    poses = unshutter.camera_poses(model, motions, readout_ratio=RATIO, fps=FPS, rows=3)
    first, middle, last = (poses.pictures[1].at(share) for share in (0.0, 0.5, 1.0))

    with np.load(out / "gsplat.npz", allow_pickle=False) as arrays:
        assert arrays["names"][1] == "00003.png" and arrays["rolling_shutter"][1] == "ROLLING_TOP_TO_BOTTOM"
        assert np.allclose(arrays["viewmats"][1], first, atol=1e-6)
        assert np.allclose(arrays["viewmats_middle"][1], middle, atol=1e-6)
        assert np.allclose(arrays["viewmats_rs"][1], last, atol=1e-6)
        assert np.allclose(arrays["Ks"][1], [[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1]])
        assert (arrays["widths"][1], arrays["heights"][1]) == (WIDTH, HEIGHT)

    transforms = json.loads((out / "transforms.json").read_text())
    known = {"camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": 320.0, "cy": 240.0}
    assert {key: transforms[key] for key in known} == known
    assert transforms["rolling_shutter_readout_s"] == pytest.approx(0.02)
    frame = transforms["frames"][1]
    assert frame["file_path"] == "film/00003.png" and frame["readout"] == "top-to-bottom"
    for key, pose in (
        ("transform_matrix_first_row", first),
        ("transform_matrix", middle),
        ("transform_matrix_last_row", last),
    ):
        matrix = np.array(frame[key])
        rotation, position = pose[:3, :3], -pose[:3, :3].T @ pose[:3, 3]
        assert np.allclose(matrix[:3, 3], position)  # the camera's place in the world
        assert np.allclose(matrix[:3, 0], rotation[0])  # its right
        assert np.allclose(matrix[:3, 1], -rotation[1])  # its up
        assert np.allclose(matrix[:3, 2], -rotation[2])  # behind it

    rows = table_of(out / "poses.csv")
    assert [(each["name"], each["row"]) for each in rows[3:6]] == [("00003.png", row) for row in ("0", "240", "479")]
    assert float(rows[5]["time_s"]) == pytest.approx(CAMERA.time_s(3, HEIGHT - 1), abs=1e-6)
    w, *axis = (float(rows[5][key]) for key in ("qw", "qx", "qy", "qz"))
    turn = 2 * np.arccos(w) * np.array(axis) / np.linalg.norm(axis)
    assert np.allclose(cv2.Rodrigues(turn)[0], last[:3, :3], atol=1e-6)
    assert np.allclose([float(rows[5][key]) for key in ("tx", "ty", "tz")], last[:3, 3], atol=1e-8)


def test_nothing_is_replaced_unless_that_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, motions = CAMERA.write_model(tmp_path / "sparse"), CAMERA.write_motions(tmp_path / "motions")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "poses.csv").write_text("mine")
    assert poses_command(tmp_path, model, motions) == 1
    assert "exists already: use --overwrite" in capsys.readouterr().err
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["poses.csv"]
    assert (tmp_path / "out" / "poses.csv").read_text() == "mine"
    assert poses_command(tmp_path, model, motions, "--overwrite") == 0
    poses = unshutter.camera_poses(model, motions, readout_ratio=RATIO, fps=FPS)
    poses.save(tmp_path / "python")
    for file in (tmp_path / "out").iterdir():
        assert file.read_bytes() == (tmp_path / "python" / file.name).read_bytes()


def test_an_input_is_never_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = CAMERA.write_model(tmp_path / "sparse")
    (tmp_path / "out").mkdir()
    clip = CAMERA.write_clip_motion(tmp_path / "out" / "transforms.json", 13)
    before = clip.read_bytes()
    assert poses_command(tmp_path, model, clip, "--overwrite") == 1
    assert "is an original" in capsys.readouterr().err
    assert clip.read_bytes() == before


def test_sideways_pictures_name_their_columns_and_direction(tmp_path: Path) -> None:
    camera = WalkingCamera(readout=ScanDirection.RIGHT_TO_LEFT)
    model, motions = camera.write_model(tmp_path / "sparse"), camera.write_motions(tmp_path / "motions")
    assert poses_command(tmp_path, model, motions, "--rows", "2") == 0
    rows = table_of(tmp_path / "out" / "poses.csv")
    assert [each["row"] for each in rows[:2]] == ["639", "0"]
    with np.load(tmp_path / "out" / "gsplat.npz") as arrays:
        assert set(arrays["rolling_shutter"]) == {"ROLLING_RIGHT_TO_LEFT"}


def test_each_program_gets_the_lenses_that_it_knows(tmp_path: Path) -> None:
    model, motions = CAMERA.write_model(tmp_path / "sparse"), CAMERA.write_motions(tmp_path / "motions")

    def written(lines: str) -> tuple[set[str], unshutter.CameraPoses]:
        (model / "cameras.txt").write_text(lines)
        poses = unshutter.camera_poses(model, motions, readout_ratio=RATIO, fps=FPS)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        poses.save(tmp_path / "out")
        return {file.name for file in (tmp_path / "out").iterdir()}, poses

    files, poses = written(f"7 FOV {WIDTH} {HEIGHT} 500 500 320 240 0.9\n")
    assert files == {"poses.csv"}
    assert "gsplat.npz is not written: gsplat has no camera model FOV" in poses.described()
    assert "transforms.json is not written: nerfstudio has no camera model FOV" in poses.described()

    files, _ = written(f"7 FULL_OPENCV {WIDTH} {HEIGHT} 500 500 320 240 .1 .2 .01 .02 .3 .4 .5 .6\n")
    assert files == {"gsplat.npz", "poses.csv"}
    with np.load(tmp_path / "out" / "gsplat.npz") as arrays:
        assert np.allclose(arrays["radial_coeffs"][0], [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
        assert np.allclose(arrays["tangential_coeffs"][0], [0.01, 0.02])
        assert arrays["camera_model"][0] == "pinhole"

    files, _ = written(f"7 RADIAL_FISHEYE {WIDTH} {HEIGHT} 500 320 240 0.01 0.02\n")
    assert len(files) == 3
    transforms = json.loads((tmp_path / "out" / "transforms.json").read_text())
    assert (transforms["camera_model"], transforms["k2"]) == ("OPENCV_FISHEYE", 0.02)
    with np.load(tmp_path / "out" / "gsplat.npz") as arrays:
        assert np.allclose(arrays["radial_coeffs"][0], [0.01, 0.02, 0, 0, 0, 0])
        assert arrays["camera_model"][0] == "fisheye"


def test_cameras_that_differ(tmp_path: Path) -> None:
    model, motions = CAMERA.write_model(tmp_path / "sparse"), CAMERA.write_motions(tmp_path / "motions")
    images = (model / "images.txt").read_text()
    (model / "images.txt").write_text(images.replace(" 7 00003.png", " 8 00003.png"))
    first = f"7 OPENCV {WIDTH} {HEIGHT} 500 500 320 240 0.01 0 0 0\n"
    (model / "cameras.txt").write_text(f"{first}8 OPENCV {WIDTH} {HEIGHT} 500 500 320 240 0.02 0 0 0\n")
    unshutter.camera_poses(model, motions, readout_ratio=RATIO, fps=FPS).save(tmp_path / "out")
    transforms = json.loads((tmp_path / "out" / "transforms.json").read_text())
    assert transforms["camera_model"] == "OPENCV"  # nerfstudio looks for it here, and for coefficients in frames, too
    assert [frame["k1"] for frame in transforms["frames"]] == [0.01, 0.02, 0.01, 0.01, 0.01]
    (model / "cameras.txt").write_text(f"{first}8 OPENCV_FISHEYE {WIDTH} {HEIGHT} 500 500 320 240 0.02 0 0 0\n")
    poses = unshutter.camera_poses(model, motions, readout_ratio=RATIO, fps=FPS)
    assert "transforms.json is not written: nerfstudio takes one camera model for all" in poses.described()
