"""Optical flow between two frames, and the dense motion that follows from it: a velocity for every pixel.

Most of the motion is common to the whole picture: a homography of tracked corners removes it first, and dense inverse
search (DIS: Kroeger, Timofte, Dai, Van Gool, ECCV 2016, in OpenCV) finds the rest. A pixel that leaves the picture has
no match; its flow is that of the homography.

With a velocity for every pixel, near and far objects may move differently. Content that flow F carries from row y of
one frame to the next takes 1 + ratio F_y / H frame intervals; its velocity V is F divided by that time, and is taken as
constant. A point that a frame shows at position p at the time tau is at

    q = p - V (tau - t)

at the time t, so a picture of the time t samples the frame at p = q + V (tau(p) - t). If V is known at the pixels q of
that picture, p has a closed form (``_look``); if it is known at the pixels p of a frame, it is a fixed point.

All lengths are in pixels of the small grey copies in which the flow was computed.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, cast

import cv2
import numpy as np

from unshutter.frames.frame_motion import Timing
from unshutter.frames.tracks import MIN_TRACKS, lucas_kanade, picture_shift
from unshutter.motion.shapes import Float, Float32, Float64, UInt8

NO_ARRAY: Any = None  # OpenCV's stubs do not allow None; 5.0 would treat an empty array as a map


@dataclass(frozen=True)
class DenseParams:
    """Parameters of the dense model (docs/research/frames.md, frames-attempts.md).

    Lengths are in px of the small copies; differences in grey levels, of 8 bits.
    """

    patch: int = 12  # of DIS; larger patches than OpenCV's presets
    stride: int = 4  # from one to the next
    descents: int = 25
    refinements: int = 5
    consistent: float = 1.5  # largest forward-backward error of consistent flow
    corners: int = 600
    quality: float = 0.005  # of corners: share of the best one's strength
    distance: int = 5  # between corners
    window: int = 15  # of Lucas-Kanade tracking
    returns_px: float = 0.5  # largest forward-backward error of a tracked corner
    inlier: float = 1.0  # largest distance from the homography

    # ---- velocities
    rounds: int = 4  # of the fixed-point iteration
    compared: float = 0.11  # of the width: window in which candidate velocities are compared
    nodes: int = 8  # between nodes at which the plane's velocities are computed
    every: int = 2  # every second pixel is compared, since a window holds thousands
    softness: float = 0.5  # candidates whose costs differ by less are blended
    doubt: float = 2.0  # scale of the difference in cost at which one neighbour is preferred
    unseen: float = 30.0  # cost of a candidate that leads outside a frame

    # ---- pictures
    agreeing: float = 60.0  # difference at which a frame's weight falls to 1 / e
    nearest: float = 0.02  # frame intervals: weights do not increase further below this
    fall: float = 0.7  # exponent of the distance in time
    most_rows: int = 480  # short side of the small copies,
    least_shrink: int = 2  # and how much smaller than the frame they are
    least_consistent: float = 0.35  # share of consistent flow; below it, the frames show different scenes
    least_gain: float = 0.06  # least share of the difference between the frames that their motion must explain
    noise_gain: float = 0.25  # least share if the motion may have been fitted to noise, which it was not
    plain_consistent: float = 0.7  # if it is at least this consistent
    plain_move: float = 0.5  # and this large (mean)
    unmoved: float = 0.1  # if nine tenths of a picture move by less, it is left unchanged


DENSE = DenseParams()


@dataclass(frozen=True)
class Flow:
    """Optical flow between two frames."""

    # from each pixel of the earlier frame to its match in the later one [px], (columns, rows)
    forward: Float32[np.ndarray, "height width 2"]
    # from each pixel of the later frame to its match in the earlier one [px]
    backward: Float32[np.ndarray, "height width 2"]
    # homography from the earlier frame to the later one: the motion of most of the picture
    plane: Float64[np.ndarray, "3 3"]
    consistent: float  # share of the pixels with a match whose forward-backward error is below 1.5 px


def flow_between(
    earlier: UInt8[np.ndarray, "height width"], later: UInt8[np.ndarray, "height width"], halvings: int = 0
) -> Flow:
    """Computes the flow between two grey pictures of the same size, each direction in its own thread."""
    plane = plane_between(earlier, later)
    with ThreadPoolExecutor(2) as threads:
        there = threads.submit(_one_way, earlier, later, plane, halvings)
        back = threads.submit(_one_way, later, earlier, np.linalg.inv(plane), halvings)
        forward = there.result()
        backward = back.result()
    partner = pixel_grid(*earlier.shape) + forward
    has_one = inside(partner, *earlier.shape)
    off = np.linalg.norm(forward + bilinear(backward, partner), axis=-1)
    consistent = float((off[has_one] < DENSE.consistent).mean()) if has_one.any() else 0.0
    return Flow(forward, backward, plane, consistent)


@lru_cache(maxsize=2)
def pixel_grid(height: int, width: int) -> Float32[np.ndarray, "height width 2"]:
    """Returns (column, row) of every pixel; read-only, because the array is shared between callers."""
    grid = np.empty((height, width, 2), np.float32)
    grid[..., 0], grid[..., 1] = np.arange(width), np.arange(height)[:, None]
    grid.setflags(write=False)
    return grid


def bilinear(field: np.ndarray, positions: Float32[np.ndarray, "rows cols 2"]) -> np.ndarray:
    """Interpolates a field [h, w, ...] bilinearly at positions, replicating its border."""
    return cv2.remap(field, positions, NO_ARRAY, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def inside(positions: Float32[np.ndarray, "rows cols 2"], height: int, width: int) -> np.ndarray:
    """Bool [rows, cols]: whether each position lies in a picture."""
    column = positions[..., 0]
    row = positions[..., 1]
    return (column >= 0) & (column <= width - 1) & (row >= 0) & (row <= height - 1)


def _one_way(source: np.ndarray, target: np.ndarray, plane: np.ndarray, halvings: int) -> np.ndarray:
    height, width = source.shape
    grid = pixel_grid(height, width)
    ends = move_points(plane, grid)
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(halvings)
    search.setPatchSize(DENSE.patch)
    search.setPatchStride(DENSE.stride)
    search.setGradientDescentIterations(DENSE.descents)
    search.setVariationalRefinementIterations(DENSE.refinements)
    rest = search.calc(source, bilinear(target, ends), cast(np.ndarray, None))  # None: no initial flow
    flow = move_points(plane, grid + rest) - grid
    outside = ~inside(ends, height, width)
    flow[outside] = (ends - grid)[outside]
    return flow


# ---- the homography --------------------------------------------------------------------------------------


def plane_between(
    first: UInt8[np.ndarray, "height width"], second: UInt8[np.ndarray, "height width"]
) -> Float64[np.ndarray, "3 3"]:
    """Returns the homography between two pictures, or the identity if too few corners can be tracked.

    Corners are tracked from two starting points: their own position, and that shifted by phase correlation, so that
    motion of up to a sixth of the width is found. The start that tracks more corners is used.
    """
    height, width = first.shape
    corners = cv2.goodFeaturesToTrack(first, DENSE.corners, DENSE.quality, DENSE.distance)
    if corners is None or len(corners) < MIN_TRACKS:
        return np.eye(3)
    starts = [np.zeros(2, np.float32), picture_shift(first, second)[0].astype(np.float32)]
    begin, end = max((_tracked(first, second, corners, start) for start in starts), key=lambda ends: len(ends[0]))
    if len(begin) < MIN_TRACKS:
        return np.eye(3)
    cv2.setRNGSeed(0)
    homography, inliers = cv2.findHomography(begin, end, cv2.USAC_MAGSAC, DENSE.inlier, maxIters=2000, confidence=0.999)
    if homography is None or inliers.sum() < MIN_TRACKS or not _is_sound(homography, height, width):
        return np.eye(3)
    return homography


def move_points(plane: Float[np.ndarray, "3 3"], points: Float[np.ndarray, "rows cols 2"]) -> np.ndarray:
    """Maps points by a homography, float32 [rows, cols, 2]."""
    ends = cv2.perspectiveTransform(points.reshape(1, -1, 2).astype(np.float64), plane)
    return ends.reshape(points.shape).astype(np.float32)


def _tracked(
    first: np.ndarray, second: np.ndarray, corners: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners [N, 2] tracked to the second picture and back, and their positions there."""
    there, seen = lucas_kanade(first, second, corners, corners + start, DENSE.window)
    back, seen_back = lucas_kanade(second, first, there, there - start, DENSE.window)
    good = seen & seen_back & (np.linalg.norm(back - corners, axis=2)[:, 0] < DENSE.returns_px)
    return corners[good, 0], there[good, 0]


