"""The widths of a photo's sharpest edges, and the limit that they set on the camera's speed.

A scene that moves s px/s across the sensor smears every edge across its path by s times the exposure. The sharpest
edges of a photo therefore bound the speed, whatever it shows: s <= width / exposure, and the motion over a whole
readout is at most width * readout / exposure. And if edges along the rows are wider than those along the columns, the
camera moved while each row was exposed, however long that was.
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

    from unshutter.motion.shapes import Float64
    from unshutter.readout_time import ReadoutTime


BANDS = 4  # of rows: the camera's motion may be uneven


@dataclass(frozen=True)
class BlurParams:
    """How edges limit the speed; by ``python lab/benchmarks/smears.py`` (docs/research/own-model-search.md)."""

    # ---- widths of edges
    lines: int = 128  # rows, and columns, that are examined
    contrast: int = 60  # least contrast of an edge, in levels of 255: more than that of noise and JPEG blocks
    sharpest: float = 10  # percentile of the widths that is used: noise and retouched areas may be even sharper
    min_edges: int = 30  # fewer are inconclusive
    outer: float = 0.25  # columns further than this from the centre [widths] reveal rotation
    doubt: float = 1.5  # standard deviation of a speed, in speed limits
    least_speed: float = 1e-4  # rows, and rad, over a readout: keeps its density finite,
    any_speed: float = 10.0  # and so does this
    leeway: float = 2.5  # multiple of the limit that refutes a motion: nine in ten blurred pictures are below
    usual: float = 1.25  # ratio of widths that 1 in 20 photos that stood still exceeds
    smeared: float = 1.6  # ratio of widths that none of them exceeds
    merged: float = 3.0  # factor on the speed: a merged photo may have exposures shorter than EXIF's

    # ---- smears: lengths in px of the copy in which they are measured
    side: int = 480  # short side of that copy
    smallest: int = 128  # its least short side
    bands: int = 8  # of rows
    window: int = 256  # of the spectra
    high: float = 0.3  # cycles per px, from which frequencies are high
    noise: tuple[float, float] = (0.003, 0.97)  # least and largest share of noise
    faint: float = 0.01  # power added to both, in squared levels
    ridge: float = 0.002  # towards b = 0
    clear: float = 1.2  # times the residual that remains: least residual without smears
    across: float = 1.4  # smeared edges are at least this multiple of the width of those along the columns
    shortest: float = 2.5  # what seems shorter may be the lens or sharpening
    to_edges: tuple[float, float] = (0.4, 2.8)  # length of smears, relative to the width of the sharpest edges
    error: float = 0.1  # relative error of c0
    slope_error: float = 0.3  # relative error of c1
    readout_error: float = 0.6  # largest relative error of the readout time for which smears are used
    temper: float = 0.1  # exponent that tempers the evidence of right angles on the direction
    misled: float = 0.16  # share of smeared photos whose direction right angles do not show, however sure they seem
    stated: float = 0.99  # probability that smears help along a direction that the user states
    error_left: float = 0.6  # error that remains, as a share of the expected one


BLUR = BlurParams()


@dataclass(frozen=True)
class SpeedLimit:
    """The fastest motion that a photo's sharpness allows, in its readout frame."""

    # [BANDS] change of t_x over a whole readout at the highest speed of each band [px]
    tx_px: Float64[np.ndarray, "bands"]
    # [BANDS] vertical displacement of the scene over a whole readout at that speed [px]
    ty_px: Float64[np.ndarray, "bands"]
    rz_rad: float  # change of r_z over a whole readout at the highest speed, over all rows [rad]
    exposure_s: float  # exposure time of each row [s]
    readout_s: float  # upper estimate of the readout time [s]

    @property
    def reason(self) -> Reason:
        """The reason to leave a photo unchanged that is too sharp for its motion."""
        exposure = f"1/{1 / self.exposure_s:.0f} s" if self.exposure_s < 0.3 else f"{self.exposure_s:.1f} s"
        return Reason.of(Code.TOO_SHARP, exposure=exposure)

    def precision(self, rows: int) -> Float64[np.ndarray, "6 6"]:
        """Returns that of Gaussians around zero speed at the centre of each band, in the coefficients of prior.py."""
        tx = np.clip(BLUR.doubt * self.tx_px / rows, BLUR.least_speed, BLUR.any_speed)
        rz = float(np.clip(BLUR.doubt * self.rz_rad, BLUR.least_speed, BLUR.any_speed))
        u = (np.arange(BANDS) + 0.5) / BANDS
        J_speed = np.stack([np.ones_like(u), 2 * u, 3 * u**2], axis=1)  # derivatives by the coefficients
        precision = np.zeros((6, 6))
        precision[:3, :3] = J_speed.T @ (J_speed / tx[:, None] ** 2)
        precision[3:, 3:] = J_speed.T @ J_speed / rz**2
        return precision

    def refutes(self, motion: Motion) -> bool:
        """Whether the photo would be less sharp if its camera had moved like this."""
        turning, velocity = motion.rates()
        per_readout = motion.height
        bands = np.array_split(np.abs(velocity) * per_readout, BANDS)
        fastest = np.array([np.median(band, axis=0) for band in bands])  # [BANDS, 2]
        rotated = np.median(np.abs(turning)) * per_readout
        allowed = BLUR.leeway * self.tx_px, BLUR.leeway * self.ty_px, BLUR.leeway * self.rz_rad
        return bool((fastest > np.stack(allowed[:2], axis=1)).any() or rotated > allowed[2])


