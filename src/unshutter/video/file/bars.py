"""Bars round the picture of a clip: edges that no frame shows anything in, or only a logo or a timecode.

Editors put them round films of another shape. The camera saw only what lies between them: its rows are those of the
picture, which moves, while the bars stand still.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from unshutter.motion.grid import Tile
from unshutter.motion.shapes import Float32, Float64, UInt
from unshutter.video.file.pixels import Frame, PixelFormat


@dataclass(frozen=True)
class BarParams:
    """What counts as a bar; lines are rows, or columns."""

    alike: float = 10.0  # 8-bit steps by which a bar's pixels differ from its level in all frames, at most
    even: float = 4.0  # and most of them, but near the picture
    flat: float = 0.5  # least share of a bar's line that is so: the rest may be a logo, a timecode or subtitles
    picture: float = 0.35  # largest share of a line of the picture that is so
    may_be_picture: float = 0.7  # and in one frame, as far as that tells
    falls: float = 0.3  # least difference of the two: the edge of a bar is straight, that of a dark sky is not
    least_px: int = 4  # lines of a bar
    least: float = 0.01  # and share of all lines
    soft: float = 0.02  # share of all lines over which an edge may be blurred
    slope: float = 0.04  # of the picture's level: there, lines next to each other differ by more
    most: float = 0.45  # share of all lines that a bar takes, at most
    looked_at: int = 480  # pixels of a line


_PARAMS = BarParams()


def may_have_bars(pixels: PixelFormat, frame: Frame) -> bool:
    """Whether the edges of a frame are as flat as bars are, so that further frames must be asked."""
    luma = _luma(pixels, frame)[None]
    sides = (luma, luma[:, ::-1], luma.swapaxes(1, 2), luma.swapaxes(1, 2)[:, ::-1])
    return any(_may_have_edge(_few(side)) for side in sides)


def picture_within_bars(pixels: PixelFormat, frames: Iterable[Frame]) -> Tile | None:
    """Returns the part of the stored frames that lies within bars, on whole chroma pixels; None: there are no bars.

    Args:
        frames: some of the clip, also far from each other.
    """
    samples = [_luma(pixels, frame) for frame in frames]
    if len(samples) < 2:
        return None
    lines = np.stack(samples)
    top, bottom = _within(lines)
    left, right = _within(lines[:, top:bottom].swapaxes(1, 2))
    height, width = lines.shape[1:]
    if (top, bottom, left, right) == (0, height, 0, width):
        return None
    down, across = (max(getattr(plane, side) for plane in pixels.planes) for side in ("down", "across"))
    inner = Tile(-(-top // down) * down, bottom, -(-left // across) * across, right)
    return inner._replace(
        bottom=bottom if bottom == height else bottom // down * down,
        right=right if right == width else right // across * across,
    )


def _luma(pixels: PixelFormat, frame: Frame) -> UInt[np.ndarray, "rows columns"]:
    plane = pixels.arrays(frame)[0]
    luma = plane if plane.ndim == 2 else plane[..., 1 if plane.shape[2] > 2 else 0]
    return (luma >> (pixels.depth - 8)).astype(np.uint8)


def _fewest(lines: int) -> int:
    return max(_PARAMS.least_px, round(_PARAMS.least * lines))


def _few(samples: UInt[np.ndarray, "frames lines across"]) -> Float32[np.ndarray, "frames lines across"]:
    return samples[:, :, :: max(samples.shape[2] // _PARAMS.looked_at, 1)].astype(np.float32)


def _may_have_edge(samples: Float32[np.ndarray, "frames lines across"]) -> bool:
    """Whether the first lines may belong to a bar: in one frame, what lies beyond may be as dark as the bar."""
    apart, flat = _flatness(samples)
    bar = _fewest(len(flat))
    if flat[:bar].min() < _PARAMS.flat or np.median(apart[:bar]) > _PARAMS.even:
        return False
    edge = int(np.argmax(flat < _PARAMS.flat))
    if np.median(apart[: max(edge - _soft(len(flat)), 1)], axis=1).max() > _PARAMS.even:
        return False
    beyond = flat[edge + _soft(len(flat)) :][: _soft(len(flat))]
    return edge == 0 or not len(beyond) or bool(np.median(beyond) < _PARAMS.may_be_picture)


def _within(samples: UInt[np.ndarray, "frames lines across"]) -> tuple[int, int]:
    """Returns the first line within bars, and that after the last."""
    few = _few(samples)
    return _edge(few), few.shape[1] - _edge(few[:, ::-1])


def _flatness(
    samples: Float32[np.ndarray, "frames lines across"],
) -> tuple[Float32[np.ndarray, "lines across"], Float64[np.ndarray, "lines"]]:
    """Returns how far pixels are from the first lines' level in any frame, and which share of each line is flat."""
    level = np.median(samples[:, : _fewest(samples.shape[1])])
    apart = np.abs(samples - level).max(axis=0)
    return apart, (apart <= _PARAMS.alike).mean(axis=1)


def _soft(lines: int) -> int:
    return max(_PARAMS.least_px, round(_PARAMS.soft * lines))


def _edge(samples: Float32[np.ndarray, "frames lines across"]) -> int:
    """Returns how many of the first lines belong to a bar."""
    lines = samples.shape[1]
    apart, flat = _flatness(samples)
    edge = int(np.argmax(flat < _PARAMS.flat)) if (flat < _PARAMS.flat).any() else lines
    soft = _soft(lines)
    if not _fewest(lines) <= edge <= _PARAMS.most * lines or edge + 2 * soft > lines:
        return 0
    beyond = float(np.median(flat[edge + soft : edge + 2 * soft]))
    if beyond > _PARAMS.picture or float(np.median(flat[max(edge - soft, 0) : edge])) - beyond < _PARAMS.falls:
        return 0
    seen = np.median(apart, axis=1)
    if seen[: max(edge - soft, 1)].max() > _PARAMS.even:
        return 0
    steepest = _PARAMS.slope * float(np.median(seen[edge + soft : edge + 2 * soft]))
    for line in range(edge, edge + soft):
        if seen[line + 1] - seen[line] < steepest:
            break
        edge = line + 1
    return edge