def _is_sound(plane: np.ndarray, height: int, width: int) -> bool:
    """Whether the mapped picture remains convex and of similar size, and does not leave the frame entirely."""
    outline = np.array([[[0, 0], [width, 0], [width, height], [0, height]]], np.float64)
    ends = cv2.perspectiveTransform(outline, plane)[0]
    sides = np.roll(ends, -1, axis=0) - ends
    rotations = sides[:, 0] * np.roll(sides, -1, axis=0)[:, 1] - sides[:, 1] * np.roll(sides, -1, axis=0)[:, 0]
    far = np.abs(ends - outline[0]).max(axis=0)
    return bool((rotations > 0.25 * width * height).all() and (far < [width, height]).all())


@dataclass(frozen=True)
class Field:
    """Velocity of every pixel in the picture of one moment."""

    # at that moment [px of the copy / frame interval], (columns, rows), at each pixel of the picture
    velocity: Float32[np.ndarray, "height width 2"]
    # [px of the copy / frame interval^2]; 0 if only two frames are used
    acceleration: Float32[np.ndarray, "height width 2"] | float
    moment: float  # time of the picture, in frame intervals
    timing: Timing  # the clock of the copies
    # mean difference [grey levels] between the frames' samples around every second pixel
    cost: Float32[np.ndarray, "rows columns"]
    still_cost: Float32[np.ndarray, "rows columns"]  # cost of zero motion

    def shift(self, frame: float) -> Float32[np.ndarray, "height width 2"]:
        """Returns the offset (columns, rows) from each pixel to where it is sampled in a frame [px of the copy].

        Args:
            frame: time of its first row [frame intervals after that of frame 0]; its number if intervals are even.
        """
        grid = pixel_grid(*self.velocity.shape[:2])
        position = _look(self.velocity, self.moment, self.timing, frame)
        if np.any(self.acceleration):
            for _ in range(DENSE.rounds):
                ahead = (self.timing.exposed(frame, position[..., 1:]) - self.moment).astype(np.float32)
                position = grid + (self.velocity + self.acceleration / 2 * ahead) * ahead
        return position - grid


