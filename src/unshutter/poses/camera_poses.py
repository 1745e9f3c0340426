"""The poses of a model's pictures, and the files in which other programs read them."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from unshutter.export import write_npz
from unshutter.motion.shapes import Float64
from unshutter.orientation import ScanDirection
from unshutter.poses.colmap import FISHEYES, LITTLE_BENT, ColmapCamera, ColmapPicture
from unshutter.storage.files import check_target, make_folder, remove_leftovers, written_whole

GSPLAT = "gsplat.npz"
NERFSTUDIO = "transforms.json"
TABLE = "poses.csv"
NAMES = (GSPLAT, NERFSTUDIO, TABLE)
_COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2")
# COLMAP's model -> gsplat's, and nerfstudio's
_GSPLAT = {**dict.fromkeys(LITTLE_BENT, "pinhole"), **dict.fromkeys(FISHEYES, "fisheye")}
_NERFSTUDIO = {**dict.fromkeys(LITTLE_BENT, "OPENCV"), **dict.fromkeys(FISHEYES, "OPENCV_FISHEYE")}
del _NERFSTUDIO["FULL_OPENCV"]


@dataclass(frozen=True, eq=False)
class PicturePoses:
    """The camera's poses while a picture was read.

    Attributes:
        picture: the picture in the model, with the pose that COLMAP found.
        scan_direction: direction in which its stored pixels were read.
        lines: [N] the rows for which there are poses, from the first to the last that was read, evenly spaced, in
            stored pixels from 0; columns if the picture was read sideways.
        times_s: [N] when each was read, on the video's clock [s].
        world_to_camera: [N, 4, 4] pose of each.
        moved: whether neighbours showed how the camera moved; otherwise its position is the same for all rows.
    """

    picture: ColmapPicture
    scan_direction: ScanDirection
    lines: Float64[np.ndarray, "rows"]
    times_s: Float64[np.ndarray, "rows"]
    world_to_camera: Float64[np.ndarray, "rows 4 4"]
    moved: bool

    def at(self, share: float) -> Float64[np.ndarray, "4 4"]:
        """Returns the pose at a share of the readout: 0 the first row, 0.5 the middle, 1 the last."""
        return self.world_to_camera[round(share * (len(self.lines) - 1))]


@dataclass(frozen=True)
class CameraPoses:
    """The poses of all pictures whose motion is known.

    Attributes:
        pictures: in the order of the model's names.
        left_out: why pictures were left out -> their number.
        readout_s: readout time of a picture [s].
        matched: for each camera whose pictures are not numbered as the clip's frames, which frames they show; and
            whether frames repeat others.
    """

    pictures: list[PicturePoses]
    left_out: Counter[str] = field(default_factory=Counter)
    readout_s: float = 0.0
    matched: list[str] = field(default_factory=list)

    def described(self) -> str:
        """One line: ``24 pictures read in 20.1 ms; 2 left out (no motion file)``."""
        count = len(self.pictures)
        text = f"{count} {'picture' if count == 1 else 'pictures'} read in {1000 * self.readout_s:.1f} ms"
        if still := sum(not each.moved for each in self.pictures):
            text += f"; how the camera moved is unknown for {still}, which have no neighbours within a second"
        if self.left_out:
            reasons = ", ".join(f"{number} {reason}" for reason, number in self.left_out.most_common())
            text += f"; {self.left_out.total()} left out ({reasons})"
        return "; ".join([text, *self.matched, *self.not_written])

    @property
    def not_written(self) -> list[str]:
        """The files that cannot hold the pictures' cameras, and why."""
        models = sorted({each.picture.camera.model for each in self.pictures})
        left: list[str] = []
        for file, program, held in ((GSPLAT, "gsplat", _GSPLAT), (NERFSTUDIO, "nerfstudio", _NERFSTUDIO)):
            unheld = [model for model in models if model not in held]
            if unheld:
                left.append(f"{file} is not written: {program} has no camera model {', '.join(unheld)}")
        if len({_NERFSTUDIO[model] for model in models if model in _NERFSTUDIO}) > 1:
            left.append(f"{NERFSTUDIO} is not written: nerfstudio takes one camera model for all pictures")
        return left

    def save(self, folder: str | Path, *, images: str = "images", overwrite: bool = False) -> None:
        """Writes ``gsplat.npz``, ``transforms.json`` and ``poses.csv`` into a folder (docs/guide/photogrammetry.md)."""
        write_poses(self, Path(folder), images, overwrite)


# ---- files ----------------------------------------------------------------------------------------------------


