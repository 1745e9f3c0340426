"""Applies a motion to pixels: samples pictures in both directions, and handles the picture's edges.

The output is computed tile by tile, several at a time: apart from the picture before and after, memory does not grow
with its size.

Convention: everything here accepts and returns **stored** pixels (orientation.py); positions are (col, row),
pixel centres at whole numbers. A position is *inside* a picture of W columns and H rows if
0 <= col <= W - 1 and 0 <= row <= H - 1 (within the 0.01 px to which the map is exact).
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import Motion
from unshutter.motion.edges import HAIRLINE, EdgeDecision, EdgePolicy, crop_window
from unshutter.motion.grid import Extent, SamplingGrid, Scratch, Tile, gs_to_rs_map, rs_to_gs_map
from unshutter.motion.opencv_threads import no_opencv_threads
from unshutter.motion.shapes import Bool, Float32, UInt
from unshutter.motion.upright import Pose
from unshutter.options import Edges, check_edges
from unshutter.storage import files

_LONGEST_SOURCE = 32_000  # px; cv2.remap uses 16 bits for a position
_REACH = 3  # px that interpolation reads beyond a position
_BOOST = 0.012  # of a plane's finest detail: as much as bicubic interpolation takes of it on average
_SHARPER = np.array([-_BOOST, 1 + 2 * _BOOST, -_BOOST])


def straighten(
    pixels: UInt[np.ndarray, "height width *bands"],
    motion: Motion,
    edges: Edges = "keep",
    masked: bool = False,
    upright: Pose | None = None,
) -> tuple[UInt[np.ndarray, "new_height new_width *bands"], EdgeDecision]:
    """Computes the global-shutter picture of a rolling-shutter photo, bicubic (a = -0.75).

    Args:
        pixels: [H, W] or [H, W, 1..4] stored pixels, uint8 or uint16; the last of 2 or 4 bands is alpha, and
            colours are then interpolated premultiplied.
        motion: the photo's motion, for exactly its size.
        edges: for pixels whose RS position is a pixel or more outside the photo: ``keep`` makes them black (and
            alpha 0), ``crop`` cuts out a large upright rectangle without them (:func:`~edges.crop_window`), ``fill``
            mirrors the photo at its border; ``auto`` crops, or keeps if a crop would leave less than 10 % of the area.
            Less than a pixel outside, ``keep`` and ``crop`` repeat the border, so that no edge gets a black hairline.
        masked: the last of 2 or 4 bands is a mask rather than alpha: it is interpolated separately, like a colour.
        upright: the pose of the camera to undo in the same step; None: the picture is not turned.

    Returns:
        Stored pixels with the photo's type and bands, and its size (smaller if cropped), the photo's own if the motion
        is zero; and how its edges were handled.
    """
    check_edges(edges)
    policy = EdgePolicy(edges)
    _check_size(pixels, motion)
    height, width = pixels.shape[:2]
    if motion.is_zero and upright is None:
        return pixels, policy.without_motion((height, width))
    grid = SamplingGrid.of(gs_to_rs_map(motion, upright), height, width)
    decision = _decision(grid, policy)
    black_beyond = EdgePolicy(decision.edges).black_beyond
    return _warped(pixels, grid, decision.window, cv2.INTER_CUBIC, black_beyond, masked), decision


def edge_decision(motion: Motion, edges: Edges, upright: Pose | None = None) -> EdgeDecision:
    """Returns how :func:`straighten` would handle the edges of a photo with this motion."""
    check_edges(edges)
    policy = EdgePolicy(edges)
    size = motion.scan_direction.frame_size(motion.height, motion.width)
    if motion.is_zero and upright is None:
        return policy.without_motion(size)
    return _decision(SamplingGrid.of(gs_to_rs_map(motion, upright), *size), policy)


def distort_pixels(
    pixels: UInt[np.ndarray, "height width *bands"], motion: Motion
) -> UInt[np.ndarray, "height width *bands"]:
    """Computes the rolling-shutter picture of a global-shutter one, bilinear, to synthesise training pairs.

    Each RS pixel samples the GS picture at its GS position (closed form); outside it is black, alpha 0.
    """
    _check_size(pixels, motion)
    if motion.is_zero:
        return pixels
    height, width = pixels.shape[:2]
    grid = SamplingGrid.of(rs_to_gs_map(motion), height, width)
    return _warped(pixels, grid, grid.area_left, cv2.INTER_LINEAR, black_beyond=0.0)


def sampled_pixels(
    pixels: UInt[np.ndarray, "height width *bands"], grid: SamplingGrid, fill: bool = False, masked: bool = False
) -> UInt[np.ndarray, "height width *bands"]:
    """Samples a picture at the positions of a grid, bicubic; see :func:`straighten`.

    Positions outside the picture are black, or with ``fill`` show it mirrored at its border.
    """
    return _warped(pixels, grid, grid.area_left, cv2.INTER_CUBIC, None if fill else 0.0, masked)


def validity_mask(motion: Motion, upright: Pose | None = None) -> Bool[np.ndarray, "height width"]:
    """Computes which pixels of the rectified picture exist in the photo."""
    size = motion.scan_direction.frame_size(motion.height, motion.width)
    return seen_mask(SamplingGrid.of(gs_to_rs_map(motion, upright), *size))


def seen_mask(grid: SamplingGrid, beyond: float = 0.0) -> Bool[np.ndarray, "{grid.height} {grid.width}"]:
    """Computes which output pixels are sampled inside the input picture, or up to ``beyond`` px outside."""
    mask = np.empty((grid.height, grid.width), dtype=bool)
    for tile in grid.area_left.tiles():
        mask[tile.within(grid.area_left)] = grid.inside(*grid.positions(tile), beyond=beyond)
    return mask


def _decision(grid: SamplingGrid, policy: EdgePolicy) -> EdgeDecision:
    return policy.decide((grid.height, grid.width), lambda: crop_window(grid, HAIRLINE))


def _check_size(pixels: np.ndarray, motion: Motion) -> None:
    height, width = motion.scan_direction.frame_size(motion.height, motion.width)
    if pixels.shape[:2] != (height, width):
        raise UnshutterError(
            f"the motion is for a picture of {width}x{height} px but this one has "
            f"{pixels.shape[1]}x{pixels.shape[0]} px: "
            "resize the motion, or choose the readout direction it was found with"
        )


def _warped(
    pixels: np.ndarray,
    grid: SamplingGrid,
    window: Tile,
    interpolation: int,
    black_beyond: float | None,
    masked: bool = False,
) -> np.ndarray:
    """Computes a window of the output, in either direction of the warp.

    Args:
        black_beyond: distance outside the picture [px] from which pixels become 0; up to there the border is
            repeated; None: the picture is mirrored at its border.
        masked: see :func:`straighten`.
    """
    shape = window.bottom - window.top, window.right - window.left, *pixels.shape[2:]
    if math.prod(shape) * pixels.itemsize <= files.SPILL_BYTES:
        result = np.empty(shape, pixels.dtype)
    else:  # in a file that is removed when no longer used
        with files.nameless_file() as file:
            result = np.memmap(file, dtype=pixels.dtype, mode="w+", shape=shape)
    pixels, out = (a.reshape(*a.shape[:2], -1) for a in (pixels, result))
    has_alpha = pixels.shape[2] in (2, 4) and not masked
    warp = _Warp(pixels, out, grid, window, interpolation, black_beyond, has_alpha, Scratch())
    with no_opencv_threads(), ThreadPoolExecutor(thread_count()) as threads:
        for _ in threads.map(warp.make, window.tiles()):
            pass  # raises errors of the threads
    return result


@dataclass(frozen=True, eq=False)
class _Warp:
    """One warp, whose tiles are computed independently."""

    pixels: np.ndarray  # [H, W, bands]
    out: np.ndarray  # [rows, cols, bands] of the window
    grid: SamplingGrid
    window: Tile
    method: int  # of interpolation
    black_beyond: float | None
    has_alpha: bool
    scratch: Scratch

    def make(self, tile: Tile) -> None:
        """Computes a tile of the output."""
        grid = self.grid
        extent = self.grid.extent(tile)
        positions = self.scratch.array("positions", (2, tile.bottom - tile.top, tile.right - tile.left))
        mirrored = self.black_beyond is None and not grid.contains(extent)
        if _too_long(extent) or mirrored:
            col, row = grid.positions(tile, out=positions)
            if mirrored:
                _mirror(col, self.pixels.shape[1] - 1)
                _mirror(row, self.pixels.shape[0] - 1)
            extent = Extent.of(col, row)
            if _too_long(extent):
                for half in tile.halves():
                    self.make(half)
                return
        source, left, top = _cut(self.pixels, extent)
        if mirrored:
            col, row = positions
            col -= left
            row -= top
        else:
            col, row = grid.positions(tile, left, top, out=positions)
        part = self.out[tile.within(self.window)]
        self._sample(source, col, row, part)
        if self.black_beyond is not None and self.black_beyond < math.inf and not grid.contains(extent):
            _blacken(part, ~grid.inside(col, row, left, top, self.black_beyond), 0)

    def _sample(self, image: np.ndarray, col: np.ndarray, row: np.ndarray, out: np.ndarray) -> None:
        """Samples the image at positions, repeating its border, and writes the result to out [rows, cols, bands]."""
        top = np.iinfo(image.dtype).max
        if image.dtype == np.uint8 and not self.has_alpha:
            cv2.remap(image, col, row, self.method, dst=out, borderMode=cv2.BORDER_REPLICATE)
            return
        source = self.scratch.array("source", image.shape)
        sampled = self.scratch.array("sampled", out.shape)
        np.copyto(source, image)  # 16 bits too: a quarter faster as float, with the same result
        if self.has_alpha:
            source[..., :-1] *= source[..., -1:] / top
        cv2.remap(source, col, row, self.method, dst=sampled, borderMode=cv2.BORDER_REPLICATE)
        if self.has_alpha:
            alpha = sampled[..., -1:]
            with np.errstate(divide="ignore"):
                sampled[..., :-1] *= np.where(alpha >= 0.5, top / alpha, 0)
        np.rint(sampled.clip(0, top, out=sampled), out=sampled)
        np.copyto(out, sampled, casting="unsafe")


def _blacken(part: np.ndarray, outside: np.ndarray, black: int | Sequence[int]) -> None:
    """Sets pixels to the value of black, or to those of its bands."""
    cv2.copyTo(np.full_like(part, black), outside.view(np.uint8), part)  # part[outside] = black takes 40 times as long


def _mirror(positions: np.ndarray, last: int) -> None:
    """Reflects positions more than a pixel outside 0 ... last into the picture, as in a mirror at its border.

    Up to a pixel outside they are unchanged: the border is repeated there, as with other edges.
    """
    for outside, beyond, sign in ((positions < -1, -1, -1), (positions > last + 1, last + 1, 1)):
        if outside.any():
            depth = np.abs(positions[outside] - beyond)
            depth = last - np.abs(depth % (2 * last) - last) if last else np.zeros_like(depth)
            positions[outside] = depth if sign < 0 else last - depth


def thread_count() -> int:
    """Returns libvips's number of threads: one per processor, or the value of VIPS_CONCURRENCY."""
    setting = os.environ.get("VIPS_CONCURRENCY", "")
    return min(int(setting) if setting.isdigit() and int(setting) else os.cpu_count() or 1, 16)


