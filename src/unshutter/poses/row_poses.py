"""The camera's pose at each row, from a COLMAP model, the motion within each picture and its neighbours' positions.

These poses are then refined against the model's points, if it has some (refinement.py).

Convention: a pose is the matrix [4, 4] from the world to the camera's axes (x to the right, y down, z into the scene,
as in OpenCV and COLMAP). COLMAP finds one for each picture, P_m, which is that of the row m that the picture shows: the
reference row of a straightened one, and about the middle row of any other. With R(v), the rotation from row m to row v,
and c(t), the camera's position at a time, the pose of row v is

    P(v) = [R(v) R_m | -R(v) R_m c(t_v)]

c is the parabola through the positions of the picture and its neighbours. To the tracks of a video, a camera that moves
sideways looks as if it turned; the poses of the neighbours show how far it turned, and the rest is taken off.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from unshutter.errors import MissingFileError, UnshutterError, UsageError
from unshutter.frames.frame_motion import READOUT_FRACTION
from unshutter.motion import Motion
from unshutter.motion.grid import PositionMap, gs_to_rs_map
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.motion.shapes import Float64
from unshutter.options import Reference, check_ratio, option
from unshutter.options.fields import check_values, implemented_by
from unshutter.orientation import ScanDirection
from unshutter.poses.adjustment import Paths
from unshutter.poses.camera_poses import CameraPoses
from unshutter.poses.colmap import ColmapPicture, read_model, read_points
from unshutter.poses.frame_matching import match_frames
from unshutter.poses.frame_rotations import (
    Clock,
    FrameRotations,
    PictureCamera,
    rotations_from,
    rotations_in_picture,
    series_and_number,
)
from unshutter.poses.picture_poses import PicturePoses
from unshutter.poses.refinement import NODES, Refinement, RowPath, refined
from unshutter.reasons import Reason

_MOST_ROWS = 1001


@dataclass(frozen=True)
class PoseOptions:
    """How the poses are found."""

    reference: Reference = option(
        "middle",
        "Row whose pose the model has: that of `rectify --reference` for straightened pictures, middle for others. "
        "Default: middle.",
    )
    readout_ratio: float | None = option(
        None, "Readout time of a frame divided by the time between frames, if there is a motion file for each picture."
    )
    fps: float | None = option(None, "Frames per second of the video, likewise.", metavar="N")
    first_number: int = option(0, "Number in the name of the video's first frame. Default: 0.")
    rows: int = option(17, f"Rows per picture in the table, 2 to {_MOST_ROWS}. Default: 17.", limits=(2, _MOST_ROWS))

    def __post_init__(self) -> None:
        check_values(self)
        check_ratio(self.readout_ratio)
        if (self.readout_ratio is None) != (self.fps is None):
            raise UsageError("give both {--readout-ratio} and {--fps}, or neither")
        if self.fps is not None and not 0 < self.fps < 1e6:
            raise UsageError(f"{{--fps}} must be above 0, got {self.fps:g}")

    @property
    def clock(self) -> Clock | None:
        """The stated clock of the video; None if it was not stated."""
        if self.fps is None or self.readout_ratio is None:
            return None
        return Clock(1 / self.fps, self.readout_ratio / self.fps)


@dataclass(frozen=True)
class _Frame:
    """A picture of the model as a frame of the video."""

    picture: ColmapPicture
    number: int  # of the frame, from 0
    scan_direction: ScanDirection
    rotations: Float64[np.ndarray, "lines 3 3"]  # from the reference line to each, in the order in which they were read
    lines: Float64[np.ndarray, "lines"]  # stored row or column of each
    times_s: Float64[np.ndarray, "lines"]  # when each was read
    moment_s: float  # when the reference line was read
    unknown: str  # why the rotations within it are unknown, and taken for none; empty if they are known
    unstraightened: Callable[[], PositionMap]  # from positions in the straightened picture to those in the frame

    @property
    def camera(self) -> PictureCamera:
        """Size and focal length."""
        return _camera_of(self.picture)

    @property
    def rotation(self) -> Float64[np.ndarray, "3 3"]:
        """From the world to the camera's axes at the reference line."""
        return self.picture.world_to_camera[:3, :3]

    @property
    def position(self) -> Float64[np.ndarray, "3"]:
        """The camera's position in the world then."""
        return -self.rotation.T @ self.picture.world_to_camera[:3, 3]

    @property
    def from_middle(self) -> Float64[np.ndarray, "3 3"]:
        """From the camera's axes at the middle line to those at the reference line."""
        return self.rotations[len(self.rotations) // 2].T


def find_poses(colmap: str | Path, motions: str | Path, options: PoseOptions) -> CameraPoses:
    """Does what :func:`camera_poses` does, with the options in one value."""
    pictures = read_model(Path(colmap))
    source = rotations_from(Path(motions), options.clock)
    frames: list[list[_Frame]] = []  # of each series, in the order of time
    left_out: Counter[str] = Counter()
    matched = [source.note] if source.note else []
    all_series = _series(pictures, options.first_number)
    for name, series in all_series.items():
        numbers = _numbers(series, source)
        if numbers is None:
            left_out[f"of another camera or clip: that of {Path(motions).name} turned otherwise"] += len(series)
            continue
        if numbers != [number for number, _ in series]:
            matched.append(_matched(name, numbers, is_only=len(all_series) == 1))
        found = [_frame_of(picture, k, source, options) for k, (_, picture) in zip(numbers, series, strict=True)]
        left_out.update(each for each in found if isinstance(each, str))
        frames.append([each for each in found if isinstance(each, _Frame)])
    points = read_points(Path(colmap))
    refinement = refined(_row_paths(frames, source), points)
    poses = list(_poses_of_all(frames, source, refinement, options.rows, left_out))
    if not poses:
        reason, count = left_out.most_common(1)[0]
        raise UnshutterError(f"no picture of {{model}} has a motion ({count}: {reason})", model=colmap)
    poses.sort(key=lambda each: each.picture.name)
    notes = [*matched, refinement.note]
    return CameraPoses(poses, left_out, source.readout_s, notes, refinement.points, points.colours)


def _poses_of_all(
    frames: list[list[_Frame]], source: FrameRotations, refinement: Refinement, rows: int, left_out: Counter[str]
) -> Iterator[PicturePoses]:
    """Yields the poses of all frames whose path was refined or whose rotations are known; counts why others are not."""
    refined_paths = iter(zip(refinement.is_refined, range(len(refinement.is_refined)), strict=True))
    for series in frames:
        known = [frame for frame in series if not frame.unknown]
        place = {id(frame): k for k, frame in enumerate(known)}
        for k, frame in enumerate(series):
            is_refined, number = next(refined_paths)
            at = np.linspace(0, len(frame.lines) - 1, rows)
            if is_refined:
                yield _refined(_poses_of(series, k, source, at), refinement.paths, number)
            elif not frame.unknown:
                yield _poses_of(known, place[id(frame)], source, at)
            else:
                left_out[frame.unknown] += 1


def _series(pictures: list[ColmapPicture], first: int) -> dict[str, list[tuple[int, ColmapPicture]]]:
    """Returns the pictures of each camera, which are named alike, with the frames that their names tell, from 0."""
    series: dict[str, list[tuple[int, ColmapPicture]]] = {}
    for picture in pictures:
        name, number = series_and_number(picture.name)
        series.setdefault(name, []).append((number - first, picture))
    return {name: sorted(found, key=lambda each: each[0]) for name, found in series.items()}


def _numbers(series: list[tuple[int, ColmapPicture]], source: FrameRotations) -> list[int] | None:
    """Returns the frames that pictures show, by name or by how the camera turned; None if they are not of the clip."""
    numbers = [number for number, _ in series]
    steps = source.steps(_camera_of(series[0][1]))
    if steps is None or len(set(numbers)) < len(numbers):
        return numbers
    rotations = np.stack([picture.world_to_camera[:3, :3] for _, picture in series])
    return match_frames(rotations, numbers, steps)


def _matched(name: str, numbers: list[int], *, is_only: bool) -> str:
    """Describes pictures that show other frames than their names say."""
    which = "" if is_only else f" of {name}"
    frames = ", ".join(map(str, numbers[:3]))
    return f"the pictures{which} show frames {frames} ... {numbers[-1]}, as the camera turned, whatever their names say"


@implemented_by(find_poses, options=PoseOptions)
def camera_poses(
    colmap: str | Path,
    motions: str | Path,
    *,
    reference: Reference = "middle",
    readout_ratio: float | None = None,
    fps: float | None = None,
    first_number: int = 0,
    rows: int = 17,
) -> CameraPoses:
    """Finds the camera's pose at each row of the pictures of a COLMAP model.

    Args:
        colmap: folder of the model, binary or text, usually ``sparse/0``.
        motions: motion file of the clip that the pictures are frames of (``unshutter video --save-motion``), or a
            folder with a motion file for each (``unshutter rectify --sequence --save-motion``).

    Returns:
        The poses of all pictures whose motion is known, or shown by the model's points.

    Raises:
        UnshutterError: the model or a motion cannot be used; UsageError: options that do not go together.

    Examples:
        >>> poses = unshutter.camera_poses("sparse/0", "motions.json")  # doctest: +SKIP
        >>> poses.pictures[0].at(1.0) - poses.pictures[0].at(0.0)  # doctest: +SKIP
    """
    ...


def _camera_of(picture: ColmapPicture) -> PictureCamera:
    camera = picture.camera
    return PictureCamera(camera.height, camera.width, camera.focal_px[0])


def _frame_of(picture: ColmapPicture, number: int, source: FrameRotations, options: PoseOptions) -> _Frame | str:
    """Returns a picture as a frame of the video, or why its motion is unknown."""
    camera = picture.camera
    source.check(_camera_of(picture))
    try:
        found = source.motion(picture.name, number)
    except MissingFileError:
        return "no motion file"
    try:
        rotations = rotations_in_picture(found, _camera_of(picture))
    except UnshutterError as error:
        advice = "extract frames as they are stored (ffmpeg -noautorotate)"
        raise UnshutterError(f"{picture.name} of {camera.width}x{camera.height} px: {error}; {advice}") from None
    scan_direction = found.motion.scan_direction
    unknown = ""
    if isinstance(rotations, Reason):
        unknown = str(rotations)
        rotations = np.tile(np.eye(3), (scan_direction.frame_size(camera.height, camera.width)[0], 1, 1))
    count = len(rotations)
    order = np.arange(count, dtype=np.float64)
    is_reversed = scan_direction in (ScanDirection.BOTTOM_TO_TOP, ScanDirection.RIGHT_TO_LEFT)
    share = READOUT_FRACTION[options.reference]
    reference = rotations[round(share * (count - 1))]
    start = source.start_s(number)
    return _Frame(
        picture=picture,
        number=number,
        scan_direction=scan_direction,
        rotations=rotations @ reference.T,
        lines=order[::-1] if is_reversed else order,
        times_s=start + source.readout_s * order / count,
        moment_s=start + source.readout_s * share * (count - 1) / count,
        unknown=unknown,
        unstraightened=partial(_unstraightened, found.motion, _camera_of(picture), options.reference),
    )


def _unstraightened(motion: Motion, camera: PictureCamera, reference: Reference) -> PositionMap:
    """Returns the map from positions in a straightened picture to those in the frame."""
    size = motion.scan_direction.frame_size(camera.height, camera.width)
    return gs_to_rs_map(motion.resized(*size).rereferenced(reference))


def _poses_of(frames: list[_Frame], k: int, source: FrameRotations, at: Float64[np.ndarray, "rows"]) -> PicturePoses:
    """Returns the poses of one of a camera's frames at lines, counted from the first that was read."""
    frame = frames[k]
    near = [frames[j] for j in _near(frames, k, source)]
    lines = np.rint(at).astype(int)
    since_s = frame.times_s[lines] - frame.moment_s
    excess = _apparent_rotation(frame, near, source)
    rotations = rotation_matrix(-since_s[:, None] * excess) @ frame.rotations[lines] @ frame.rotation
    positions = frame.position + _moved(frame, near, since_s)
    poses = np.tile(np.eye(4), (len(at), 1, 1))
    poses[:, :3, :3] = rotations
    poses[:, :3, 3] = -np.einsum("nij,nj->ni", rotations, positions)
    return PicturePoses(
        frame.picture, frame.scan_direction, frame.lines[lines], frame.times_s[lines], poses, bool(near)
    )


def _row_paths(frames: list[list[_Frame]], source: FrameRotations) -> list[RowPath]:
    """Returns what is known of all frames, to be refined together."""
    paths: list[RowPath] = []
    for series in frames:
        start = len(paths)
        for k, frame in enumerate(series):
            poses = _poses_of(series, k, source, np.linspace(0, len(frame.lines) - 1, NODES))
            between_s = frame.times_s[-1] - frame.times_s[0]
            near = _near(series, k, source) if between_s > 0 else []
            neighbours = [(start + j, float(series[j].moment_s - frame.moment_s) / between_s) for j in near]
            paths.append(
                RowPath(
                    frame.picture,
                    frame.scan_direction,
                    _share(frame.scan_direction, frame.picture, poses.lines),
                    poses.world_to_camera,
                    frame.unstraightened,
                    neighbours,
                )
            )
    return paths


def _share(scan_direction: ScanDirection, picture: ColmapPicture, lines: np.ndarray) -> Float64[np.ndarray, "rows"]:
    """Returns which share of the readout has passed at lines of a picture, from -1/2 at the first to 1/2."""
    count, _ = scan_direction.frame_size(picture.camera.height, picture.camera.width)
    is_reversed = scan_direction in (ScanDirection.BOTTOM_TO_TOP, ScanDirection.RIGHT_TO_LEFT)
    share = lines / max(count - 1, 1) - 0.5
    return -share if is_reversed else share


def _refined(poses: PicturePoses, paths: Paths, k: int) -> PicturePoses:
    """Returns the poses of a picture on its refined path."""
    share = _share(poses.scan_direction, poses.picture, poses.lines)
    rotations, positions = paths.at(np.full(len(share), k), share)
    world_to_camera = poses.world_to_camera.copy()
    world_to_camera[:, :3, :3] = rotations
    world_to_camera[:, :3, 3] = -np.einsum("nij,nj->ni", rotations, positions)
    return replace(poses, world_to_camera=world_to_camera)


def _near(frames: list[_Frame], k: int, source: FrameRotations) -> list[int]:
    """Returns the indices of the frames just before and after one, if they are near in time."""
    frame = frames[k]
    others = [j for j in (k - 1, k + 1) if 0 <= j < len(frames) and frames[j].number != frame.number]
    return [j for j in others if source.joined(*sorted((frame.number, frames[j].number)))]


def _moved(frame: _Frame, near: list[_Frame], since_s: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3"]:
    """Returns how far the camera moved since the reference line, along the curve through its neighbours' positions."""
    if not near:
        return np.zeros((len(since_s), 3))
    times = np.array([other.moment_s - frame.moment_s for other in near])
    ways = np.array([other.position - frame.position for other in near])
    powers = np.arange(1, len(near) + 1)
    coefficients = np.linalg.solve(times[:, None] ** powers, ways)
    return since_s[:, None] ** powers @ coefficients


def _apparent_rotation(frame: _Frame, near: list[_Frame], source: FrameRotations) -> Float64[np.ndarray, "3"]:
    """Returns the rate [rad/s] at which the motions turn faster than the model's poses; zero if that is unknown."""
    rates: list[np.ndarray] = []
    for other in near:
        first, last = sorted((frame, other), key=lambda each: each.number)
        rotation = source.rotation_between(first.number, last.number, frame.camera)
        if rotation is None:
            return np.zeros(3)
        tracked = last.from_middle @ rotation @ first.from_middle.T
        posed = last.rotation @ first.rotation.T
        rates.append(rotation_vector(tracked @ posed.T) / (last.moment_s - first.moment_s))
    return np.mean(rates, axis=0) if rates else np.zeros(3)