def write_poses(poses: CameraPoses, folder: Path, images: str, overwrite: bool) -> None:
    """Writes the files of :data:`NAMES` that can hold the cameras' lens models to a folder, created if missing.

    All are checked before the first is written.

    Args:
        images: folder of the pictures, as ``transforms.json`` names it.
    """
    names = [name for name in NAMES if not any(left.startswith(f"{name} ") for left in poses.not_written)]
    transforms = json.dumps(_transforms(poses, images), indent=1) if NERFSTUDIO in names else ""
    make_folder(folder)
    remove_leftovers(folder)
    for name in NAMES:
        check_target(folder / name, overwrite)
    if GSPLAT in names:
        with written_whole(folder / GSPLAT, overwrite) as part:
            write_npz(part, **_arrays(poses))
    for name, text in ((NERFSTUDIO, f"{transforms}\n"), (TABLE, _table(poses))):
        if name in names:
            with written_whole(folder / name, overwrite) as part:
                part.write_text(text, encoding="utf-8", errors="surrogateescape", newline="")


def _arrays(poses: CameraPoses) -> dict[str, np.ndarray]:
    """Returns the arguments of gsplat's ``rasterization``, one entry for each picture."""
    pictures = poses.pictures
    cameras = [each.picture.camera for each in pictures]
    direction = [f"ROLLING_{each.scan_direction.name}" for each in pictures]
    return {
        "names": np.array([_printable(each.picture.name) for each in pictures]),
        "viewmats": np.stack([each.at(0.0) for each in pictures]).astype(np.float32),
        "viewmats_middle": np.stack([each.at(0.5) for each in pictures]).astype(np.float32),
        "viewmats_rs": np.stack([each.at(1.0) for each in pictures]).astype(np.float32),
        "Ks": np.stack([camera.matrix for camera in cameras]).astype(np.float32),
        "widths": np.array([camera.width for camera in cameras]),
        "heights": np.array([camera.height for camera in cameras]),
        "rolling_shutter": np.array(direction),
        "camera_model": np.array([_GSPLAT[camera.model] for camera in cameras]),
        "radial_coeffs": _coefficients(cameras, ("k1", "k2", "k3", "k4", "k5", "k6")),
        "tangential_coeffs": _coefficients(cameras, ("p1", "p2")),
    }


def _coefficients(cameras: list[ColmapCamera], names: tuple[str, ...]) -> np.ndarray:
    """Returns coefficients of the lenses [N, names], 0 where a model has none."""
    return np.array([[camera.parameters.get(name, 0.0) for name in names] for camera in cameras], np.float32)


def _transforms(poses: CameraPoses, images: str) -> dict[str, object]:
    """Returns nerfstudio's description of the pictures; nerfstudio ignores keys that it does not know."""
    cameras = [_intrinsics(each.picture.camera) for each in poses.pictures]
    shared = {name: value for name, value in cameras[0].items() if all(each.get(name) == value for each in cameras)}
    frames = [
        {
            "file_path": f"{images.rstrip('/')}/{_printable(each.picture.name)}",
            **{name: value for name, value in own.items() if name not in shared},
            "transform_matrix": _camera_to_world(each, 0.5),
            "transform_matrix_first_row": _camera_to_world(each, 0.0),
            "transform_matrix_last_row": _camera_to_world(each, 1.0),
            "readout": str(each.scan_direction),
        }
        for each, own in zip(poses.pictures, cameras, strict=True)
    ]
    return {**shared, "rolling_shutter_readout_s": poses.readout_s, "frames": frames}


def _intrinsics(camera: ColmapCamera) -> dict[str, object]:
    fx, fy = camera.focal_px
    known = camera.parameters
    return {
        "camera_model": _NERFSTUDIO[camera.model],
        "w": camera.width,
        "h": camera.height,
        "fl_x": fx,
        "fl_y": fy,
        "cx": known["cx"],
        "cy": known["cy"],
        **{name: known[name] for name in _COEFFICIENTS if name in known},
    }


def _camera_to_world(poses: PicturePoses, share: float) -> list[list[float]]:
    # OpenGL's axes of the camera: y up, z backwards
    return (np.linalg.inv(poses.at(share)) @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist()


def _table(poses: CameraPoses) -> str:
    """Returns a line for each row: COLMAP's quaternion and translation, from the world to the camera."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "row", "time_s", "qw", "qx", "qy", "qz", "tx", "ty", "tz"])
    for each in poses.pictures:
        for line, time_s, pose in zip(each.lines, each.times_s, each.world_to_camera, strict=True):
            numbers = [*_quaternion(pose[:3, :3]), *pose[:3, 3]]
            writer.writerow([each.picture.name, int(line), f"{time_s:.6f}", *(f"{number:.9f}" for number in numbers)])
    return text.getvalue()


def _quaternion(rotation: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "4"]:
    """Returns the unit quaternion (w, x, y, z) of a rotation, with w >= 0: an eigenvector of Bar-Itzhack's matrix."""
    m = rotation
    symmetric = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    largest = np.linalg.eigh(symmetric)[1][:, -1]
    return largest if largest[0] >= 0 else -largest


def _printable(name: str) -> str:
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