@dataclass(frozen=True)
class EdgeWidths:
    """The widths of the sharpest edges; infinite where there are too few."""

    along_rows: Float64[np.ndarray, "bands"]  # [BANDS] of steps along the rows [px]
    along_columns: Float64[np.ndarray, "bands"]  # [BANDS] of steps along the columns [px]
    turning_rad: float  # of steps along the outer columns, by their distance from the centre

    @classmethod
    def of(cls, pixels: np.ndarray) -> EdgeWidths:
        """Measures pixels [H, W, bands] at full size in the readout frame, uint8 or uint16."""
        rows, columns = (_Edges.of(_lines(each)) for each in (pixels, pixels.swapaxes(0, 1)))
        height, width = pixels.shape[:2]
        off_centre = np.abs((columns.line + 0.5) / BLUR.lines - 0.5)
        outer = off_centre > BLUR.outer
        return cls(
            _by_bands(rows.line * height / BLUR.lines, rows.width, height),
            _by_bands(columns.middle, columns.width, height),
            _sharpest(columns.width[outer] / (off_centre[outer] * width)),
        )

    @property
    def smeared(self) -> float:
        """How clearly the camera moved along the rows while each was exposed, from 0 (not at all) to 1."""
        across, along = (float(np.median(widths)) for widths in (self.along_rows, self.along_columns))
        if not max(across, along) < math.inf:
            return 0.0
        return min(max(math.log(across / along / BLUR.usual) / math.log(BLUR.smeared / BLUR.usual), 0.0), 1.0)


def speed_limit(
    edges: Callable[[], EdgeWidths], exposure_s: float | None, readout_time: ReadoutTime, merged: bool
) -> SpeedLimit | None:
    """Returns the limit that a photo's sharpness sets on the speed, or None if exposure or edges are unknown.

    Args:
        edges: returns the widths of the photo's edges; not always called.
    """
    if exposure_s is None:
        return None
    if readout_time.longest_s == 0:
        return SpeedLimit(np.zeros(BANDS), np.zeros(BANDS), 0.0, exposure_s, 0.0)
    found = edges()
    if not np.isfinite([*found.along_rows, *found.along_columns, found.turning_rad]).any():
        return None
    readout_s = math.sqrt(readout_time.seconds * readout_time.longest_s)
    factor = readout_s / exposure_s * (BLUR.merged if merged else 1)
    tx_px = factor * found.along_rows
    ty_px = factor * found.along_columns
    return SpeedLimit(tx_px, ty_px, factor * found.turning_rad, exposure_s, readout_s)


@dataclass(frozen=True)
class _Edges:
    """Edges along lines: line index, position on it [px], and width [px]."""

    line: np.ndarray
    middle: np.ndarray
    width: np.ndarray

    @classmethod
    def of(cls, lines: np.ndarray) -> _Edges:
        """Finds runs of rising or falling brightness in uint8 [lines, px] by more than BLUR.contrast levels.

        Motion over L px turns each pixel's step into the difference of two values L apart, divided by L. So no edge is
        wider than the photo's brightness range divided by the edge's steepest step.
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
        flat = values.ravel()  # one more value per line than steps
        contrast = np.abs(flat[end + line] - flat[begin + line])
        whole = (begin > line * count) & (end < (line + 1) * count)  # not cut by the border
        strong = np.flatnonzero((contrast > BLUR.contrast) & whole)
        begin = begin[strong]
        end = end[strong]
        line = line[strong]
        contrast = contrast[strong]
        if not len(strong):
            return cls(line, begin.astype(float), contrast.astype(float))
        heights = np.append(np.abs(steps).ravel(), 0)  # lets the last run end there
        steepest = np.maximum.reduceat(heights, np.stack([begin, end], axis=1).ravel())[::2]
        darkest, brightest = np.percentile(lines[:, ::4], [1, 99])
        return cls(line, (begin + end) / 2 - line * count, np.maximum(brightest - darkest, contrast) / steepest)


def _lines(pixels: np.ndarray) -> np.ndarray:
    """Returns uint8 [BLUR.lines, px]: evenly spaced rows of pixels [H, W, bands], in green."""
    at = ((np.arange(BLUR.lines) + 0.5) * len(pixels) / BLUR.lines).astype(int)
    bands = pixels.shape[2]
    lines = pixels[at, :, 1 if bands >= 3 else 0]
    return lines if lines.dtype == np.uint8 else (lines >> 8).astype(np.uint8)


def _by_bands(row: np.ndarray, widths: np.ndarray, height: int) -> np.ndarray:
    """[BANDS] width of the sharpest edges in each band of rows [px]; of the whole photo for bands with few edges."""
    band = np.minimum((row * BANDS / height).astype(int), BANDS - 1)
    everywhere = _sharpest(widths)
    each = [_sharpest(widths[band == k]) for k in range(BANDS)]
    return np.array([width if np.isfinite(width) else everywhere for width in each])


def _sharpest(widths: np.ndarray) -> float:
    """Returns the width of the sharpest edges, or infinity if there are too few."""
    return float(np.percentile(widths, BLUR.sharpest)) if len(widths) >= BLUR.min_edges else np.inf
