"""How fast the camera can have moved: a photo that was exposed for long and is sharp nevertheless says so.

A scene that moves s px/s over the sensor smears every edge across its way by s times the exposure. So the sharpest
edges of a photo bound the speed, whatever it shows: s <= width / exposure, and the motion over a whole readout is at
most width * readout / exposure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unshutter.motion import Motion

if TYPE_CHECKING:
    from unshutter.estimators.base import View
    from unshutter.geometry.shapes import Float64

BANDS = 4  # of rows: the camera need not have moved evenly
_LINES = 192  # rows, and columns, that are looked at
_CONTRAST = 60  # levels of 255 that an edge rises or falls: noise does less, and so do the blocks of JPEG
_SHARPEST = 10  # per cent of the edges count as the sharpest: noise and retouched places may be sharper still
_FEWEST = 30  # edges; fewer of them say nothing
_OUTER = 0.25  # columns further than this from the middle [widths] show turning
_LEEWAY = 1.5  # a motion this many times the limit is refuted


@dataclass(frozen=True)
class SpeedLimit:
    """The fastest motion that the sharpness of a photo allows, in its readout frame.

    Attributes:
        tx_px: [BANDS] change of t_x over a whole readout at the highest speed of each band [px].
        ty_px: [BANDS] the same of the scene's motion up or down.
        rz_rad: the same of r_z, over all rows [rad].
        exposure_s: how long each row was exposed.
        readout_s: the longest time that the readout can have taken.
    """

    tx_px: Float64[np.ndarray, "bands"]
    ty_px: Float64[np.ndarray, "bands"]
    rz_rad: float
    exposure_s: float
    readout_s: float

    def refutes(self, motion: Motion) -> bool:
        """Whether the photo would be less sharp if its camera had moved like this."""
        turning, velocity = motion.rates()
        per_readout = motion.height
        bands = np.array_split(np.abs(velocity) * per_readout, BANDS)
        fastest = np.array([np.median(band, axis=0) for band in bands])  # [BANDS, 2]
        over = np.maximum(fastest[:, 0] / self.tx_px, fastest[:, 1] / self.ty_px).max()
        return bool(max(over, np.median(np.abs(turning)) * per_readout / self.rz_rad) > _LEEWAY)


def speed_limit(view: View) -> SpeedLimit | None:
    """What the sharpness of a photo says of its camera's speed; None where its exposure or edges are not known.

    Reads the photo at its full size.

    Raises:
        UnshutterError: the photo is damaged or gone.
    """
    exposure_s, readout = view.exposure_s(), view.readout_s()
    if exposure_s is None:
        return None
    pixels = view.readout.turn(view.photo.pixels)
    along_rows = _Edges.of(_lines(pixels))
    along_columns = _Edges.of(_lines(pixels.swapaxes(0, 1)))
    height, width = pixels.shape[:2]
    factor = readout.longest / exposure_s
    across = _by_bands(along_rows.line * height / _LINES, along_rows.width, height)
    upright = _by_bands(along_columns.middle, along_columns.width, height)
    off_centre = np.abs((along_columns.line + 0.5) / _LINES - 0.5)
    outer = off_centre > _OUTER
    turning = _sharpest(along_columns.width[outer] / (off_centre[outer] * width))
    limits = across * factor, upright * factor, turning * factor
    if not np.isfinite(limits[0]).any() and not np.isfinite(turning):
        return None
    return SpeedLimit(*limits, exposure_s, readout.longest)


@dataclass(frozen=True)
class _Edges:
    """Edges along lines: which line, where on it [px], and how wide [px]."""

    line: np.ndarray
    middle: np.ndarray
    width: np.ndarray

    @classmethod
    def of(cls, lines: np.ndarray) -> _Edges:
        """Runs of rising or falling brightness in uint8 [lines, px] of more than _CONTRAST levels.

        An edge's width is its contrast over its steepest step: of a straight ramp, as motion makes it, its length.
        """
        values = lines.astype(np.int16)
        steps = np.diff(values, axis=1)
        count = steps.shape[1]
        signs = np.sign(steps).astype(np.int8)
        begins = np.empty(signs.shape, dtype=bool)
        begins[:, 0] = True
        np.not_equal(signs[:, 1:], signs[:, :-1], out=begins[:, 1:])
        begin = np.flatnonzero(begins)
        end = np.append(begin[1:], signs.size)  # one past its last step
        line = begin // count
        flat = values.ravel()  # one value more a line than steps
        contrast = np.abs(flat[end + line] - flat[begin + line])
        strong = np.flatnonzero(contrast > _CONTRAST)
        begin, end, line, contrast = begin[strong], end[strong], line[strong], contrast[strong]
        if not len(strong):
            return cls(line, begin.astype(float), contrast.astype(float))
        heights = np.append(np.abs(steps).ravel(), 0)  # the last run ends one past the last step
        steepest = np.maximum.reduceat(heights, np.stack([begin, end], axis=1).ravel())[::2]
        return cls(line, (begin + end) / 2 - line * count, contrast / steepest)


def _lines(pixels: np.ndarray) -> np.ndarray:
    """uint8 [_LINES, px]: evenly spaced rows of pixels [H, W, bands], in green."""
    at = ((np.arange(_LINES) + 0.5) * len(pixels) / _LINES).astype(int)
    bands = pixels.shape[2]
    lines = pixels[at, :, 1 if bands >= 3 else 0]
    return lines if lines.dtype == np.uint8 else (lines >> 8).astype(np.uint8)


def _by_bands(row: np.ndarray, widths: np.ndarray, height: int) -> np.ndarray:
    """[BANDS] the sharpest edges of each band of rows [px]; of all where a band has few."""
    band = np.minimum((row * BANDS / height).astype(int), BANDS - 1)
    everywhere = _sharpest(widths)
    each = [_sharpest(widths[band == k]) for k in range(BANDS)]
    return np.array([width if np.isfinite(width) else everywhere for width in each])


def _sharpest(widths: np.ndarray) -> float:
    """The width of the sharpest edges; infinite where there are too few."""
    return float(np.percentile(widths, _SHARPEST)) if len(widths) >= _FEWEST else np.inf