def joined(before: Field, after: Field) -> Field:
    """Combines the motion from two neighbours, with a speed that changes evenly from one to the other.

    Where one neighbour explains the picture clearly worse, its motion is ignored.

    Args:
        before: from frames -1 and 0.
        after: from frames 0 and 1, at the same moment.
    """
    row = pixel_grid(*before.velocity.shape[:2])[..., 1:]
    own_row = row + before.shift(0)[..., 1:]
    since = (before.moment - before.timing.exposed(0, own_row)).astype(np.float32)  # since frame 0 read this content
    change = after.velocity - before.velocity
    steady = (after.velocity + before.velocity) / 2 + change * since
    trust = 1 / (1 + np.exp(np.clip((after.cost - before.cost) / DENSE.doubt, -30, 30)))  # in ``after``
    trust = _everywhere(trust, row)[..., None]
    both = 2 * np.minimum(trust, 1 - trust)
    better = np.where(trust > 0.5, after.velocity, before.velocity)
    return Field(
        (both * steady + (1 - both) * better).astype(np.float32),
        (both * change).astype(np.float32),
        before.moment,
        before.timing,
        np.minimum(before.cost, after.cost),
        np.minimum(before.still_cost, after.still_cost),
    )


def field_between(
    earlier: UInt8[np.ndarray, "height width"],
    later: UInt8[np.ndarray, "height width"],
    flow: Flow,
    timing: Timing,
    moment: float,
    nearest: int = 0,
) -> Field:
    """Returns the velocities at a moment, from the flow between frame 0 and frame 1.

    Each pixel has three candidate velocities: the flow of either frame, and that of the whole picture's plane. Each
    predicts one position in either frame; the candidates are blended by how well the frames match there.

    Args:
        moment: time of the picture, in frame intervals from the first row of frame 0.
        nearest: frame (0 or 1) to which the picture belongs.
    """
    ways = [
        _at_moment(_velocity(flow.forward, timing, +1), timing, 0, moment),
        _at_moment(_velocity(flow.backward, timing, -1), timing, 1, moment),
        _plane_at_moment(flow.plane, timing, moment, *earlier.shape),
    ]
    if nearest == 1:
        ways[:2] = ways[1::-1]
    costs = np.stack([_cost(earlier, later, way, timing, moment) for way in ways])
    weights = np.exp((costs.min(axis=0) - costs) / DENSE.softness)
    weights /= weights.sum(axis=0)
    shares = [_everywhere(weight, ways[0])[..., None] for weight in weights]
    velocity = shares[0] * ways[0] + shares[1] * ways[1] + shares[2] * ways[2]
    return Field(
        velocity,
        0.0,
        moment,
        timing,
        _cost(earlier, later, velocity, timing, moment),
        _cost(earlier, later, np.zeros_like(velocity), timing, moment),
    )