def _too_long(extent: Extent) -> bool:
    return max(extent.right - extent.left, extent.bottom - extent.top) > _LONGEST_SOURCE


def _cut(pixels: np.ndarray, extent: Extent) -> tuple[np.ndarray, int, int]:
    """Returns the part of the picture that interpolation within the extent needs, its left and its top."""
    height, width = pixels.shape[:2]
    left, right = (min(max(int(c), 0), width - 1) for c in (extent.left - _REACH, extent.right + _REACH))
    top, bottom = (min(max(int(r), 0), height - 1) for r in (extent.top - _REACH, extent.bottom + _REACH))
    return pixels[top : bottom + 1, left : right + 1], left, top


# ---- auxiliary pictures of a photo -----------------------------------------------------------------------------


def sampled_auxiliary(
    pixels: UInt[np.ndarray, "rows columns bands"],
    grid: SamplingGrid,
    window: Tile,
    black_beyond: float | None,
    nearest: bool = False,
) -> UInt[np.ndarray, "new_rows new_columns bands"]:
    """Computes what belongs to a window of a rectified picture in a picture that is stretched over the photo.

    Its scale is kept, to a pixel. It is mirrored where the photo is; where that is black it is 0, from a pixel of its
    own outside the photo.

    Args:
        pixels: a picture of any size, such as a gain map.
        grid: where the rectified picture samples the photo.
        black_beyond: see :attr:`EdgePolicy.black_beyond`.
        nearest: whether values are taken from the nearest pixel instead of interpolated.
    """
    rows, columns = pixels.shape[:2]
    down, across = grid.height / rows, grid.width / columns  # px of the photo
    at_rows = _centres(window.top, window.bottom, down)
    at_cols = _centres(window.left, window.right, across)
    whole = Tile(0, len(at_rows), 0, len(at_cols))
    result = np.empty((whole.bottom, whole.right, pixels.shape[2]), pixels.dtype)
    outer = Extent.of_picture(grid.height, grid.width, across, down)
    method = cv2.INTER_NEAREST if nearest else cv2.INTER_CUBIC
    for tile in whole.tiles():
        here = tile.within(whole)
        col, row = grid.near(at_rows[here[0]], at_cols[here[1]])
        if black_beyond is None:
            _mirror(col, grid.width - 1)
            _mirror(row, grid.height - 1)
        is_black = black_beyond is not None and math.isfinite(black_beyond)
        outside = ~outer.holds(col, row) if is_black else None
        col, row = (col + 0.5) / np.float32(across) - 0.5, (row + 0.5) / np.float32(down) - 0.5
        source, left, top = _cut(pixels, Extent.of(col, row))
        sampled = cv2.remap(source, col - left, row - top, method, borderMode=cv2.BORDER_REPLICATE)
        result[here] = sampled.reshape(result[here].shape)
        if outside is not None:
            _blacken(result[here], outside, 0)
    return result


