"""Writes poses as an NCore v4 sequence (https://github.com/NVIDIA/ncore), which gsplat and 3DGRUT train from.

Of what NCore can hold, the sequence has what its own converter of COLMAP models writes: cameras with their frames and
lenses, a pose at the first and at the last line of each frame, and the model's points. Conventions are COLMAP's: the
camera's axes are x to the right, y down and z into the scene, and the first pixel's centre is at (0.5, 0.5).
"""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from unshutter import version
from unshutter.errors import UnshutterError
from unshutter.motion.shapes import Float64, UInt8
from unshutter.poses.colmap import FISHEYES, LITTLE_BENT, RADIAL, ColmapCamera
from unshutter.poses.frame_rotations import series_and_number
from unshutter.poses.picture_poses import PicturePoses
from unshutter.storage.files import check_target, make_folder, remove_leftovers, written_whole

SEQUENCE = "poses.json"
STORE = "poses.ncore4.zarr.itar"
NAMES = (SEQUENCE, STORE)
_FORMATS = {".jpg": "jpeg", ".jpeg": "jpeg", ".png": "png"}


@dataclass(frozen=True)
class _Package:
    """The modules of NVIDIA's package that are used; it has no types of its own here."""

    data: Any
    v4: Any
    transformations: Any

    @classmethod
    def imported(cls) -> _Package:
        """Imports them: they take seconds."""
        try:
            names = "ncore.data", "ncore.data.v4", "ncore.impl.common.transformations"
            return cls(*map(import_module, names))
        except ImportError as error:
            needed = version.extra("ncore")
            raise UnshutterError(f"NCore needs the extra, which brings torch: {needed} ({error})") from None


def write_ncore(
    pictures: list[PicturePoses],
    points: Float64[np.ndarray, "points 3"],
    colours: UInt8[np.ndarray, "points 3"],
    folder: Path,
    images: Path,
    overwrite: bool,
) -> None:
    """Writes the files of :data:`NAMES` to a folder, created if missing.

    Args:
        points: where the poses see the model's points.
        images: folder of the pictures, which the sequence holds.

    Raises:
        UnshutterError: the package is missing, a picture cannot be read, or the format cannot hold a camera.
    """
    ncore = _Package.imported()
    unheld = sorted({each.picture.camera.model for each in pictures} - {*LITTLE_BENT, *FISHEYES})
    if unheld:
        raise UnshutterError(f"NCore has no camera model {', '.join(unheld)}")
    files = {each.picture.name: _picture_file(images, each) for each in pictures}
    cameras = _cameras(pictures)
    make_folder(folder)
    remove_leftovers(folder)
    for name in NAMES:
        check_target(folder / name, overwrite)
    with TemporaryDirectory() as temporary:
        made = _made(ncore, cameras, files, points, colours, Path(temporary))
        description = ncore.v4.SequenceComponentGroupsReader([made]).get_sequence_meta().to_dict()
        with written_whole(folder / STORE, overwrite) as part:
            shutil.copyfile(made, part)
    with written_whole(folder / SEQUENCE, overwrite) as part:
        part.write_text(f"{json.dumps(description, indent=2)}\n", encoding="utf-8")


def _picture_file(images: Path, each: PicturePoses) -> Path:
    file = images / each.picture.name
    if PurePosixPath(each.picture.name).suffix.lower() not in _FORMATS:
        raise UnshutterError(f"NCore holds JPEG and PNG, not {each.picture.name}")
    if not file.is_file():
        raise UnshutterError("{file} is missing: name the folder of the pictures ({--images})", file=file)
    return file


def _cameras(pictures: list[PicturePoses]) -> list[tuple[ColmapCamera, list[PicturePoses]]]:
    """Returns the pictures of each camera, in the order of time; a calibration of its own counts as a camera."""
    found: dict[object, tuple[ColmapCamera, list[PicturePoses]]] = {}
    for each in pictures:
        camera = each.picture.camera
        calibration = (camera.model, camera.width, camera.height, *camera.parameters.values(), each.scan_direction)
        key = series_and_number(each.picture.name)[0], calibration
        found.setdefault(key, (camera, []))[1].append(each)
    for _, shown in found.values():
        shown.sort(key=lambda each: each.times_s[0])
        is_late = np.diff(_times_us(shown).ravel()) > 0
        if not is_late.all():
            first = int(np.argmin(is_late)) // 2
            both = " and ".join(each.picture.name for each in shown[first : first + 2])
            raise UnshutterError(f"NCore has no place for frames of one time: {both}")
    return list(found.values())


