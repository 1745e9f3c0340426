"""Curves in a grey picture, straight edges of the scene as bent by the rolling shutter, and robust fits to them.

Segments (likelihood.py) that continue each other are linked, and points on the edge are then located in the picture
itself, because a segment is a chord that hides the bend. Positions are (col, row) px of the given picture.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from unshutter.motion.rotations import rotate_position, rotation_matrix
from unshutter.motion.shapes import Float, Numbers, UInt8
from unshutter.single.likelihood import find_segments

Residuals = Callable[[np.ndarray], np.ndarray]
# residuals -> (cost of each, weight of each: derivative of the cost with respect to the squared residual)
Loss = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def squared(r: Float[np.ndarray, "*at"]) -> tuple[Float[np.ndarray, "*at"], Float[np.ndarray, "*at"]]:
    """Squared loss r^2: nothing is treated as an outlier."""
    return r * r, np.ones_like(r)


def cauchy(r: Float[np.ndarray, "*at"]) -> tuple[Float[np.ndarray, "*at"], Float[np.ndarray, "*at"]]:
    """Cauchy loss log(1 + r^2): the influence of outliers decreases with distance."""
    return np.log1p(r * r), 1 / (1 + r * r)


def geman_mcclure(r: Float[np.ndarray, "*at"]) -> tuple[Float[np.ndarray, "*at"], Float[np.ndarray, "*at"]]:
    """Geman-McClure loss r^2 / (1 + r^2): outliers lose all influence."""
    return r * r / (1 + r * r), 1 / (1 + r * r) ** 2


def minimise(
    residuals: Residuals,
    start: Float[np.ndarray, "unknowns"],
    loss: Loss = squared,
    steps: int = 50,
    tolerance: float = 1e-10,
) -> tuple[Float[np.ndarray, "unknowns"], float]:
    """Minimises the summed costs of residuals [N], near a start [P]; Levenberg-Marquardt with reweighting.

    Residuals are divided by their expected size, unknowns of the order of 1 or less. Steps to non-finite residuals are
    rejected; it ends when a step gains less than ``tolerance`` of the cost, and moves less than its square root.

    Returns:
        Unknowns [P] and their cost, never worse than at the start.
    """
    x = np.array(start, dtype=np.float64)
    r = residuals(x)
    cost = float(loss(r)[0].sum())
    damping = 1e-3
    for _ in range(steps):
        weights = loss(r)[1]
        J = forward_differences(residuals, x, r, 1e-7 * np.maximum(1.0, np.abs(x)))
        normal = (J.T * weights) @ J
        gradient = J.T @ (weights * r)
        while damping < 1e12:
            diagonal = damping * np.maximum(np.diag(normal), 1e-9 * max(float(np.trace(normal)), 1e-300))
            step = -np.linalg.solve(normal + np.diag(diagonal), gradient)
            tried = residuals(x + step)
            tried_cost = float(loss(tried)[0].sum())
            if tried_cost < cost:
                break
            damping *= 10
        else:
            break
        gain, cost = cost - tried_cost, tried_cost
        x, r, damping = x + step, tried, max(damping / 10, 1e-12)
        if gain <= tolerance * cost and np.abs(step).max() < np.sqrt(tolerance):
            break
    return x, cost


def forward_differences(
    residuals: Residuals,
    x: Float[np.ndarray, "*at unknowns"],
    r: Float[np.ndarray, "*at residuals"],
    steps: Float[np.ndarray, "unknowns"],
) -> Float[np.ndarray, "*at residuals unknowns"]:
    """Returns the Jacobian dr/dx, to first order in the changes of the unknowns."""
    columns = []
    for k, step in enumerate(steps):
        moved = x.copy()
        moved[..., k] += step
        columns.append((residuals(moved) - r) / step)
    return np.stack(columns, axis=-1)


POINTS = 10  # per curve
_MOST_SEGMENTS = 600  # the longest are used
_WIDEST_TURN = np.radians(10)  # between a segment and its continuation
_FARTHEST_ASIDE = 2.0  # px between a segment's end and the line of the other
_WIDEST_GAP = 0.25  # of the shorter segment's length,
_LEAST_GAP = 4.0  # px, but at least this
_STEP = 2.0  # px along the edge between points where it is located
_ASIDE = np.arange(-3, 3.01, 0.5)  # px across the edge
_OFFSET = 0.1  # px to the side of the curve, for measuring how rectification scales distances
_LEAST_GROWTH = 0.1
_FAINTEST = 2.0  # grey levels per px; least slope of an edge


def find_curves(grey: UInt8[np.ndarray, "height width"], shortest: float) -> Float[np.ndarray, "curves points 2"]:
    """Finds edges, no shorter than ``shortest`` [px], that may be straight lines of the scene, longest first.

    Points (col, row) [px] along each curve go from end to end.
    """
    segments = find_segments(grey, _MOST_SEGMENTS)
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0).astype(np.float32)
    curves = [_even_points(_edge_points(smooth, segments[chain])) for chain in link(segments)]
    lengths = np.array([curve_length(c) for c in curves])
    order = [i for i in np.argsort(-lengths, kind="stable") if lengths[i] >= shortest]
    return np.stack([curves[i] for i in order]) if order else np.zeros((0, POINTS, 2))


def curve_length(points: Float[np.ndarray, "*curves points 2"]) -> Float[Numbers, "*curves"]:
    """Returns the distance between the ends of curves [..., K, 2] -> [...]."""
    return np.linalg.norm(points[..., -1, :] - points[..., 0, :], axis=-1)


def principal_lines(
    points: Float[np.ndarray, "*curves points 2"],
) -> tuple[Float[np.ndarray, "*curves points"], Float[np.ndarray, "*curves"]]:
    """Fits a least-squares line to each curve.

    Returns:
        Signed distances of the points from it, and its direction as an angle in (-pi/2, pi/2] [rad], columns towards
        rows.
    """
    x, y = np.moveaxis(points - points.mean(axis=-2, keepdims=True), -1, 0)
    angle = np.arctan2(2 * (x * y).sum(-1), (x * x - y * y).sum(-1)) / 2
    return y * np.cos(angle)[..., None] - x * np.sin(angle)[..., None], angle


class RotatedCurves:
    """Curves (col, row) [px] in a picture with rotated rows, and their remaining bends after undoing rotations."""

    def __init__(self, points: Float[np.ndarray, "*curves points 2"], height: int, width: int, focal_px: float):
        self.points, self.height, self.width, self.focal_px = points, height, width, focal_px
        angle = principal_lines(points)[1]
        normals = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)[..., None, :]
        self._near = np.stack([points, points + normals * _OFFSET])  # [2, ..., K, 2]

    def __getitem__(self, index: np.ndarray) -> RotatedCurves:
        """Returns a selection of the curves, in the shape of the index."""
        return RotatedCurves(self.points[index], self.height, self.width, self.focal_px)

    def undone(
        self, rotations: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[Float[np.ndarray, "*curves points 2"], Float[np.ndarray, "*curves points"]]:
        """Rectifies the curves.

        Args:
            rotations: u = (row + 1/2) / rows [...] -> rotation vectors [..., 3] [rad].

        Returns:
            Rectified points [..., K, 2], and their distances from the least-squares lines of their curves [..., K],
            both [px]. Distances are in the original picture (to first order), so that squeezing or shearing the
            rectified one has no advantage.
        """
        col, row = self._near[..., 0], self._near[..., 1]
        undo = rotation_matrix(rotations((row + 0.5) / self.height)).swapaxes(-1, -2)
        center = ((self.width - 1) / 2, (self.height - 1) / 2)
        points, off_curve = np.stack(rotate_position(col, row, undo, self.focal_px, center), axis=-1)
        distance, angle = principal_lines(points)
        moved = (off_curve - points) / _OFFSET
        growth = moved[..., 1] * np.cos(angle)[..., None] - moved[..., 0] * np.sin(angle)[..., None]
        return points, distance / np.maximum(np.abs(growth), _LEAST_GROWTH)


def link(segments: Float[np.ndarray, "segments 4"]) -> list[list[int]]:
    """Links segments that continue each other end to end into chains, each segment in one chain.

    Two are linked if each is the best continuation of the other: bright side on the same side (LSD orders end points
    by it), similar direction, small lateral offset, small gap. The nearest win. Returns indices in order.
    """
    if not len(segments):
        return []
    start, end = segments[:, :2], segments[:, 2:]
    along = end - start
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    along = along / length[:, None]
    gap = start[None] - end[:, None]  # [from, to, 2]
    distance = np.linalg.norm(gap, axis=2)
    aside = np.maximum(np.abs(_cross(along[:, None], gap)), np.abs(_cross(along[None], gap)))
    forward = np.minimum(_dot(along[:, None], gap), _dot(along[None], gap))  # negative if they overlap
    allowed = np.maximum(_WIDEST_GAP * np.minimum(length[:, None], length[None]), _LEAST_GAP)
    fits = (_dot(along[:, None], along[None]) > np.cos(_WIDEST_TURN)) & (aside < _FARTHEST_ASIDE)
    fits &= (distance < allowed) & (forward > -_LEAST_GAP) & ~np.eye(len(segments), dtype=bool)
    cost = np.where(fits, distance + aside, np.inf)
    best_next, best_last = cost.argmin(axis=1), cost.argmin(axis=0)
    index = np.arange(len(segments))
    linked = np.isfinite(cost[index, best_next]) & (best_last[best_next] == index)
    follows = {int(i): int(best_next[i]) for i in index[linked]}
    return _chains(follows, len(segments))


def _chains(follows: dict[int, int], count: int) -> list[list[int]]:
    heads = [i for i in range(count) if i not in set(follows.values())]
    chains, linked = [], set()
    for first in [*heads, *range(count)]:  # a closed ring has no head and is opened anywhere
        chain = []
        while first not in linked:
            linked.add(first)
            chain.append(first)
            first = follows.get(first, first)
        if chain:
            chains.append(chain)
    return chains


def _edge_points(smooth: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Returns points [M, 2] on the edge near a chain of segments [S, 4], where brightness changes fastest across it."""
    samples, normals = [], []
    for col1, row1, col2, row2 in segments:
        length = max(np.hypot(col2 - col1, row2 - row1), 1e-9)
        along = np.array([col2 - col1, row2 - row1]) / length
        places = np.linspace(0, length, max(int(length / _STEP) + 1, 2))
        samples.append(np.array([col1, row1]) + places[:, None] * along)
        normals.append(np.broadcast_to([-along[1], along[0]], (len(places), 2)))
    at, across = np.concatenate(samples), np.concatenate(normals)
    looked_at = (at[:, None] + across[:, None] * _ASIDE[:, None]).astype(np.float32)
    profile = cv2.remap(smooth, looked_at[..., 0], looked_at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    step = _ASIDE[1] - _ASIDE[0]
    slope = (profile[:, 2:] - profile[:, :-2]).astype(np.float64) / (2 * step)
    slope = slope * np.sign(slope.sum(axis=0)[len(_ASIDE) // 2 - 1] or 1.0)  # the same side is bright throughout
    peak = slope.argmax(axis=1)
    index = np.arange(len(peak))
    edge = (slope[index, peak] > _FAINTEST) & (peak > 0) & (peak < slope.shape[1] - 1)
    if edge.sum() < max(0.5 * len(edge), 2):
        return at
    index, peak = index[edge], peak[edge]
    before, top, after = (slope[index, peak + k] for k in (-1, 0, 1))
    offset = _ASIDE[peak + 1] + step * 0.5 * (before - after) / np.minimum(before - 2 * top + after, -1e-9)
    return at[edge] + across[edge] * offset[:, None]


def _even_points(points: np.ndarray) -> np.ndarray:
    """Returns POINTS points along a curve [M, 2], each the mean of the nearby ones; ends are kept."""
    middle = points.mean(axis=0)
    direction = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    along = (points - middle) @ direction
    ordered = points[np.argsort(along, kind="stable")]
    if len(ordered) < 2 * POINTS:
        at = np.linspace(0, len(ordered) - 1, POINTS)
        return np.stack([np.interp(at, np.arange(len(ordered)), ordered[:, k]) for k in (0, 1)], axis=1)
    return np.stack([part.mean(axis=0) for part in np.array_split(ordered, POINTS)])


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