def _velocity(flow: np.ndarray, timing: Timing, direction: int) -> np.ndarray:
    """Returns velocities at the pixels of a frame, from its flow to the next (direction +1) or previous frame (-1)."""
    duration = 1 + direction * timing.per_row * flow[..., 1:]
    return direction * flow / np.maximum(duration, 0.1)


def _at_moment(velocity: np.ndarray, timing: Timing, frame: int, moment: float) -> np.ndarray:
    """Converts velocities at a frame's pixels to velocities at the pixels of the picture of a moment."""
    grid = pixel_grid(*velocity.shape[:2])
    position = grid
    for _ in range(DENSE.rounds):
        ahead = timing.exposed(frame, position[..., 1:]) - moment
        position = grid + bilinear(velocity, position) * ahead.astype(np.float32)
    return bilinear(velocity, position)


def _plane_at_moment(plane: np.ndarray, timing: Timing, moment: float, height: int, width: int) -> np.ndarray:
    """Returns the velocities of frame 0's plane in the picture of a moment; smooth, so computed at few nodes."""
    nodes = pixel_grid(-(-height // DENSE.nodes) + 1, -(-width // DENSE.nodes) + 1) * np.float32(DENSE.nodes)
    position = nodes
    for _ in range(DENSE.rounds):
        velocity = _velocity(move_points(plane, position) - position, timing, +1)
        position = nodes + velocity * (timing.exposed(0, position[..., 1:]) - moment).astype(np.float32)
    velocity = _velocity(move_points(plane, position) - position, timing, +1)
    return bilinear(velocity.astype(np.float32), pixel_grid(height, width) / np.float32(DENSE.nodes))


def _look(
    velocity: np.ndarray, moment: float, timing: Timing, frame: float, grid: np.ndarray | None = None
) -> np.ndarray:
    """Solves p = q + V (tau(p) - t), linear in p's row, with V known at q: all pixels, or those of a grid."""
    grid = pixel_grid(*velocity.shape[:2]) if grid is None else grid
    down = velocity[..., 1]
    row = (grid[..., 1] + down * (timing.start(frame) - moment)) / np.maximum(1 - timing.per_row * down, 0.1)
    ahead = timing.exposed(frame, row) - moment
    return (grid + velocity * ahead[..., None]).astype(np.float32)


def _cost(
    earlier: np.ndarray, later: np.ndarray, velocity: Float[np.ndarray, "height width 2"], timing: Timing, moment: float
) -> np.ndarray:
    """Returns the difference between the frames where a velocity matches them, averaged around every second pixel."""
    height, width = earlier.shape
    grid = pixel_grid(height, width)[:: DENSE.every, :: DENSE.every]
    there = velocity[:: DENSE.every, :: DENSE.every]
    in_earlier, in_later = (_look(there, moment, timing, frame, grid) for frame in (0, 1))
    difference = cv2.absdiff(bilinear(earlier, in_earlier), bilinear(later, in_later)).astype(np.float32)
    visible = inside(in_earlier, height, width) & inside(in_later, height, width)
    difference[~visible] = DENSE.unseen
    side = round(DENSE.compared * width / DENSE.every) | 1
    return cv2.blur(difference, (side, side))


def _everywhere(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Upsamples values known at every second pixel to all pixels of a picture."""
    return cv2.resize(values, like.shape[1::-1], interpolation=cv2.INTER_LINEAR)
