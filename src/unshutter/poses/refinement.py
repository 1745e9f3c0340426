"""Refines the poses of lines against the points of a model and the lines on which its pictures show them.

COLMAP takes each picture for one moment. In a model of frames as the camera read them, positions, rotations and points
are therefore wrong, by centimetres for a camera in a hand; where frames were straightened, what is left of the
distortion has the same effect. All are adjusted together (adjustment.py), each line with a pose of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from unshutter.motion.grid import PositionMap
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.motion.shapes import Float64
from unshutter.orientation import ScanDirection
from unshutter.poses.adjustment import Neighbours, Observations, Paths, adjusted, errors_px, minimised
from unshutter.poses.colmap import FISHEYES, LITTLE_BENT, ColmapPicture, ColmapPoints

NODES = 33  # lines of a picture between which the bend of the camera's path is interpolated
_FEWEST = 30  # observations of a picture that is refined
_MOST = 800  # observations of a picture that are used, about
_AT_ONCE = 300_000  # observations
_HELD_OUT = 10  # one observation in this many tests the others
_BETTER = 0.98  # share of the error that must be left at most
_WORST_PX = 4.0  # median error of a model that is refined
_TURNS_RAD = 1e-3  # rms within a readout below which straightened pictures hardly differ from others
_STRAIGHTENED = 0.35  # share of their motion that pictures show if they were not straightened, at least


@dataclass(frozen=True, eq=False)
class RowPath:
    """What is known of a picture before its path is refined.

    Attributes:
        picture: in the model.
        scan_direction: direction in which it was read.
        share: [NODES] of the readout that has passed at some lines, from -1/2 to 1/2, evenly spaced.
        world_to_camera: [NODES, 4, 4] pose at each.
        unstraightened: returns the map from positions in the straightened picture to those in the frame.
        neighbours: indices of the pictures just before and after, and the time to each in readouts (negative before).
    """

    picture: ColmapPicture
    scan_direction: ScanDirection
    share: Float64[np.ndarray, "nodes"]
    world_to_camera: Float64[np.ndarray, "nodes 4 4"]
    unstraightened: Callable[[], PositionMap]
    neighbours: list[tuple[int, float]]


@dataclass(frozen=True, eq=False)
class Refinement:
    """The refined paths of pictures.

    Attributes:
        paths: of all pictures, in the model's axes and scale.
        points: [M, 3] where the model's points then are.
        is_refined: [P] whether each picture's path was taken; others keep the one that they had.
        note: what was done, or why nothing was, in a few words.
    """

    paths: Paths
    points: Float64[np.ndarray, "points 3"]
    is_refined: np.ndarray
    note: str


def refined(rows: list[RowPath], model: ColmapPoints) -> Refinement:
    """Refines the paths of pictures; those that show few points, or contradict them, keep theirs."""
    before = _paths_of(rows)
    numbers, points = model.numbers, model.places

    def unchanged(why: str) -> Refinement:
        return Refinement(before, points, np.zeros(len(rows), bool), f"not refined: {why}")

    if not rows:
        return unchanged("no picture has a motion")
    if not len(numbers):
        return unchanged("the model has no points")
    seen = _observations(rows, numbers, straightened=False)
    if not len(seen.point):
        unknown = {each.picture.camera.model for each in rows} - {*LITTLE_BENT, *FISHEYES}
        why = f"not of lenses {', '.join(sorted(unknown))}" if unknown else "no picture shows its points"
        return unchanged(why)
    neighbours = _neighbours(rows)
    if not neighbours.known.any():
        return unchanged("pictures are more than a second apart")
    used, tests = _chosen(seen, len(rows), len(points))
    still = _without_motion(before)
    of_model = errors_px(still, points, tests)  # each picture taken for one moment, as by COLMAP
    if _were_straightened(before, points, used, neighbours):
        seen = _observations(rows, numbers, straightened=True)
        used, tests = _chosen(seen, len(rows), len(points))
    has_enough = np.bincount(used.picture, minlength=len(rows)) >= _FEWEST
    if not has_enough.any() or len(tests.point) < _FEWEST:
        return unchanged("too few points")
    # the bend of a motion that was found in frames may be wrong, and that of a gyro is right: the observations tell
    even = replace(before, turn_bends=still.turn_bends, shift_bends=still.shift_bends)
    trials = [adjusted(paths, points, used, neighbours) for paths in (before, even)]
    errors = [errors_px(*trial, tests) for trial in trials]
    best = int(np.argmin([np.median(each) for each in errors]))
    was = errors_px(before, points, tests)
    was_px, is_px = float(min(np.median(was), np.median(of_model))), float(np.median(errors[best]))
    if not is_px < min(_BETTER * was_px, _WORST_PX):
        return unchanged(f"points are {was_px:.2f} px off, and would be {is_px:.2f}")
    is_better = has_enough & _improved(was, errors[best], tests.picture, len(rows))
    note = f"refined: points are {is_px:.2f} px off instead of {was_px:.2f}"
    if left := int(np.sum(~is_better)):
        note += f", but of {left} {'picture' if left == 1 else 'pictures'} with few points or contradictory ones"
    after, moved_points = trials[best]
    moved_points = _triangulated(after, moved_points, seen, neighbours)
    return Refinement(*_aligned(after, moved_points, before), is_better, note)


def _triangulated(paths: Paths, points: np.ndarray, seen: Observations, neighbours: Neighbours) -> np.ndarray:
    """Returns all points as the paths see them, unchanged."""
    part = np.cumsum(np.bincount(seen.point, minlength=len(points))) // _AT_ONCE
    for number in np.unique(part[seen.point]):
        some = seen[part[seen.point] == number]
        _, points = minimised(paths, points, some, neighbours, np.zeros(0, int), steps=5)
    return points


def _paths_of(rows: list[RowPath]) -> Paths:
    """Converts poses at lines to paths: the way from the first line to the last, and the bend."""
    poses = np.array([each.world_to_camera for each in rows]).reshape(len(rows), NODES, 4, 4)
    rotations = poses[:, :, :3, :3]
    positions = -np.einsum("pnji,pnj->pni", rotations, poses[:, :, :3, 3])
    middle = poses.shape[1] // 2
    turns = rotation_vector(rotations[:, -1] @ np.swapaxes(rotations[:, 0], -1, -2))
    shifts = positions[:, -1] - positions[:, 0]
    share = np.array([each.share for each in rows]).reshape(len(rows), NODES, 1)
    here = rotations[:, middle]
    turned = rotations @ np.swapaxes(here, -1, -2)[:, None]
    turn_bends = rotation_vector(rotation_matrix(-share * turns[:, None]) @ turned)
    shift_bends = positions - positions[:, middle, None] - share * shifts[:, None]
    return Paths(here, positions[:, middle], turns, shifts, turn_bends, shift_bends)


def _without_motion(paths: Paths) -> Paths:
    """Returns paths that stay at the pose of the middle line."""
    rest = np.zeros_like(paths.turns)
    straight = np.zeros_like(paths.turn_bends)
    return replace(paths, turns=rest, shifts=rest, turn_bends=straight, shift_bends=straight)


def _neighbours(rows: list[RowPath]) -> Neighbours:
    index = np.repeat(np.arange(len(rows))[:, None], 2, axis=1)
    readouts = np.full((len(rows), 2), np.nan)
    for k, each in enumerate(rows):
        for other, time in each.neighbours:
            side = int(time > 0)
            index[k, side] = other
            readouts[k, side] = time
    return Neighbours(index, readouts)


def _observations(rows: list[RowPath], numbers: np.ndarray, *, straightened: bool) -> Observations:
    """Returns what the pictures show of the points, on the lines on which the camera read it."""
    found: list[Observations] = []
    for k, each in enumerate(rows):
        camera = each.picture.camera
        col, row = each.picture.seen.T - 0.5
        if straightened:
            col, row = each.unstraightened()(col, row)
        height, width = camera.height, camera.width
        lines, _ = each.scan_direction.frame_size(height, width)
        line = each.scan_direction.points_to_frame(col, row, height, width)[1]
        directions = camera.directions(np.stack([col, row], axis=1) + 0.5)
        point = np.searchsorted(numbers, each.picture.numbers)
        point[point == len(numbers)] = 0
        known = np.isfinite(directions).all(axis=1) & (numbers[point] == each.picture.numbers)
        known &= np.bincount(point, minlength=len(numbers))[point] == 1  # a point that is seen twice is not one
        count = int(known.sum())
        found.append(
            Observations(
                np.full(count, k),
                point[known],
                line[known] / max(lines - 1, 1) - 0.5,
                directions[known],
                np.full(count, camera.focal_px[0]),
            )
        )
    return Observations.joined(found)


def _were_straightened(paths: Paths, points: np.ndarray, seen: Observations, neighbours: Neighbours) -> bool:
    """Whether pictures do not show the motion within them, so that they must have been straightened.

    Each picture's path is fitted to the points as they are, from none on, and compared with the motion that is known.
    """
    still = replace(paths, turns=np.zeros_like(paths.turns), shifts=np.zeros_like(paths.shifts))
    every = np.arange(len(paths.turns))
    fitted, _ = minimised(still, points, seen, neighbours, every, steps=3, move_points=False)
    size = np.sum(paths.turns**2)
    if np.sqrt(size / len(paths.turns)) < _TURNS_RAD:
        return False
    return float(np.sum(fitted.turns * paths.turns) / size) < _STRAIGHTENED


def _chosen(seen: Observations, pictures: int, points: int) -> tuple[Observations, Observations]:
    """Returns the observations that are used, of the points that most pictures show, and those that test them."""
    lengths = np.bincount(seen.point, minlength=points)
    order = np.argsort(-lengths, kind="stable")
    by_point = np.argsort(seen.point, kind="stable")
    starts = np.concatenate([[0], np.cumsum(lengths)])
    shown = np.zeros(pictures, int)
    used = np.zeros(points, bool)
    for point in order[: np.sum(lengths >= 3)]:
        where = seen.picture[by_point[starts[point] : starts[point + 1]]]
        if (shown[where] < _MOST).any():
            used[point] = True
            shown[where] += 1
    seen = seen[used[seen.point]]
    is_test = (7 * seen.picture + seen.point) % _HELD_OUT == 0
    kept = np.bincount(seen.point[~is_test], minlength=points)
    is_test &= kept[seen.point] >= 3
    return seen[~is_test], seen[is_test]


def _improved(before: np.ndarray, after: np.ndarray, picture: np.ndarray, pictures: int) -> np.ndarray:
    """Returns for which pictures [P] the median error became smaller; those without a test pass it."""
    better = np.ones(pictures, bool)
    for k in np.unique(picture):
        here = picture == k
        better[k] = np.median(after[here]) <= np.median(before[here])
    return better


def _aligned(paths: Paths, points: np.ndarray, to: Paths) -> tuple[Paths, np.ndarray]:
    """Returns paths and points in the axes and scale of other paths: an adjustment leaves both free."""
    u, _, v = np.linalg.svd(np.einsum("pji,pjk->ik", to.rotations, paths.rotations))
    turn = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    middle, wanted_middle = paths.positions.mean(axis=0), to.positions.mean(axis=0)
    turned = (paths.positions - middle) @ turn.T
    size = np.sum(turned**2)
    scale = float(np.sum(turned * (to.positions - wanted_middle)) / size) if size > 0 else 1.0
    aligned = replace(
        paths,
        rotations=paths.rotations @ turn.T,
        positions=scale * turned + wanted_middle,
        shifts=scale * paths.shifts @ turn.T,
        shift_bends=scale * paths.shift_bends @ turn.T,
    )
    return aligned, scale * (points - middle) @ turn.T + wanted_middle
