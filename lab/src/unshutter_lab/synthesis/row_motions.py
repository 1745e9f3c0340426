"""Row motions for synthesising pictures: random quadratics, and windows of recorded camera rotation.

A picture is distorted on a canvas larger than the part that is kept, so that its borders remain inside. A
:class:`DrawnMotion` therefore holds one motion in two forms: on every row of the square canvas, and on the rows of the
square crop in its centre. Both are zero on the crop's first row and rotate about the common centre of canvas and crop.

Motion blur: rolling-shutter pictures whose lines have an exposure time, as in a real camera.

The exposure of a line is centred on the time for which its motion is known. During the exposure the picture moves with
the velocity of its motion at that line. The picture is distorted once for each of several moments of the exposure, and
the results are averaged in linear light (sRGB, IEC 61966-2-1), as on a sensor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion, RowMotion
from unshutter.motion.shapes import Float
from unshutter.motion.warp import distort_pixels
from unshutter_lab.synthesis.rotation_log import RotationLog

_PREDECESSORS_ROWS = 256  # number of rows for which the predecessor's generator states its pixel ranges


@dataclass(frozen=True)
class DrawnMotion:
    """One motion on the rows of a square canvas and of the square crop in its centre."""

    canvas: Motion  # on every row of the canvas; zero on the crop's first row, not on its own
    crop: Motion  # on the rows of the crop; reference row: the first
    parameters: dict[str, float | str]  # the drawn values, for the manifest: numbers and words only

    @classmethod
    def of_canvas(
        cls, tx_px: Float[np.ndarray, "canvas"], rz_rad: Float[np.ndarray, "canvas"], rows: int, parameters: dict
    ) -> DrawnMotion:
        """Creates both motions, zero on the first row of a crop with this number of rows."""
        canvas = len(tx_px)
        margin = _margin(rows, canvas)
        tx, rz = tx_px - tx_px[margin], rz_rad - rz_rad[margin]
        crop_rows = slice(margin, margin + rows)
        return cls(RowMotion(canvas, tx, rz), RowMotion(rows, tx[crop_rows], rz[crop_rows]), parameters)

    @property
    def margin(self) -> int:
        """Number of canvas rows above and below the crop, and of columns on each side of it."""
        return (self.canvas.height - self.crop.height) // 2

    def resized(self, short_side: int) -> DrawnMotion:
        """Returns this motion on the largest canvas in a picture with this short side.

        The crop keeps its share of the canvas, round(rows * short_side / canvas) rows; the canvas loses a row and a
        column if their difference would be odd. Interpolated linearly at row centres, t_x scaled with the size.
        """
        rows = round(self.crop.height * short_side / self.canvas.height)
        canvas = short_side - (short_side - rows) % 2
        scale, margin = rows / self.crop.height, (canvas - rows) // 2
        known = (np.arange(self.canvas.height) - self.margin + 0.5) * scale - 0.5 + margin
        tx, rz = self.canvas.tx_px * scale, self.canvas.rz_rad
        whole = RowMotion.from_key_rows(known.tolist(), tx.tolist(), rz.tolist(), canvas, canvas)
        return DrawnMotion.of_canvas(whole.tx_px, whole.rz_rad, rows, self.parameters)


def draw_quadratic(
    rng: np.random.Generator, rows: int = 256, canvas: int = 356, pure_rotation: bool = True
) -> DrawnMotion:
    """Draws a motion from the generator of Rengarajan, Balaji, Rajagopalan (CVPR 2017).

    On canvas row i, with n the canvas's rows: t_x = a (5i/n)^2 + b (5i/n) px, a in (-3, 3), b in (-6, 6);
    r_z = [c (i/n)^2 + d (i/n)] pi/8 rad, c and d in (-0.4, 0.4), all uniform; both minus their value on the
    crop's first row. One motion in six is a pure translation, with ``pure_rotation`` another a pure rotation (which the
    predecessor's program intends, but never reaches). For sizes other than their 256 rows the pixels scale with the
    rows. Draws five numbers.
    """
    _margin(rows, canvas)
    kind, a, b, c, d = rng.uniform([0, -3, -6, -0.4, -0.4], [6, 3, 6, 0.4, 0.4]).tolist()
    if kind < 1:
        c = d = 0.0
    elif kind < 2 and pure_rotation:
        a = b = 0.0
    u = np.arange(canvas) / canvas
    tx = (a * (5 * u) ** 2 + b * (5 * u)) * (rows / _PREDECESSORS_ROWS)
    rz = (c * u**2 + d * u) * (np.pi / 8)
    return DrawnMotion.of_canvas(tx, rz, rows, {"alpha_tx": a, "beta_tx": b, "alpha_rz": c, "beta_rz": d})


def draw_from_trajectory(
    rng: np.random.Generator,
    log: RotationLog,
    readout_s: float,
    focal_px: float,
    rows: int = 256,
    canvas: int = 356,
) -> DrawnMotion:
    """Cuts a window of one readout from a log of camera rotation.

    The window starts anywhere in the log where no samples are missing, with equal probability. Rotation about the
    picture's vertical moves the scene by t_x = focal_px * tan(angle), rotation about the optical axis is r_z. Rotation
    about the picture's horizontal and translation of the camera are ignored, because the motion model has neither. For
    the assignment of the log's axes see :class:`RotationLog`.

    Args:
        rng: generator from which one number is drawn.
        log: recorded rotation.
        readout_s: readout time of the crop, ``rows`` times that of one row; the canvas's margins take longer.
        focal_px: focal length in pixels of the crop.
        rows, canvas: sides of crop and canvas [px].
    """
    margin = _margin(rows, canvas)
    if not (0 < readout_s < np.inf and 0 < focal_px < np.inf):
        raise UsageError(f"readout and focal length must be positive, got {readout_s:g} s and {focal_px:g} px")
    line_s = readout_s / rows
    start = log.draw_start(rng, (canvas - 1) * line_s)
    yaw, roll = log.angles(start + np.arange(canvas) * line_s)  # each [canvas]
    yaw, roll = yaw - yaw[margin], roll - roll[margin]
    if max(np.abs(yaw).max(), np.abs(roll).max()) > 1:
        raise UnshutterError(
            f"the recorded camera turns by more than 57 degrees within {readout_s:g} s: choose a shorter readout"
        )
    parameters = {"start_s": start, "readout_s": readout_s, "focal_px": focal_px}
    return DrawnMotion.of_canvas(focal_px * np.tan(yaw), roll, rows, parameters)


def _margin(rows: int, canvas: int) -> int:
    if rows < 2 or canvas < rows or (canvas - rows) % 2:
        raise UsageError(
            f"cannot cut {rows} px out of the middle of a canvas of {canvas} px: "
            "the size must be at least 2 and the canvas larger by an even number"
        )
    return (canvas - rows) // 2


_STEP_PX = 0.75  # largest step between two moments
_MOST_MOMENTS = 65


def distorted(pixels: np.ndarray, motion: Motion, rows: float = 0.0) -> np.ndarray:
    """Returns the rolling-shutter picture of a global-shutter one [H, W, bands], uint8 or uint16.

    ``rows`` is the number of rows read during an exposure; 0 for no blur.
    """
    if not rows or motion.height < 2:
        return distort_pixels(pixels, motion)
    velocities = np.gradient(motion.tx_px), np.gradient(motion.rz_rad)
    reach = math.hypot(motion.width, motion.height) / 2
    fastest = (np.abs(velocities[0]) + np.abs(velocities[1]) * reach).max()
    count = int(np.clip(math.ceil(fastest * rows / _STEP_PX), 1, _MOST_MOMENTS))
    linear, _ = linear_light(pixels.dtype)
    total = np.zeros(pixels.shape, np.float32)
    for moment in (np.arange(count) + 0.5) / count - 0.5:
        tx, rz = (
            known + moment * rows * velocity
            for known, velocity in zip((motion.tx_px, motion.rz_rad), velocities, strict=True)
        )
        moved = RowMotion(motion.width, tx, rz, reference=motion.reference, scan_direction=motion.scan_direction)
        total += linear[distort_pixels(pixels, moved)]
    return encoded_light(total / count, pixels.dtype)


def encoded_light(light: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Returns the pixel values of linear light 0 ... 1."""
    encoded = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(encoded * np.iinfo(dtype).max).astype(dtype)


def linear_light(dtype: np.dtype) -> tuple[np.ndarray, int]:
    """Returns the linear light 0 ... 1 of each pixel value, and the largest value."""
    most = int(np.iinfo(dtype).max)
    value = np.arange(most + 1, dtype=np.float32) / most
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32), most
