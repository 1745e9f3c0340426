"""Renders the picture a global shutter would have taken, at any moment between a frame and its neighbours.

This is the dense model (flow.py): flow is computed on small grey copies, once for each pair of frames, whatever moments
are requested; full-size pixels are sampled once in each frame and fused. Where the frames agree, they are averaged,
with more weight for those nearer in time; where they disagree because one shows what another hides, only the nearest
one is used. This avoids ghosts.

Frames are counted from the one being rendered: the previous frame is -1, the next one +1. Pixels are those of the
readout frame.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.flow import DENSE, Field, Flow, bilinear, field_between, flow_between, joined
from unshutter.frames.frame_motion import Timing
from unshutter.motion.grid import SamplingGrid, Tile
from unshutter.motion.warp import sampled_pixels, seen_mask, thread_count
from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    from collections.abc import Mapping

    from unshutter.motion.shapes import Bool, Float32, UInt, UInt8


@dataclass(frozen=True)
class Warped:
    """A frame warped to the time of the picture."""

    # uint8 or uint16 [H, W, bands]; content outside the frame is mirrored at its border
    pixels: UInt[np.ndarray, "height width bands"]
    grid: SamplingGrid  # position at which each pixel was sampled
    frame: float  # time of its first row [frame intervals after that of frame 0]


def fuse(
    own: Warped, others: list[Warped], timing: Timing, moment: float, borrow: bool
) -> tuple[UInt[np.ndarray, "height width bands"], Bool[np.ndarray, "height width"]]:
    """Fuses frames into the picture of a moment, written into ``own.pixels``.

    Args:
        borrow: whether content that ``own`` does not show is taken from the others; otherwise left unchanged.

    Returns:
        The pixels, and a mask of those shown by any frame (``borrow``) or by ``own``.
    """
    height, width = own.pixels.shape[:2]
    valid = np.empty((height, width), bool)

    def make(tile: Tile) -> None:
        at = tile.within(own.grid.area_left)
        valid[at] = _fuse_tile(tile, own, others, timing, moment, borrow)

    with ThreadPoolExecutor(thread_count()) as threads:
        for _ in threads.map(make, own.grid.area_left.tiles()):
            pass  # re-raises errors of the threads
    return own.pixels, valid


def _fuse_tile(
    tile: Tile, own: Warped, others: list[Warped], timing: Timing, moment: float, borrow: bool
) -> np.ndarray:
    """Writes a tile into ``own.pixels`` and returns the mask of pixels that were seen.

    Frames are added one by one: where one differs from the current result, whichever is farther from the moment loses
    its weight.
    """
    at = tile.within(own.grid.area_left)
    visible, most = _visibility_and_weight(own, tile, timing, moment)
    valid = visible
    mixed = np.ascontiguousarray(own.pixels[at])
    total = most
    for other in others:
        theirs = np.ascontiguousarray(other.pixels[at])
        visible_there, weight = _visibility_and_weight(other, tile, timing, moment)
        agreement = _agreement(mixed, theirs)
        nearer = weight > most
        total = np.where(nearer, total * agreement, total)
        share = np.where(nearer, weight, weight * agreement)
        mixed = _mixed(mixed, theirs, total, share)
        total = total + share
        most = np.maximum(most, weight)
        valid = valid | visible_there if borrow else valid
    np.copyto(own.pixels[at], mixed, where=True if valid.all() else valid[..., None])  # a mask takes ten times as long
    return valid


def _visibility_and_weight(
    warped: Warped, tile: Tile, timing: Timing, moment: float
) -> tuple[Bool[np.ndarray, "rows cols"], Float32[np.ndarray, "rows cols"]]:
    """Returns which pixels a frame shows, and its weight there, which grows as their time approaches the moment."""
    column, row = warped.grid.positions(tile)
    visible = warped.grid.inside(column, row)
    away = cv2.absdiff(row * np.float32(timing.per_row), np.full_like(row, moment - timing.start(warped.frame)))
    return visible, cv2.pow(np.maximum(away, np.float32(DENSE.nearest)), -DENSE.fall) * visible


def _agreement(first: np.ndarray, second: np.ndarray) -> Float32[np.ndarray, "rows cols"]:
    """Returns 1 where two pictures are alike and 0 where they differ, with a smooth transition."""
    difference = reduce(cv2.max, cv2.split(cv2.absdiff(first, second))).astype(np.float32)  # largest of the bands
    scale = 255 / np.iinfo(first.dtype).max / DENSE.agreeing
    return cv2.exp(-((cv2.blur(difference, (3, 3)) * scale) ** 2))


def _mixed(first: np.ndarray, second: np.ndarray, weight: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Returns the weighted average of two pictures; black where both weights are 0."""
    if first.dtype == np.uint8:
        return cv2.blendLinear(first, second, weight, share).reshape(first.shape)
    mixed = cv2.blendLinear(first.astype(np.float32), second.astype(np.float32), weight, share)
    return np.rint(mixed).astype(first.dtype).reshape(first.shape)