def _times_us(pictures: list[PicturePoses]) -> np.ndarray:
    """Returns when the first and last line of each picture was read [N, 2], in microseconds."""
    times = np.array([each.times_s[[0, -1]] for each in pictures])
    return np.rint(1e6 * times).astype(np.int64)


def _made(
    ncore: _Package,
    cameras: list[tuple[ColmapCamera, list[PicturePoses]]],
    files: dict[str, Path],
    points: np.ndarray,
    colours: np.ndarray,
    folder: Path,
) -> Path:
    """Writes the sequence's store and returns its file."""
    v4 = ncore.v4
    all_times = np.concatenate([_times_us(pictures) for _, pictures in cameras])
    earliest = min(0, int(all_times.min()))  # NCore's times are not negative
    start, end = (int(each) - earliest for each in (all_times.min(), all_times.max()))
    interval = ncore.transformations.HalfClosedInterval.from_start_end(start, end)
    writer = v4.SequenceComponentGroupsWriter(folder, "poses", "poses", interval, {"written_by": "unshutter"})
    trajectories = writer.register_component_writer(v4.PosesComponent.Writer, "default")
    intrinsics = writer.register_component_writer(v4.IntrinsicsComponent.Writer, "default")
    masks = writer.register_component_writer(v4.MasksComponent.Writer, "default")
    writer.register_component_writer(v4.CuboidsComponent.Writer, "default").store_observations([])
    for number, (camera, pictures) in enumerate(cameras, 1):
        name = f"camera{number}"
        times = (_times_us(pictures) - earliest).astype(np.uint64)
        ends = np.stack([np.linalg.inv(each.at(share)) for each in pictures for share in (0.0, 1.0)])
        ends[:, 3] = [0, 0, 0, 1]
        trajectories.store_dynamic_pose(name, "world", ends, times.ravel(), require_sequence_time_coverage=False)
        intrinsics.store_camera_intrinsics(name, _intrinsics(ncore, camera, pictures[0]))
        masks.store_camera_masks(name, {})
        frames = writer.register_component_writer(v4.CameraSensorComponent.Writer, name)
        for each, both in zip(pictures, times, strict=True):
            file = files[each.picture.name]
            about = {"name": each.picture.name}
            frames.store_frame(file.read_bytes(), _FORMATS[file.suffix.lower()], both, {}, about)
    if len(points):
        kinds = v4.PointCloudsComponent
        colour = kinds.AttributeSchema(ncore.data.PointCloud.AttributeTransformType.INVARIANT, np.dtype("uint8"), (3,))
        unit = ncore.data.PointCloud.CoordinateUnit.UNITLESS
        clouds = writer.register_component_writer(
            kinds.Writer, "sfm_points", coordinate_unit=unit, attribute_schemas={"rgb": colour}
        )
        clouds.store_pc(points.astype(np.float32), "world", start, {"rgb": colours})
    (made,) = writer.finalize()
    return Path(made)


def _intrinsics(ncore: _Package, camera: ColmapCamera, poses: PicturePoses) -> Any:
    """Returns NCore's description of a camera."""
    is_fisheye = camera.model in FISHEYES
    shared = {
        "resolution": np.array([camera.width, camera.height], np.uint64),
        "shutter_type": ncore.data.ShutterType[f"ROLLING_{poses.scan_direction.name}"],
        "external_distortion_parameters": None,
        "principal_point": camera.matrix[:2, 2].astype(np.float32),
        "focal_length": np.array(camera.focal_px, np.float32),
        "radial_coeffs": camera.coefficients(*RADIAL[: 4 if is_fisheye else 6]).astype(np.float32),
    }
    if not is_fisheye:
        return ncore.data.OpenCVPinholeCameraModelParameters(
            **shared,
            tangential_coeffs=camera.coefficients("p1", "p2").astype(np.float32),
            thin_prism_coeffs=np.zeros(4, np.float32),
        )
    corners = np.array([[col, row] for col in (0, camera.width) for row in (0, camera.height)], np.float64)
    cosines = camera.directions(corners)[:, 2]
    widest = float(np.arccos(cosines.min())) if np.isfinite(cosines).all() else np.pi
    return ncore.data.OpenCVFisheyeCameraModelParameters(**shared, max_angle=widest)
