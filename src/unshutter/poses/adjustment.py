"""Bundle adjustment of pictures that were read line by line: their poses, how these change, and the points, in NumPy.

Convention: u is the share of the readout that has passed at a line, from -1/2 at the first line to 1/2 at the last. A
picture's pose at u is

    R(u) = exp(u w) exp(s(u)) R,        c(u) = c + u g + q(u)

R is a rotation from the world to the camera's axes, c the camera's position in the world; s and q, the bends of the
path, are known. Unknown are R, c, w and g of each picture, and the points. The error of an observation is the angle
between the direction in which the picture shows a point and that of the point, times the focal length.

All pictures could turn too fast, in a scene that is stretched to match: if they were read in the same direction,
observations barely tell (Albl et al., "Degeneracies in rolling shutter SfM", ECCV 2016). So w and g are also held near
the rates at which poses change from picture to picture, as far as these rates are themselves even.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.motion.shapes import Float64

_UNKNOWNS = 12  # of a picture: R, c, w, g
_WINDOW = 300  # pictures that are adjusted at once
_SETTLED = 1e-3  # share of the cost by which the last step lowers it
_SHARPEST_PX = 0.2  # scale of Cauchy's loss, at least
_TOGETHER = 100  # errors of observations go together: this many count as one ...
_TYPICAL_PX = 0.1  # ... of at most this error: a larger one means that the paths do not fit yet
_MEDIAN_SQUARE = 1.386  # of an error's length, if its coordinates have variance 1
_RATE_ERROR = 0.03  # share of the rates from picture to picture by which the readout time is taken to be wrong


@dataclass(frozen=True, eq=False)
class Paths:
    """The camera's path during each picture; attributes as above."""

    rotations: Float64[np.ndarray, "pictures 3 3"]
    positions: Float64[np.ndarray, "pictures 3"]
    turns: Float64[np.ndarray, "pictures 3"]  # w [rad per readout]
    shifts: Float64[np.ndarray, "pictures 3"]  # g [per readout]
    turn_bends: Float64[np.ndarray, "pictures nodes 3"]  # s(u) at evenly spaced u from -1/2 to 1/2
    shift_bends: Float64[np.ndarray, "pictures nodes 3"]  # q(u)

    def at(
        self, picture: np.ndarray, share: Float64[np.ndarray, "at"]
    ) -> tuple[Float64[np.ndarray, "at 3 3"], Float64[np.ndarray, "at 3"]]:
        """Returns R(u) and c(u) of pictures [at] at shares u."""
        nodes = self.turn_bends.shape[1]
        place = (share + 0.5) * (nodes - 1)
        node = np.clip(place.astype(int), 0, nodes - 2)
        part = (place - node)[:, None]
        bends = (
            (1 - part) * table[picture, node] + part * table[picture, node + 1]
            for table in (self.turn_bends, self.shift_bends)
        )
        turn_bend, shift_bend = bends
        along = share[:, None]
        rotations = rotation_matrix(along * self.turns[picture]) @ rotation_matrix(turn_bend) @ self.rotations[picture]
        return rotations, self.positions[picture] + along * self.shifts[picture] + shift_bend

    @property
    def rates(self) -> Float64[np.ndarray, "pictures 6"]:
        """The turns w and shifts g."""
        return np.concatenate([self.turns, self.shifts], axis=1)

    def moved(self, by: Float64[np.ndarray, "pictures 12"]) -> Paths:
        """Returns the paths after a step of the unknowns."""
        return replace(
            self,
            rotations=rotation_matrix(by[:, :3]) @ self.rotations,
            positions=self.positions + by[:, 3:6],
            turns=self.turns + by[:, 6:9],
            shifts=self.shifts + by[:, 9:],
        )


