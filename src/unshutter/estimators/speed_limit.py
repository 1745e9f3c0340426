"""How fast the camera can have moved: a photo that was exposed for long and is sharp limits its speed.

A scene that moves s px/s over the sensor smears every edge across its way by s times the exposure. So the sharpest
edges of a photo bound the speed, whatever it shows: s <= width / exposure, and the motion over a whole readout is at
most width * readout / exposure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unshutter.motion import Motion
from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    from collections.abc import Callable

    from unshutter.geometry.shapes import Float64
    from unshutter.photo.tags.readout_time import ReadoutTime

BANDS = 4  # of rows: the camera need not have moved evenly
_LINES = 128  # rows, and columns, that are looked at
_CONTRAST = 60  # levels of 255 that an edge rises or falls: noise does less, and so do the blocks of JPEG
_SHARPEST = 10  # per cent of the edges count as the sharpest: noise and retouched places may be sharper still
_FEWEST = 30  # edges; fewer of them say nothing
_OUTER = 0.25  # columns further than this from the middle [widths] show turning
_LEEWAY = 2.5  # a motion this many times the limit is refuted: nine of ten blurred pictures stay below (own-model.md)
_SMEARED, _SMEARED_PX = 2.0, 4.0  # times as wide as the others, and px: more than lenses and focus do
_MERGED = 3.0  # times as fast: of several exposures, the sharp parts may be from those that were shorter than EXIF says


@dataclass(frozen=True)
class SpeedLimit:
    """The fastest motion that the sharpness of a photo allows, in its readout frame.

    Attributes:
        tx_px: [BANDS] change of t_x over a whole readout at the highest speed of each band [px].
        ty_px: [BANDS] the same of the scene's motion up or down.
        rz_rad: the same of r_z, over all rows [rad].
        exposure_s: how long each row was exposed.
        readout_s: how long the readout may well have taken.
        smeared: whether edges across the rows are so much wider than those along them that the camera must have moved
            sideways while each row was exposed.
    """

    tx_px: Float64[np.ndarray, "bands"]
    ty_px: Float64[np.ndarray, "bands"]
    rz_rad: float
    exposure_s: float
    readout_s: float
    smeared: bool = False

    @property
    def reason(self) -> Reason:
        """Why a photo that this refutes is left unchanged."""
        if self.readout_s == 0:
            return Reason(Code.NO_ROLLING_SHUTTER)
        return Reason.of(Code.TOO_SHARP, exposure=_seconds(self.exposure_s))

    def refutes(self, motion: Motion) -> bool:
        """Whether the photo would be less sharp if its camera had moved like this."""
        turning, velocity = motion.rates()
        per_readout = motion.height
        bands = np.array_split(np.abs(velocity) * per_readout, BANDS)
        fastest = np.array([np.median(band, axis=0) for band in bands])  # [BANDS, 2]
        turned = np.median(np.abs(turning)) * per_readout
        allowed = _LEEWAY * self.tx_px, _LEEWAY * self.ty_px, _LEEWAY * self.rz_rad
        return bool((fastest > np.stack(allowed[:2], axis=1)).any() or turned > allowed[2])


def speed_limit(
    frame: Callable[[], np.ndarray], exposure_s: float | None, readout: ReadoutTime, merged: bool
) -> SpeedLimit | None:
    """What the sharpness of a photo says of its camera's speed; None where its exposure or edges are not known.

    Args:
        frame: gives the pixels [H, W, bands] at full size in the readout frame, uint8 or uint16; not always called.
        exposure_s: how long each line was exposed; None: unknown.
        readout: how long the readout took.
        merged: whether several exposures were put together.
    """
    if exposure_s is None:
        return None
    if readout.longest_s == 0:
        return SpeedLimit(np.zeros(BANDS), np.zeros(BANDS), 0.0, exposure_s, 0.0)
    pixels = frame()
    along_rows = _Edges.of(_lines(pixels))
    along_columns = _Edges.of(_lines(pixels.swapaxes(0, 1)))
    height, width = pixels.shape[:2]
    readout_s = math.sqrt(readout.typical_s * readout.longest_s)
    factor = readout_s / exposure_s * (_MERGED if merged else 1)
    across = _by_bands(along_rows.line * height / _LINES, along_rows.width, height)
    upright = _by_bands(along_columns.middle, along_columns.width, height)
    off_centre = np.abs((along_columns.line + 0.5) / _LINES - 0.5)
    outer = off_centre > _OUTER
    turning = _sharpest(along_columns.width[outer] / (off_centre[outer] * width))
    if not np.isfinite([*across, *upright, turning]).any():
        return None
    smeared = np.median(across) > max(_SMEARED * np.median(upright), _SMEARED_PX)
    return SpeedLimit(across * factor, upright * factor, turning * factor, exposure_s, readout_s, bool(smeared))


def _seconds(exposure_s: float) -> str:
    return f"1/{1 / exposure_s:.0f} s" if exposure_s < 0.3 else f"{exposure_s:.1f} s"


@dataclass(frozen=True)
class _Edges:
    """Edges along lines: which line, where on it [px], and how wide [px]."""

    line: np.ndarray
    middle: np.ndarray
    width: np.ndarray

    @classmethod
    def of(cls, lines: np.ndarray) -> _Edges:
        """Runs of rising or falling brightness in uint8 [lines, px] of more than _CONTRAST levels.

        Motion over L px makes a step of each pixel the difference of two that lay L apart, divided by L. So no edge is
        wider than the brightness range of the photo over its steepest step.
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
        whole = (begin > line * count) & (end < (line + 1) * count)  # not cut off by the border
        strong = np.flatnonzero((contrast > _CONTRAST) & whole)
        begin, end, line, contrast = begin[strong], end[strong], line[strong], contrast[strong]
        if not len(strong):
            return cls(line, begin.astype(float), contrast.astype(float))
        heights = np.append(np.abs(steps).ravel(), 0)  # so that a last run may end there
        steepest = np.maximum.reduceat(heights, np.stack([begin, end], axis=1).ravel())[::2]
        darkest, brightest = np.percentile(lines[:, ::4], [1, 99])
        return cls(line, (begin + end) / 2 - line * count, np.maximum(brightest - darkest, contrast) / steepest)


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
