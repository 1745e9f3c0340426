"""Reads cameras and poses of a COLMAP model, binary or text (https://colmap.github.io/format.html)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.motion_file import MOST_SIDE
from unshutter.motion.shapes import Float64
from unshutter.storage.files import check_plain

T = TypeVar("T")

# camera model -> its parameters, in the order of COLMAP's numbers of models; f is one focal length for both axes
MODELS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "FOV": "fx fy cx cy omega",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k1",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "THIN_PRISM_FISHEYE": "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1",
    "RAD_TAN_THIN_PRISM_FISHEYE": "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3",
    "SIMPLE_DIVISION": "f cx cy k1",
    "DIVISION": "fx fy cx cy k1",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
    "EUCM": "fx fy cx cy alpha beta",
    "EQUIRECTANGULAR": "w h",
}
_LARGEST = 1 << 33  # bytes of a file


@dataclass(frozen=True)
class ColmapCamera:
    """A calibrated camera; positions are COLMAP's, in which the centre of the first pixel is at (0.5, 0.5)."""

    model: str  # a name of :data:`MODELS`
    width: int  # of the pictures [px]
    height: int
    parameters: dict[str, float]  # name -> value: focal lengths and principal point [px], coefficients of the lens

    @property
    def focal_px(self) -> tuple[float, float]:
        """Focal length along the columns and the rows [px]."""
        single = self.parameters.get("f", 0.0)
        return self.parameters.get("fx", single), self.parameters.get("fy", single)

    @property
    def matrix(self) -> Float64[np.ndarray, "3 3"]:
        """[3, 3] from a direction in the camera's axes to a position in the picture [px]."""
        fx, fy = self.focal_px
        return np.array([[fx, 0, self.parameters["cx"]], [0, fy, self.parameters["cy"]], [0, 0, 1]])


@dataclass(frozen=True)
class ColmapPicture:
    """A registered picture."""

    name: str  # relative to the folder of the pictures
    camera: ColmapCamera
    # [4, 4] from the world to the camera's axes: x to the right, y down, z into the scene
    world_to_camera: Float64[np.ndarray, "4 4"]


def read_model(folder: Path) -> list[ColmapPicture]:
    """Returns the registered pictures of a model, in the order of their names.

    Args:
        folder: holds ``cameras`` and ``images``, ``.bin`` or ``.txt``; ``.bin`` is read if there are both, as COLMAP
            does.

    Raises:
        UnshutterError: the folder holds no model, or a damaged one.

    Examples:
        >>> folder = Path("sparse")
        >>> folder.mkdir()
        >>> _ = (folder / "cameras.txt").write_text("1 PINHOLE 640 480 500 500 320 240")
        >>> _ = (folder / "images.txt").write_text("1 1 0 0 0 0.5 0 2 1 a.jpg")
        >>> read_model(folder)[0].world_to_camera[:3, 3]
        array([0.5, 0. , 2. ])
    """
    if _holds(folder, ".bin"):
        cameras = _read(folder / "cameras.bin", _cameras_from_bytes)
        pictures = _read(folder / "images.bin", partial(_pictures_from_bytes, cameras=cameras))
    elif _holds(folder, ".txt"):
        cameras = _read(folder / "cameras.txt", _cameras_from_text)
        pictures = _read(folder / "images.txt", partial(_pictures_from_text, cameras=cameras))
    else:
        files = "cameras.bin and images.bin (or .txt)"
        raise UnshutterError(f"{{model}} holds no COLMAP model: name the folder of {files}", model=folder)
    if not pictures:
        raise UnshutterError("{model} has no registered pictures", model=folder)
    return sorted(pictures, key=lambda picture: picture.name)


def _holds(folder: Path, ending: str) -> bool:
    return all((folder / f"{name}{ending}").is_file() for name in ("cameras", "images"))


def _read(file: Path, parse: Callable[[bytes], T]) -> T:
    """Reads and parses a file of a model."""
    check_plain(file)
    try:
        if file.stat().st_size > _LARGEST:
            raise UnshutterError("{file} is too large for a COLMAP model", file=file)
        return parse(file.read_bytes())
    except OSError as error:
        raise UnshutterError(f"cannot read {{file}}: {error.strerror}", file=file) from None
    except (ValueError, IndexError, KeyError, OverflowError, struct.error) as error:
        cause = f"it names a camera that is missing: {error}" if isinstance(error, KeyError) else str(error)
        raise UnshutterError(f"{{file}} is not a COLMAP file, or damaged: {cause}", file=file) from None