@dataclass(frozen=True)
class Link:
    """The flow between a frame and the next, computed on small copies."""

    earlier: UInt8[np.ndarray, "height width"]
    later: UInt8[np.ndarray, "height width"]
    flow: Flow  # flow between them
    apart: float = 1.0  # time between them [frame intervals]; not 1 if frames are unevenly spaced


@dataclass(frozen=True)
class Rendering:
    """A picture of one moment."""

    pixels: UInt[np.ndarray, "height width bands"]  # of the frame's size and type
    valid: Bool[np.ndarray, "height width"]  # mask of the pixels whose content some frame shows, if it may be borrowed
    own: Bool[np.ndarray, "height width"]  # mask of those that frame 0 shows
    largest_px: float  # largest displacement of anything in frame 0
    reason: Reason | None = None  # why the frame was left unchanged; None if it was changed
    grid: SamplingGrid | None = None  # where frame 0 was sampled; None if it was left unchanged


def copy_side(height: int, width: int) -> int:
    """Returns the short side [px] of the small grey copies for frames of a given size."""
    return max(min(min(height, width) // DENSE.least_shrink, DENSE.most_rows), 1)


def link(
    earlier: UInt8[np.ndarray, "height width"],
    later: UInt8[np.ndarray, "height width"],
    apart: float = 1.0,
    halvings: int = 0,
) -> Link:
    """Computes the flow between two successive frames from their small grey copies."""
    if earlier.shape != later.shape:
        later = cv2.resize(later, earlier.shape[::-1], interpolation=cv2.INTER_AREA)
    flow = flow_between(earlier, later, halvings)
    if flow.consistent < DENSE.least_consistent:
        raise UnshutterError(
            f"the frames have too little in common ({100 * flow.consistent:.0f} % of the picture is found in both): "
            "use neighbours from the same shot"
        )
    return Link(earlier, later, flow, apart)


def motion_field(links: Mapping[int, Link], timing: Timing, moment: float) -> tuple[Field, float, Reason | None]:
    """Returns the dense motion in the picture of a moment, from the flow between frame 0 and its neighbours.

    Args:
        links: -1 or 1 or both -> the flow between frame 0 and that neighbour, the earlier frame first.
        moment: in frame intervals from the first row of frame 0.

    Returns:
        The motion on the small copies, the largest displacement of anything in frame 0 [px of the frame], and why the
        frame should be left unchanged, None if it should not.
    """
    copy_timing = timing.of_copy(next(iter(links.values())).earlier.shape[0])
    fields = {side: _field(links[side], copy_timing, moment, side) for side in links}
    field = joined(fields[-1], fields[1]) if len(fields) == 2 else next(iter(fields.values()))
    moved = np.linalg.norm(field.shift(0), axis=-1) * timing.height / field.velocity.shape[0]
    reason = _unchanged(field, moved, min(each.flow.consistent for each in links.values()))
    return field, float(moved.max()), reason


def render_moment(
    frames: Mapping[int, UInt[np.ndarray, "height width bands"]],
    links: Mapping[int, Link],
    timing: Timing,
    moment: float,
    *,
    borrow: bool = False,
    fill: bool = False,
    masked: bool = False,
) -> Rendering:
    """Renders frame 0 at a given moment.

    Args:
        frames: number -> pixels: 0, and -1 or 1 or both.
        links: -1 and 1 -> the flow between frame 0 and that neighbour, the earlier frame first.
        moment: in frame intervals from the first row of frame 0.
        borrow: whether content that frame 0 does not show is taken from its neighbours.
        fill: whether content that no frame shows is mirrored at the picture's border; otherwise it is black.
        masked: see ``Photo.masked``.

    Returns:
        New pixels; frame 0's own pixels if nothing moved or the motion explains nothing.
    """
    height, width = frames[0].shape[:2]
    field, largest_px, reason = motion_field(links, timing, moment)
    if reason:
        everything = np.ones((height, width), bool)
        return Rendering(frames[0], everything, everything, largest_px, reason)
    starts = {0: 0.0, **{side: side * links[side].apart for side in links}}
    grids = {frame: _grid(field, starts[frame], height, width) for frame in starts}
    warped = {
        frame: Warped(sampled_pixels(frames[frame], grid, fill or frame != 0, masked), grid, starts[frame])
        for frame, grid in grids.items()
    }
    others = [warped[side] for side in links]
    pixels, valid = fuse(warped[0], others, timing, moment, borrow)
    own = seen_mask(grids[0]) if borrow else valid
    return Rendering(pixels, valid, own, largest_px, grid=grids[0])


def _field(connection: Link, timing: Timing, moment: float, side: int) -> Field:
    """Returns the velocities between frame 0 and a neighbour."""
    first, apart = min(side, 0), connection.apart  # number of the earlier frame
    earlier = connection.earlier
    later = connection.later
    flow = connection.flow
    between = replace(timing, readout_ratio=min(timing.readout_ratio / apart, 1.0))  # their own interval is the unit
    field = field_between(earlier, later, flow, between, moment / apart - first, nearest=-first)
    return replace(field, velocity=field.velocity / np.float32(apart), moment=moment, timing=timing)


def _unchanged(field: Field, moved: np.ndarray, consistent: float) -> Reason | None:
    """Returns why the frame should be left unchanged, or None if it should not."""
    if np.percentile(moved, 90) < DENSE.unmoved and moved.max() < 1:
        return Reason(Code.NOTHING_MOVED)
    gain = 1 - field.cost.mean() / max(field.still_cost.mean(), 1e-6)
    plain = consistent > DENSE.plain_consistent and moved.mean() > DENSE.plain_move
    if gain < (DENSE.least_gain if plain else DENSE.noise_gain):
        return Reason(Code.FRAMES_DISAGREE)
    return None


def _grid(field: Field, frame: float, height: int, width: int) -> SamplingGrid:
    """Returns where the full-size picture is sampled in a frame, at nodes as dense as the field."""
    rows, columns = field.velocity.shape[:2]
    step = max(round(height / rows), 1)
    at = [(np.arange(-(-size // step) + 1) * step).astype(np.float32) for size in (height, width)]
    column, row = np.meshgrid(at[1], at[0])
    scale = np.array([width / columns, height / rows], np.float32)
    nodes = np.stack([column, row], axis=-1)
    in_copy = (nodes + 0.5) / scale - 0.5
    source = nodes + bilinear(field.shift(frame) * scale, in_copy)
    return SamplingGrid(np.ascontiguousarray(np.moveaxis(source, 2, 0)), step, step, height, width)
