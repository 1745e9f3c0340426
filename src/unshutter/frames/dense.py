"""Dense motion: a velocity for every pixel, so that near and far objects may move differently.

Content that flow F carries from row y of one frame to the next takes 1 + ratio F_y / H frame intervals; its velocity V
is F divided by that time, and is taken as constant. A point that a frame shows at position p at the time tau is at

    q = p - V (tau - t)

at the time t, so a picture of the time t samples the frame at p = q + V (tau(p) - t). If V is known at the pixels q of
that picture, p has a closed form (``_look``); if it is known at the pixels p of a frame, it is a fixed point.

All lengths are in pixels of the small grey copies in which the flow was computed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from unshutter.frames.flow import Flow, bilinear, inside, moved, pixel_grid
from unshutter.frames.timing import Timing

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float, Float32, UInt8

_ROUNDS = 4  # of the fixed-point iteration
_WINDOW = 0.11  # of the width: window in which candidate velocities are compared
_NODES = 8  # px between nodes at which the plane's velocities are computed
_EVERY = 2  # px: every second pixel is compared, since a window holds thousands
_SOFTNESS = 0.5  # grey levels: candidates whose costs differ by less are blended
_DOUBT = 2.0  # grey levels: scale of the difference in cost at which one neighbour is preferred
_UNSEEN = 30.0  # grey levels: cost of a candidate that leads outside a frame


@dataclass(frozen=True)
class Field:
    """Velocity of every pixel in the picture of one moment.

    Attributes:
        velocity: at that moment [px of the copy / frame interval], (columns, rows), at each pixel of the picture.
        acceleration: [px of the copy / frame interval^2]; 0 if only two frames are used.
        moment: time of the picture, in frame intervals.
        timing: the clock of the copies.
        cost: mean difference [grey levels] between the frames' samples around every second pixel.
        still_cost: cost of zero motion.
    """

    velocity: Float32[np.ndarray, "height width 2"]
    acceleration: Float32[np.ndarray, "height width 2"] | float
    moment: float
    timing: Timing
    cost: Float32[np.ndarray, "rows columns"]
    still_cost: Float32[np.ndarray, "rows columns"]

    def shift(self, frame: float) -> Float32[np.ndarray, "height width 2"]:
        """Returns the offset (columns, rows) from each pixel to where it is sampled in a frame [px of the copy].

        Args:
            frame: time of its first row [frame intervals after that of frame 0]; its number if intervals are even.
        """
        grid = pixel_grid(*self.velocity.shape[:2])
        position = _look(self.velocity, self.moment, self.timing, frame)
        if np.any(self.acceleration):
            for _ in range(_ROUNDS):
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
    trust = 1 / (1 + np.exp(np.clip((after.cost - before.cost) / _DOUBT, -30, 30)))  # in ``after``
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
        earlier, later: grey copies of the frames.
        flow: flow between them.
        timing: the clock of the copies.
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
    weights = np.exp((costs.min(axis=0) - costs) / _SOFTNESS)
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
    for _ in range(_ROUNDS):
        ahead = timing.exposed(frame, position[..., 1:]) - moment
        position = grid + bilinear(velocity, position) * ahead.astype(np.float32)
    return bilinear(velocity, position)


def _plane_at_moment(plane: np.ndarray, timing: Timing, moment: float, height: int, width: int) -> np.ndarray:
    """Returns the velocities of frame 0's plane in the picture of a moment; smooth, so computed at few nodes."""
    nodes = pixel_grid(-(-height // _NODES) + 1, -(-width // _NODES) + 1) * np.float32(_NODES)
    position = nodes
    for _ in range(_ROUNDS):
        velocity = _velocity(moved(plane, position) - position, timing, +1)
        position = nodes + velocity * (timing.exposed(0, position[..., 1:]) - moment).astype(np.float32)
    velocity = _velocity(moved(plane, position) - position, timing, +1)
    return bilinear(velocity.astype(np.float32), pixel_grid(height, width) / np.float32(_NODES))


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
    grid, there = pixel_grid(height, width)[::_EVERY, ::_EVERY], velocity[::_EVERY, ::_EVERY]
    in_earlier, in_later = (_look(there, moment, timing, frame, grid) for frame in (0, 1))
    difference = cv2.absdiff(bilinear(earlier, in_earlier), bilinear(later, in_later)).astype(np.float32)
    visible = inside(in_earlier, height, width) & inside(in_later, height, width)
    difference[~visible] = _UNSEEN
    side = round(_WINDOW * width / _EVERY) | 1
    return cv2.blur(difference, (side, side))


def _everywhere(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Upsamples values known at every second pixel to all pixels of a picture."""
    return cv2.resize(values, like.shape[1::-1], interpolation=cv2.INTER_LINEAR)