def _camera(model: str, width: int, height: int, parameters: list[float]) -> ColmapCamera:
    names = MODELS[model].split()
    if len(parameters) != len(names):
        raise ValueError(f"{model} needs {len(names)} parameters, not {len(parameters)}")
    if model == "EQUIRECTANGULAR":
        raise UnshutterError(
            "the model has spherical pictures (EQUIRECTANGULAR), which no sensor reads row by row: reconstruct from "
            "the frames of each lens"
        )
    camera = ColmapCamera(model, width, height, dict(zip(names, parameters, strict=True)))
    if not (1 <= width <= MOST_SIDE and 1 <= height <= MOST_SIDE and min(camera.focal_px) > 0):
        raise ValueError(f"a camera of {width}x{height} px with a focal length of {camera.focal_px[0]:g} px")
    if not np.isfinite(parameters).all():
        raise ValueError("parameters that are not numbers")
    return camera


def _picture(name: str, pose: list[float], camera: ColmapCamera) -> ColmapPicture:
    """Returns a picture from a quaternion (w, x, y, z) and a translation, both from the world to the camera."""
    quaternion = np.array(pose[:4])
    length = np.linalg.norm(quaternion)
    if not np.isfinite(pose).all() or not length > 0:
        raise ValueError(f"the pose of {name} is not a rotation and a translation")
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = _rotation_of(quaternion / length)
    world_to_camera[:3, 3] = pose[4:]
    return ColmapPicture(name, camera, world_to_camera)


def _rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """Returns the matrix [3, 3] of a unit quaternion (w, x, y, z), in Hamilton's convention."""
    w = quaternion[0]
    axis = quaternion[1:]
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


# ---- binary files: little-endian ----------------------------------------------------------------------------


def _cameras_from_bytes(data: bytes) -> dict[int, ColmapCamera]:
    cameras: dict[int, ColmapCamera] = {}
    (count,) = struct.unpack_from("<Q", data)
    at = 8
    for _ in range(count):
        number, model, width, height = struct.unpack_from("<IiQQ", data, at)
        if not 0 <= model < len(MODELS):
            raise ValueError(f"camera model {model} is unknown")
        name = list(MODELS)[model]
        length = len(MODELS[name].split())
        parameters = struct.unpack_from(f"<{length}d", data, at + 24)
        cameras[number] = _camera(name, width, height, list(parameters))
        at += 24 + 8 * length
    return cameras


def _pictures_from_bytes(data: bytes, cameras: dict[int, ColmapCamera]) -> list[ColmapPicture]:
    pictures: list[ColmapPicture] = []
    (count,) = struct.unpack_from("<Q", data)
    at = 8
    for _ in range(count):
        _, *pose, camera = struct.unpack_from("<I7dI", data, at)
        start = at + 64
        end = data.index(b"\0", start)
        pictures.append(_picture(data[start:end].decode("utf-8", "surrogateescape"), pose, cameras[camera]))
        (points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * points
        if at > len(data):
            raise ValueError("it ends too early")
    return pictures


# ---- text files ---------------------------------------------------------------------------------------------


def _cameras_from_text(data: bytes) -> dict[int, ColmapCamera]:
    cameras: dict[int, ColmapCamera] = {}
    for line in _lines(data):
        if line and not line.startswith("#"):
            number, model, width, height, *parameters = line.split()
            if model not in MODELS:
                raise ValueError(f"camera model {model} is unknown")
            cameras[int(number)] = _camera(model, int(width), int(height), list(map(float, parameters)))
    return cameras


def _pictures_from_text(data: bytes, cameras: dict[int, ColmapCamera]) -> list[ColmapPicture]:
    pictures: list[ColmapPicture] = []
    lines = iter(_lines(data))
    for line in lines:
        if line and not line.startswith("#"):
            _, *pose, camera, name = line.split(maxsplit=9)
            pictures.append(_picture(name, list(map(float, pose)), cameras[int(camera)]))
            next(lines, "")  # its points, perhaps none
    return pictures


def _lines(data: bytes) -> Iterator[str]:
    return (line.strip() for line in data.decode("utf-8", "surrogateescape").split("\n"))
