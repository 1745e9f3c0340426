"""The poses of a model's pictures, and the files in which other programs read them."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from unshutter.errors import UsageError, shortened
from unshutter.export import write_npz
from unshutter.motion.shapes import Float64, UInt8
from unshutter.options.fields import errors_in_python
from unshutter.poses.colmap import FISHEYES, LITTLE_BENT, ColmapCamera
from unshutter.poses.ncore import write_ncore
from unshutter.poses.picture_poses import PicturePoses
from unshutter.storage.files import check_target, make_folder, remove_leftovers, written_whole

GSPLAT = "gsplat.npz"
NERFSTUDIO = "transforms.json"
TABLE = "poses.csv"
NAMES = (GSPLAT, NERFSTUDIO, TABLE)
PoseFormat = Literal["files", "ncore"]
_COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2")
# COLMAP's model -> gsplat's, and nerfstudio's
_GSPLAT = {**dict.fromkeys(LITTLE_BENT, "pinhole"), **dict.fromkeys(FISHEYES, "fisheye")}
_NERFSTUDIO = {**dict.fromkeys(LITTLE_BENT, "OPENCV"), **dict.fromkeys(FISHEYES, "OPENCV_FISHEYE")}
del _NERFSTUDIO["FULL_OPENCV"]


@dataclass(frozen=True)
class CameraPoses:
    """The poses of all pictures whose motion is known.

    Attributes:
        pictures: in the order of the model's names.
        left_out: why pictures were left out -> their number.
        readout_s: readout time of a picture [s].
        matched: for each camera whose pictures are not numbered as the clip's frames, which frames they show;
            whether frames repeat others, and how the poses were refined.
        points: [M, 3] the model's points, where the refined poses see them.
        colours: [M, 3] their colours (sRGB).
    """

    pictures: list[PicturePoses]
    left_out: Counter[str] = field(default_factory=Counter)
    readout_s: float = 0.0
    matched: list[str] = field(default_factory=list)
    points: Float64[np.ndarray, "points 3"] = field(default_factory=lambda: np.empty((0, 3)))
    colours: UInt8[np.ndarray, "points 3"] = field(default_factory=lambda: np.empty((0, 3), np.uint8))

    def described(self, format: PoseFormat = "files") -> str:
        """One line: ``24 pictures read in 20.1 ms; 2 left out (no motion file)``."""
        count = len(self.pictures)
        text = f"{count} {'picture' if count == 1 else 'pictures'} read in {1000 * self.readout_s:.1f} ms"
        if still := sum(not each.moved for each in self.pictures):
            text += f"; how the camera moved is unknown for {still}, which have no neighbours within a second"
        if self.left_out:
            reasons = ", ".join(f"{number} {reason}" for reason, number in self.left_out.most_common())
            text += f"; {self.left_out.total()} left out ({reasons})"
        return "; ".join([text, *self.matched, *(self.not_written if format == "files" else [])])

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

    @errors_in_python()
    def save(
        self,
        folder: str | Path,
        *,
        format: PoseFormat = "files",
        images: str = "images",
        overwrite: bool = False,
    ) -> None:
        """Writes the poses into a folder, as ``unshutter poses`` does (docs/guide/photogrammetry.md).

        Args:
            format: files (``gsplat.npz``, ``transforms.json`` and ``poses.csv``), or ncore.
            images: folder of the pictures, as ``transforms.json`` names it; an NCore sequence holds the pictures in it.

        Raises:
            UnshutterError: a file exists, or cannot be written; UsageError: unknown format.
        """
        if format not in get_args(PoseFormat):
            raise UsageError(f"format must be one of {', '.join(get_args(PoseFormat))}, got {shortened(str(format))}")
        save_poses(self, format, Path(folder), images, overwrite)


# ---- files ----------------------------------------------------------------------------------------------------


def save_poses(poses: CameraPoses, format: PoseFormat, folder: Path, images: str, overwrite: bool) -> None:
    """Does what :meth:`CameraPoses.save` does; errors name options."""
    if format == "ncore":
        write_ncore(poses.pictures, poses.points, poses.colours, folder, Path(images), overwrite)
    else:
        write_poses(poses, folder, images, overwrite)


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
    return np.stack([camera.coefficients(*names) for camera in cameras]).astype(np.float32)


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