def _centres(first: int, last: int, scale: float) -> np.ndarray:
    """Returns the centres of pixels of about ``scale`` px that fill a side of a window, in its px."""
    count = max(round((last - first) / scale), 1)
    return (first + (np.arange(count) + 0.5) * (last - first) / count - 0.5).clip(0)


# ---- planes of video frames ------------------------------------------------------------------------------------


def warp_plane(
    plane: UInt[np.ndarray, "rows columns *bands"],
    grid: SamplingGrid,
    out: UInt[np.ndarray, "rows columns *bands"],
    subsampling: tuple[int, int] = (1, 1),
    black_beyond: float | None = math.inf,
    black: int | Sequence[int] = 0,
    limit: int = 0xFFFF,
    scratch: Scratch | None = None,
) -> None:
    """Computes a plane of a rectified video frame, bicubic (a = -0.75), band by band.

    What interpolation takes of the finest detail, on average over all fractions of a pixel, is added beforehand in
    planes of the frame's own resolution.

    Args:
        plane: a plane of the frame, of its own resolution.
        grid: where the rectified frame is sampled, of :meth:`SamplingGrid.of_cells`.
        subsampling: columns and rows of the frame per column and row of the plane.
        black_beyond: see :attr:`EdgePolicy.black_beyond` [px of the frame].
        black: the value of black, or those of the plane's bands.
        limit: greatest value, which cubic interpolation may exceed.
    """
    if subsampling == (1, 1):
        plane = cv2.sepFilter2D(plane, -1, _SHARPER, _SHARPER)
    picture = None
    if black_beyond is not None and math.isfinite(black_beyond):
        across, down = ((black_beyond - 0.5) / each + 0.5 for each in subsampling)
        rows, columns = plane.shape[:2]
        picture = Extent.of_picture(rows, columns, across, down)
    for band, positions in grid.bands(*subsampling, scratch):
        sample_plane(plane, positions, out[band], limit, mirror=black_beyond is None)
        if picture is not None:
            outside = ~picture.holds(*positions)
            if outside.any():
                _blacken(out[band], outside, black)


def sample_plane(
    plane: UInt[np.ndarray, "rows columns *bands"],
    positions: tuple[Float32[np.ndarray, "new_rows new_cols"], Float32[np.ndarray, "new_rows new_cols"]],
    out: UInt[np.ndarray, "new_rows new_cols *bands"],
    limit: int = 0xFFFF,
    mirror: bool = False,
) -> None:
    """Samples a plane at positions (col, row) [px of the plane], bicubic (a = -0.75).

    Args:
        limit: greatest value, which cubic interpolation may exceed.
        mirror: whether the plane is mirrored at its border; otherwise, the border is repeated.
    """
    border = cv2.BORDER_REFLECT if mirror else cv2.BORDER_REPLICATE
    col, row = positions
    cv2.remap(plane, col, row, cv2.INTER_CUBIC, dst=out, borderMode=border)
    if limit < np.iinfo(out.dtype).max:
        np.minimum(out, limit, out=out)
