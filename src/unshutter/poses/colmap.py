"""Reads cameras, poses and points of a COLMAP model, binary or text (https://colmap.github.io/format.html)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.motion_file import MOST_SIDE
from unshutter.motion.shapes import Float64, UInt8
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
# those that bend straight lines a little, and fisheyes, by polynomials as OpenCV's
LITTLE_BENT = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV")
FISHEYES = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_FISHEYE", "FISHEYE")
RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")
_INVERSION_STEPS = 50
_SETTLED = 1e-7  # last step of the inversion, in focal lengths
_LARGEST = 1 << 33  # bytes of a file
_NO_POINT = (1 << 64) - 1  # number of the point of a position that has none


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

    def coefficients(self, *names: str) -> Float64[np.ndarray, "names"]:
        """Returns coefficients of the lens, 0 where its model has none."""
        return np.array([self.parameters.get(name, 0.0) for name in names])

    def directions(self, positions: Float64[np.ndarray, "at 2"]) -> Float64[np.ndarray, "at 3"]:
        """Returns the unit vectors that positions [px] show; NaN where there is none, and for other models."""
        known = self.parameters
        bent = (positions - [known["cx"], known["cy"]]) / self.focal_px
        if self.model in FISHEYES:
            return _fisheye_directions(bent, self.coefficients(*RADIAL[:4]))
        if self.model not in LITTLE_BENT:
            return np.full((len(positions), 3), np.nan)
        k = self.coefficients(*RADIAL)
        p1, p2 = self.coefficients("p1", "p2")
        straight = bent.copy()
        for _ in range(_INVERSION_STEPS):
            x, y = straight.T
            square = x**2 + y**2
            factor = (1 + square * (k[3] + square * (k[4] + square * k[5]))) / (
                1 + square * (k[0] + square * (k[1] + square * k[2]))
            )
            leaning = [2 * p1 * x * y + p2 * (square + 2 * x**2), p1 * (square + 2 * y**2) + 2 * p2 * x * y]
            before = straight
            straight = (bent - np.stack(leaning, axis=1)) * factor[:, None]
        straight[np.abs(straight - before).max(axis=1) > _SETTLED] = np.nan
        directions = np.column_stack([straight, np.ones(len(straight))])
        return directions / np.linalg.norm(directions, axis=1)[:, None]


def _fisheye_directions(bent: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Returns unit vectors [N, 3] from positions [N, 2] in focal lengths from the centre."""
    radius = np.linalg.norm(bent, axis=1)
    angle = radius.copy()
    for _ in range(_INVERSION_STEPS):
        square = angle**2
        value = angle * (1 + square * (k[0] + square * (k[1] + square * (k[2] + square * k[3]))))
        slope = 1 + square * (3 * k[0] + square * (5 * k[1] + square * (7 * k[2] + square * 9 * k[3])))
        step = (value - radius) / slope
        angle = angle - step
    angle[~(np.abs(step) < _SETTLED) | (angle > np.pi)] = np.nan
    across = np.sin(angle) / np.maximum(radius, 1e-12)
    return np.column_stack([across[:, None] * bent, np.cos(angle)])


@dataclass(frozen=True)
class ColmapPicture:
    """A registered picture."""

    name: str  # relative to the folder of the pictures
    camera: ColmapCamera
    # [4, 4] from the world to the camera's axes: x to the right, y down, z into the scene
    world_to_camera: Float64[np.ndarray, "4 4"]
    # [N, 2] (x, y) of the points that it shows [px], and [N] their numbers in the model
    seen: Float64[np.ndarray, "points 2"] = field(default_factory=lambda: np.empty((0, 2)))
    numbers: np.ndarray = field(default_factory=lambda: np.empty(0, np.uint64))


@dataclass(frozen=True, eq=False)
class ColmapPoints:
    """The points of a model, in the order of their numbers."""

    numbers: np.ndarray  # [M] uint64
    places: Float64[np.ndarray, "points 3"]
    colours: UInt8[np.ndarray, "points 3"]


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


def read_points(folder: Path) -> ColmapPoints:
    """Returns the points of a model; none if it has no file of them.

    Raises:
        UnshutterError: the file is damaged.
    """
    ending = ".bin" if _holds(folder, ".bin") else ".txt"
    file = folder / f"points3D{ending}"
    if not file.exists():
        return ColmapPoints(np.empty(0, np.uint64), np.empty((0, 3)), np.empty((0, 3), np.uint8))
    points = _read(file, _points_from_bytes if ending == ".bin" else _points_from_text)
    numbers = np.array(list(points), np.uint64)
    values = np.array(list(points.values()), np.float64).reshape(-1, 6)
    order = np.argsort(numbers)
    order = order[np.isfinite(values[order]).all(axis=1)]
    colours = np.clip(values[order, 3:], 0, 255).astype(np.uint8)
    return ColmapPoints(numbers[order], values[order, :3], colours)


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


def _picture(
    name: str, pose: list[float], camera: ColmapCamera, seen: np.ndarray, numbers: np.ndarray
) -> ColmapPicture:
    """Returns a picture from a quaternion (w, x, y, z) and a translation, both from the world to the camera."""
    quaternion = np.array(pose[:4])
    length = np.linalg.norm(quaternion)
    if not np.isfinite(pose).all() or not length > 0:
        raise ValueError(f"the pose of {name} is not a rotation and a translation")
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = _rotation_of(quaternion / length)
    world_to_camera[:3, 3] = pose[4:]
    known = (numbers != _NO_POINT) & np.isfinite(seen).all(axis=1)
    return ColmapPicture(name, camera, world_to_camera, seen[known], numbers[known])


def _rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """Returns the matrix [3, 3] of a unit quaternion (w, x, y, z), in Hamilton's convention."""
    w = quaternion[0]
    axis = quaternion[1:]
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


# ---- binary files: little-endian ----------------------------------------------------------------------------

_SEEN = np.dtype([("at", "<f8", 2), ("point", "<u8")])


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
        (points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * points
        if at > len(data):
            raise ValueError("it ends too early")
        shown = np.frombuffer(data, _SEEN, points, end + 9)
        name = data[start:end].decode("utf-8", "surrogateescape")
        pictures.append(_picture(name, pose, cameras[camera], shown["at"].astype(np.float64), shown["point"]))
    return pictures


def _points_from_bytes(data: bytes) -> dict[int, tuple[float, ...]]:
    points: dict[int, tuple[float, ...]] = {}
    (count,) = struct.unpack_from("<Q", data)
    at = 8
    for _ in range(count):
        number, *values, _, pictures = struct.unpack_from("<Q3d3BdQ", data, at)
        points[number] = tuple(values)
        at += 51 + 8 * pictures
    return points


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
            shown = np.array(next(lines, "").split()).reshape(-1, 3)  # perhaps none
            numbers = np.array([int(number) % (1 << 64) for number in shown[:, 2]], np.uint64)
            seen = shown[:, :2].astype(np.float64)
            pictures.append(_picture(name, list(map(float, pose)), cameras[int(camera)], seen, numbers))
    return pictures


def _points_from_text(data: bytes) -> dict[int, tuple[float, ...]]:
    points: dict[int, tuple[float, ...]] = {}
    for line in _lines(data):
        if line and not line.startswith("#"):
            number, *values = line.split(maxsplit=7)[:7]
            x, y, z, red, green, blue = map(float, values)
            points[int(number)] = x, y, z, red, green, blue
    return points


def _lines(data: bytes) -> Iterator[str]:
    return (line.strip() for line in data.decode("utf-8", "surrogateescape").split("\n"))
