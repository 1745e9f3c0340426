"""Renders clips of places with an exact map: fast hands, walking, lenses, people who pass, little light.

Pictures are rendered at three times their size and averaged down. What is near or moves by itself stands on planes one
unit ahead of the camera's first axes: a fence, where the camera moves sideways, too, and figures that walk. The place
is infinitely far away. As each pixel's surface is known, so is where a rolling-shutter frame shows what a
global-shutter frame sees: the exact map, by fixed-point iteration, as a surface is seen by the row in which it is seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.lens import Lens
from unshutter.motion.shapes import Bool, Float, Float32, Float64, UInt8
from unshutter_lab.synthesis.handheld import draw_hand
from unshutter_lab.synthesis.panorama import Camera, Place
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera

FINER = 3  # times the size at which pictures are rendered
_BEYOND = 40  # rows above and below a frame in which surfaces are looked for
_ITERATIONS = 5  # of the exact map
_FAR, _FENCE, _FIGURES = 0, 1, 2  # surfaces; figures are counted on from the last
_TEXELS = 320.0  # pixels of a near surface per unit
_SWAY, _BOB = (0.05, 0.9), (0.03, 1.8)  # of a walking camera, across and down: size [units] and frequency [Hz]
_WALKS = (
    (-0.9, 0.45),
    (0.8, -0.6),
    (0.1, 0.5),
)  # figures: place at the first frame [units] and speed [units per second]
_EXPOSED, _MOMENTS = 0.5, 3  # exposure of a dark clip [frame intervals], as the mean of so many moments
_LIGHT = 0.4  # brightness of a dark clip
_TRIES = 100  # hands that are drawn
_USUAL_SHIFT = 90  # percentile of the frames' largest shifts


@dataclass(frozen=True)
class ClipSettings:
    """Settings of a rendered clip."""

    name: str
    fps: float
    readout_ms: float
    shift_px: float  # largest shift of a frame: nine in ten frames have less
    frames: int
    degrees: float = 75.0  # field of view, from side to side; through a lens from corner to corner
    k: tuple[float, float, float, float] | None = None  # of a lens that bends lines
    walks: bool = False  # whether the camera moves sideways, too, behind a fence
    figures: int = 0  # people who pass
    dark: bool = False  # whether rows are exposed for half a frame's time, and the picture is dark
    noise: float = 1.5  # standard deviation [levels of 255]
    # frequency [Hz] and amplitude [degrees] about each axis, as of a drone, on top of the shift
    vibration: tuple[float, float] | None = None
    repeated: int = 0  # every so many frames, one shows its predecessor again; 0: none does
    height: int = 270  # px
    width: int = 480


@dataclass(frozen=True)
class Seen:
    """The surface that each pixel of a picture sees."""

    surface: UInt8[np.ndarray, "h w"]  # 0: the place; 1: the fence; from 2 on: figures
    far: Float32[np.ndarray, "h w 3"]  # direction, in the camera's first axes
    near: Float32[np.ndarray, "h w 2"]  # place on its plane, about the surface's own origin [units]


class RenderedPlace:
    """A place, and the camera that records it."""

    def __init__(self, settings: ClipSettings, place: Place, rng: np.random.Generator):
        self.settings = settings
        self._place = place
        self._attitude = Camera(1, 1, 1.0, yaw=float(rng.uniform(0, 360))).attitude().astype(np.float32)
        self.lens: Lens | None = None
        if settings.k is None:
            self.focal_px = settings.width / 2 / float(np.tan(np.radians(settings.degrees / 2)))
        else:
            shape = Lens(1.0, settings.k)
            reach = np.hypot(1, settings.width / settings.height) / 2
            self.lens = replace(shape, focal=float(reach / shape.distance(np.radians(settings.degrees / 2))))
            self.focal_px = self.lens.focal * settings.height
        self.camera = self._drawn(rng)
        self._known_rays: dict[int, np.ndarray] = {}  # by how much finer they are than the frames

    @property
    def shift_px(self) -> float:
        """Largest shift of a frame in the true motion; nine in ten frames have less."""
        return _usual_shift(self.camera)

    def _drawn(self, rng: np.random.Generator) -> RotatingCamera:
        """Returns the camera in a hand that does not rotate too far.

        Raises:
            UnshutterError: all hands that were drawn do.
        """
        for _ in range(_TRIES):
            with suppress(UnshutterError):
                return self._turning(draw_hand(rng, self.settings.frames / self.settings.fps + 0.5))
        raise UnshutterError(
            f"{self.settings.name}: hands that shake as fast rotate the camera away: ask for less shift"
        )

    def _turning(self, log: RotationLog) -> RotatingCamera:
        """Returns the camera, rotating so fast that pixels shift by as much as the settings say."""
        f = self.settings
        size = {"height": f.height, "width": f.width, "focal_px": self.focal_px, "lens": self.lens}
        ratio = f.readout_ms * f.fps / 1000
        slow = RotatingCamera(_faster(log, 0.1), 0.1, f.frames, f.fps, ratio, **size)
        fast = _faster(log, 0.1 * f.shift_px / _usual_shift(slow))
        return replace(slow, log=fast if f.vibration is None else _vibrating(fast, *f.vibration))

    def shown(self, frame: int) -> int:
        """Returns the number of the picture that a frame shows: its own, or its predecessor's if that is repeated."""
        every = self.settings.repeated
        return frame - 1 if every and frame % every == every - 1 else frame

    def pictures(self, is_global: bool) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
        """Yields the frames, RGB, without noise."""
        picture = None
        for frame in range(self.settings.frames):
            if picture is None or self.shown(frame) == frame:
                picture = self._picture(frame, is_global)
            yield picture

    def _picture(self, frame: int, is_global: bool) -> UInt8[np.ndarray, "height width 3"]:
        f = self.settings
        times = self._times(frame, is_global, FINER)
        moments = _EXPOSED * ((np.arange(_MOMENTS) + 0.5) / _MOMENTS - 0.5) if f.dark else np.zeros(1)
        light = np.zeros((f.height, f.width, 3), np.float32)
        for moment in moments:
            fine = self._rendered(self.seen(times + moment, FINER), FINER)
            light += cv2.resize(fine, (f.width, f.height), interpolation=cv2.INTER_AREA)
        return np.rint(light * ((_LIGHT if f.dark else 1.0) / len(moments))).astype(np.uint8)

    def _rendered(self, seen: Seen, finer: int) -> UInt8[np.ndarray, "h w 3"]:
        picture = self._place.along(seen.far @ self._attitude.T, self.focal_px * finer)
        if not seen.surface.any():
            return picture
        at = seen.near * _TEXELS + len(self._texture) / 2
        near = cv2.remap(self._texture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        return np.where((seen.surface != _FAR)[..., None], near, picture)

    @cached_property
    def _texture(self) -> UInt8[np.ndarray, "n n 3"]:
        """What is seen behind the camera: near surfaces show it."""
        side = 512
        line = ((np.arange(side) + 0.5) * 2 / side - 1).astype(np.float32)
        across, down = np.meshgrid(line, line)
        return self._place.along(np.stack([across, down, -np.ones_like(across)], axis=-1), side / 2)

    # ---- geometry ----------------------------------------------------------------------------------------

    def seen(self, times: Float64[np.ndarray, "h"], finer: int = 1) -> Seen:
        """Returns what the rows of a picture see, each at its time [frame intervals]."""
        rotations = self.camera.rotations(np.maximum(times, 0.0)).astype(np.float32)
        far = self._rays(finer) @ rotations  # R^T d for each row
        meets = far[..., :2] / np.maximum(far[..., 2:], 1e-3)
        surface = np.zeros(far.shape[:2], np.uint8)
        near = np.zeros((*surface.shape, 2), np.float32)
        for number, origin in self._origins(times):
            at = meets - origin[:, None].astype(np.float32)
            inside = _in_fence(at) if number == _FENCE else _in_figure(at)
            surface[inside] = number
            near[inside] = at[inside]
        return Seen(surface, far, near)

    def exact_map(self, frame: int) -> tuple[Float32[np.ndarray, "h w 2"], Bool[np.ndarray, "h w"]]:
        """Returns where a rolling-shutter frame shows what the global-shutter one sees (col, row).

        Also returns whether it shows the same still surface there, a pixel or more away from what hides or moves.
        """
        f = self.settings
        wanted = self.seen(self._times(frame, True, 1))
        own = np.stack(np.meshgrid(np.arange(f.width), np.arange(f.height)), axis=-1).astype(np.float64)
        rows = np.arange(-_BEYOND, f.height + _BEYOND)
        times = self._row_times(frame, rows)
        rotated = self.camera.rotations(np.maximum(times, 0.0))
        origins = dict(self._origins(times))
        at = own
        for _ in range(_ITERATIONS):
            row = np.clip(at[..., 1] + _BEYOND, 0, len(rows) - 1)
            ray = wanted.far.astype(np.float64)
            for number, origin in origins.items():
                here = wanted.surface == number
                on = wanted.near[here] + _between(origin, row[here])
                ray[here] = np.concatenate([on, np.ones((len(on), 1))], axis=-1)
            at = self._positions((_between(rotated, row) @ ray[..., None])[..., 0])
        there = self.seen(self._times(frame, False, 1)).surface
        nearest = np.rint(at).astype(int)
        inside = (nearest >= 0).all(axis=-1) & (nearest < [f.width, f.height]).all(axis=-1)
        nearest = np.clip(nearest, 0, [f.width - 1, f.height - 1])
        still = inside & _alone(wanted.surface)
        still &= _alone(there)[nearest[..., 1], nearest[..., 0]]
        still &= there[nearest[..., 1], nearest[..., 0]] == wanted.surface
        return at.astype(np.float32), still

    def _times(self, frame: int, is_global: bool, finer: int) -> Float64[np.ndarray, "h"]:
        rows = (np.arange(self.settings.height * finer) + 0.5) / finer - 0.5
        times = self._row_times(frame, rows)
        return np.full_like(times, frame + self.camera.readout_ratio / 2) if is_global else times

    def _row_times(self, frame: int, rows: np.ndarray) -> Float64[np.ndarray, "rows"]:
        return frame + self.camera.readout_ratio * (rows + 0.5) / self.settings.height

    def _origins(self, times: Float64[np.ndarray, "t"]) -> Iterator[tuple[int, Float64[np.ndarray, "t 2"]]]:
        """Yields the origin of each near surface, as seen from the camera at times [units]."""
        seconds = times / self.settings.fps
        moved = np.zeros((len(times), 2))
        if self.settings.walks:
            moved = np.stack([size * np.sin(2 * np.pi * hertz * seconds) for size, hertz in (_SWAY, _BOB)], axis=-1)
            yield _FENCE, -moved
        for number, (place, speed) in enumerate(_WALKS[: self.settings.figures]):
            yield _FIGURES + number, np.stack([place + speed * seconds, 0 * seconds], axis=-1) - moved

    def _rays(self, finer: int) -> Float32[np.ndarray, "h w 3"]:
        """Returns the directions in which the pixels of a picture look, in the camera's axes."""
        if finer in self._known_rays:
            return self._known_rays[finer]
        f = self.settings
        sides = (((np.arange(n * finer) + 0.5) / finer - n / 2) / self.focal_px for n in (f.width, f.height))
        x, y = np.meshgrid(*sides)
        directions = (x, y, np.ones_like(x)) if self.lens is None else self.lens.direction(x, y)
        self._known_rays[finer] = np.stack(directions, axis=-1).astype(np.float32)
        return self._known_rays[finer]

    def _positions(self, rays: Float64[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w 2"]:
        """Returns where directions in the camera's axes are seen (col, row)."""
        if self.lens is None:
            at = rays[..., :2] / np.maximum(rays[..., 2:], 1e-3)
        else:
            at = np.stack(self.lens.position(*np.moveaxis(rays, -1, 0)), axis=-1)
        return at * self.focal_px + [(self.settings.width - 1) / 2, (self.settings.height - 1) / 2]


def _faster(log: RotationLog, times: float) -> RotationLog:
    """Returns a log in which the camera rotates ``times`` as fast."""
    return RotationLog(log.t_s, log.yaw_rad_s * times, log.roll_rad_s * times, log.pitch_rad_s * times)


def _vibrating(log: RotationLog, hertz: float, degrees: float) -> RotationLog:
    """Returns a log in which the camera also vibrates about all three axes, out of step."""
    speed = 2 * np.pi * hertz
    rates = (np.radians(degrees) * speed * np.cos(speed * log.t_s + phase) for phase in (0.0, 2.0, 4.0))
    yaw, roll, pitch = rates
    return RotationLog(log.t_s, log.yaw_rad_s + yaw, log.roll_rad_s + roll, log.pitch_rad_s + pitch)


def _usual_shift(camera: RotatingCamera) -> float:
    shifts = [camera.motion(frame, "middle").largest_px for frame in range(0, camera.frames, 3)]
    return float(np.percentile(shifts, _USUAL_SHIFT))


def _in_fence(at: Float32[np.ndarray, "h w 2"]) -> Bool[np.ndarray, "h w"]:
    """Whether places are on the fence, whose upper edge goes up and down."""
    return at[..., 1] > 0.26 + 0.05 * np.sin(9 * at[..., 0])


def _in_figure(at: Float32[np.ndarray, "h w 2"]) -> Bool[np.ndarray, "h w"]:
    """Whether places are on a figure: a head above a body."""
    across, down = at[..., 0], at[..., 1]
    head = np.hypot(across, down + 0.26) < 0.06
    return head | ((across / 0.11) ** 2 + ((down - 0.1) / 0.31) ** 2 < 1)


def _alone(surface: UInt8[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Whether pixels are on a surface that stands still, and so are those within two pixels, on the same one."""
    around = np.ones((5, 5), np.uint8)
    return (cv2.erode(surface, around) == cv2.dilate(surface, around)) & (surface < _FIGURES)


def _between(values: Float[np.ndarray, "rows *more"], at: Float64[np.ndarray, "*place"]) -> np.ndarray:
    """Returns what lies between values at fractions of rows, linearly."""
    first = np.clip(np.floor(at).astype(int), 0, len(values) - 2)
    share = (at - first).reshape(*at.shape, *[1] * (values.ndim - 1))
    return values[first] * (1 - share) + values[first + 1] * share