@dataclass(frozen=True, eq=False)
class Observations:
    """Points that pictures show."""

    picture: np.ndarray  # [N] index of the picture
    point: np.ndarray  # [N] index of the point
    share: Float64[np.ndarray, "observations"]  # u of the line that shows it
    direction: Float64[np.ndarray, "observations 3"]  # unit vector in the camera's axes
    focal_px: Float64[np.ndarray, "observations"]

    def __getitem__(self, some: np.ndarray) -> Observations:
        return Observations(*(getattr(self, each.name)[some] for each in fields(self)))

    @classmethod
    def joined(cls, parts: list[Observations]) -> Observations:
        """Returns several as one."""
        return cls(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls)))

    @property
    def across(self) -> Float64[np.ndarray, "observations 2 3"]:
        """Two unit vectors at right angles to each direction, times the focal length."""
        helper = np.where(np.abs(self.direction[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        first = np.cross(self.direction, helper)
        first /= np.linalg.norm(first, axis=1)[:, None]
        second = np.cross(self.direction, first)
        return np.stack([first, second], axis=1) * self.focal_px[:, None, None]


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The pictures just before and after each one."""

    index: np.ndarray  # [P, 2]; the picture itself where there is none
    readouts: Float64[np.ndarray, "pictures 2"]  # time to each, negative to the one before; NaN: none

    @property
    def known(self) -> np.ndarray:
        """[P] whether a picture has one."""
        return np.any(np.isfinite(self.readouts), axis=1, keepdims=False)

    def rates(self, paths: Paths) -> tuple[Float64[np.ndarray, "pictures 6"], Float64[np.ndarray, "6"]]:
        """Returns how fast the camera turns and moves per readout, and how exact that is; zero where it is unknown.

        A rate is that of the parabola through both neighbours, or of the line to the only one. Its error shows in how
        the rates before and after a picture differ, and in how unevenly the paths within pictures differ from it.
        """
        turned = rotation_vector(paths.rotations[self.index] @ np.swapaxes(paths.rotations, -1, -2)[:, None])
        moved = paths.positions[self.index] - paths.positions[:, None]
        sides = np.concatenate([turned, moved], axis=2) / self.readouts[:, :, None]  # [P, 2, 6]
        before, after = np.abs(self.readouts).T[:, :, None]
        parabola = (sides[:, 0] * after + sides[:, 1] * before) / (before + after)
        both = np.isfinite(parabola[:, 0])
        rates = np.where(both[:, None], parabola, np.nansum(sides, axis=1))
        uneven = 0.5 * (sides[both, 1] - sides[both, 0]) if both.any() else rates
        apart = np.std((paths.rates - rates)[self.known], axis=0)
        variances = [
            _mean_square(uneven[:, of]) + _RATE_ERROR**2 * _mean_square(rates[:, of]) + apart[of].max() ** 2
            for of in (slice(3), slice(3, 6))
        ]
        return rates, np.sqrt(np.repeat(variances, 3)) + 1e-12


def _mean_square(values: np.ndarray) -> float:
    return float(np.mean(values**2))


def errors_px(paths: Paths, points: np.ndarray, seen: Observations) -> Float64[np.ndarray, "observations"]:
    """Returns how far each observation is from its point [px]."""
    return np.linalg.norm(_errors(paths, points, seen, seen.across), axis=1)


def _errors(paths: Paths, points: np.ndarray, seen: Observations, across: np.ndarray) -> np.ndarray:
    """Returns the errors [N, 2] along two directions [N, 2, 3] across each observation's."""
    rotations, positions = paths.at(seen.picture, seen.share)
    towards = rotations @ (points[seen.point] - positions)[:, :, None]
    return (across @ towards)[:, :, 0] / np.linalg.norm(towards, axis=1)


def adjusted(
    paths: Paths, points: Float64[np.ndarray, "points 3"], seen: Observations, neighbours: Neighbours
) -> tuple[Paths, Float64[np.ndarray, "points 3"]]:
    """Adjusts paths and points to observations.

    Of many pictures, a window is adjusted among the others, and the next one overlaps it by half: the normal equations
    of all would not fit into memory.
    """
    count = len(paths.positions)
    if count <= _WINDOW:
        return minimised(paths, points, seen, neighbours, np.arange(count))
    for start in range(0, count - _WINDOW // 2, _WINDOW // 2):
        free = np.arange(start, min(start + _WINDOW, count))
        in_window = np.zeros(len(points), bool)
        in_window[seen.point[np.isin(seen.picture, free)]] = True
        paths, points = minimised(paths, points, seen[in_window[seen.point]], neighbours, free)
    return paths, points


def minimised(
    paths: Paths,
    points: Float64[np.ndarray, "points 3"],
    seen: Observations,
    neighbours: Neighbours,
    free: np.ndarray,
    *,
    steps: int = 12,
    move_points: bool = True,
) -> tuple[Paths, Float64[np.ndarray, "points 3"]]:
    """Minimises a robust cost (Cauchy's) by Levenberg and Marquardt's method.

    Args:
        free: indices of the pictures that move.
    """
    shown, point = np.unique(seen.point, return_inverse=True)
    all_points, points = points, points[shown]
    seen = replace(seen, point=point)
    across = seen.across
    damping = 1e-4
    for _ in range(steps):
        system = _System.of(paths, points, seen, across, neighbours, free)
        start = system.cost(paths, points)
        while damping < 1e3:
            step, point_step = system.solved(damping) if move_points else (system.solved_alone(damping), 0.0)
            moved, moved_points = paths.moved(step), points + point_step
            cost = system.cost(moved, moved_points)
            if cost < start:
                break
            damping *= 10
        else:
            break
        paths, points = moved, moved_points
        damping = max(damping / 5, 1e-8)
        if cost > (1 - _SETTLED) * start:
            break
    all_points = all_points.copy()
    all_points[shown] = points
    return paths, all_points


@dataclass(frozen=True, eq=False)
class _System:
    """The normal equations of a step."""

    seen: Observations
    across: np.ndarray
    free: np.ndarray  # indices of the pictures that move
    scale_px: float  # of Cauchy's loss
    rates: np.ndarray  # [P, 6] that w and g are held near, and how strongly [P, 6]
    hold: np.ndarray
    pictures: np.ndarray  # [P, 12, 12], with right sides [P, 12]
    picture_side: np.ndarray
    points: np.ndarray  # [M, 3, 3], with right sides [M, 3]
    point_side: np.ndarray
    mixed: np.ndarray  # [N, 12, 3] of each observation's picture and point

    @classmethod
    def of(
        cls,
        paths: Paths,
        points: np.ndarray,
        seen: Observations,
        across: np.ndarray,
        neighbours: Neighbours,
        free: np.ndarray,
    ) -> _System:
        """Linearises the errors, each with the weight that Cauchy's loss gives it."""
        errors, by_picture, by_point = _linearised(paths, points, seen, across)
        squares = np.sum(errors**2, axis=1)
        variance = float(np.median(squares)) / _MEDIAN_SQUARE
        scale_px = max(_SHARPEST_PX, 2.5 * np.sqrt(variance))
        weight = (1 / (1 + squares / scale_px**2))[:, None, None]
        to_picture = np.swapaxes(by_picture * weight, 1, 2)
        to_point = np.swapaxes(by_point * weight, 1, 2)
        error = errors[:, :, None]
        pictures = _summed(to_picture @ by_picture, seen.picture, len(paths.positions))
        picture_side = _summed((to_picture @ error)[:, :, 0], seen.picture, len(paths.positions))
        rates, rate_errors = neighbours.rates(paths)
        hold = _TOGETHER * min(variance, _TYPICAL_PX**2) / rate_errors**2 * neighbours.known[:, None]
        diagonal = np.arange(6, _UNKNOWNS)
        pictures[:, diagonal, diagonal] += hold
        picture_side[:, 6:] += hold * (paths.rates - rates)
        return cls(
            seen=seen,
            across=across,
            free=free,
            scale_px=scale_px,
            rates=rates,
            hold=hold,
            pictures=pictures,
            picture_side=picture_side,
            points=_summed(to_point @ by_point, seen.point, len(points)),
            point_side=_summed((to_point @ error)[:, :, 0], seen.point, len(points)),
            mixed=to_picture @ by_point,
        )

    def cost(self, paths: Paths, points: np.ndarray) -> float:
        """Returns what the adjustment minimises."""
        squares = np.sum(_errors(paths, points, self.seen, self.across) ** 2, axis=1)
        losses = self.scale_px**2 * np.log1p(squares / self.scale_px**2)
        return float(losses.sum() + np.sum(self.hold * (paths.rates - self.rates) ** 2))

    def solved_alone(self, damping: float) -> np.ndarray:
        """Returns the step of the pictures [P, 12] among points that stay."""
        return -np.linalg.solve(_damped(self.pictures, damping), self.picture_side[:, :, None])[:, :, 0]

    def solved(self, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns the step of the pictures [P, 12] and of the points [M, 3], by Schur's complement of the points."""
        seen, free = self.seen, self.free
        count = len(free)
        inverse = np.linalg.inv(_damped(self.points, damping))
        through = self.mixed @ inverse[seen.point]  # [N, 12, 3]
        known = (through @ self.point_side[seen.point, :, None])[:, :, 0]
        side = (self.picture_side - _summed(known, seen.picture, len(self.pictures)))[free]
        reduced = np.zeros((count, _UNKNOWNS, count, _UNKNOWNS))
        every = np.arange(count)
        reduced[every, :, every, :] = _damped(self.pictures[free], damping)
        row = np.full(len(self.pictures), -1)
        row[free] = every
        moving = np.flatnonzero(row[seen.picture] >= 0)
        place = np.full((count, len(self.points)), -1, np.int32)  # of each free picture's observation of each point
        place[row[seen.picture[moving]], seen.point[moving]] = moving
        for k in range(count):
            shown = np.flatnonzero(place[k] >= 0)
            own = place[k, shown]
            others = place[k:, shown]
            for other in np.flatnonzero((others >= 0).any(axis=1)):
                shared = others[other] >= 0
                one = through[own[shared]].transpose(1, 0, 2).reshape(_UNKNOWNS, -1)
                two = self.mixed[others[other, shared]].transpose(1, 0, 2).reshape(_UNKNOWNS, -1)
                block = one @ two.T
                reduced[k, :, k + other, :] -= block
                if other:
                    reduced[k + other, :, k, :] -= block.T
        matrix = reduced.reshape(count * _UNKNOWNS, count * _UNKNOWNS)
        diagonal = np.arange(len(matrix))
        matrix[diagonal, diagonal] *= 1 + 1e-9  # place, scale and direction of the whole are free
        step = np.zeros_like(self.picture_side)
        step[free] = -np.linalg.solve(matrix, side.ravel()).reshape(count, _UNKNOWNS)
        moved = (np.swapaxes(self.mixed, 1, 2) @ step[seen.picture, :, None])[:, :, 0]
        total = self.point_side + _summed(moved, seen.point, len(self.points))
        return step, -(inverse @ total[:, :, None])[:, :, 0]


def _damped(blocks: np.ndarray, damping: float) -> np.ndarray:
    """Adds to the diagonals of matrices [N, k, k], by a share of themselves."""
    diagonal = np.arange(blocks.shape[1])
    damped = blocks.copy()
    damped[:, diagonal, diagonal] += damping * blocks[:, diagonal, diagonal]
    damped[:, diagonal, diagonal] += 1e-9 * np.max(np.abs(blocks), initial=0.0)  # what nothing shows does not move
    return damped


def _summed(values: np.ndarray, index: np.ndarray, count: int) -> np.ndarray:
    """Sums values [N, ...] of the same index."""
    flat = values.reshape(len(values), -1)
    columns = [np.bincount(index, flat[:, k], count) for k in range(flat.shape[1])]
    return np.stack(columns, axis=1).reshape(count, *values.shape[1:])


def _linearised(
    paths: Paths, points: np.ndarray, seen: Observations, across: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the errors [N, 2] and their derivatives by the unknowns of the pictures [N, 2, 12] and points [N, 2, 3].

    With d the direction from the camera to a point, turning the camera by a small vector t adds t x d.
    """
    rotations, positions = paths.at(seen.picture, seen.share)
    towards = np.einsum("nij,nj->ni", rotations, points[seen.point] - positions)
    distance = np.linalg.norm(towards, axis=1)[:, None]
    unit = towards / distance
    errors = np.einsum("nij,nj->ni", across, unit)
    by_towards = (across - errors[:, :, None] * unit[:, None, :]) / distance[:, :, None]  # [N, 2, 3]
    by_turn = np.cross(towards[:, None, :], by_towards)
    by_point = by_towards @ rotations
    along = seen.share[:, None, None]
    return errors, np.concatenate([by_turn, -by_point, along * by_turn, -along * by_point], axis=2), by_point
