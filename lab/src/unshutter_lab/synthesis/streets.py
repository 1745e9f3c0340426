"""Draws streets with depth: houses with balconies and roofs, seen by cameras that turn and walk, or ride past.

Unlike a place, which is infinitely far away, a street shows parallax: near walls move farther than those behind. Where
each pixel of the reference picture is seen in the rolling-shutter one is known exactly all the same, since each row has
a camera of its own, and each pixel its point on a surface.

Axes are those of synthesis/panorama.py, the origin is the camera at its first row, and the unit is its height above the
ground. What lies behind the houses is a place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from unshutter.motion import RowMotion
from unshutter.motion.shapes import Float32, Float64, UInt8
from unshutter_lab.synthesis.panorama import Camera, Place, pixel_directions
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.walls import TEXTURE, clouds, draw_wall

_ITERATIONS = 8  # of the exact positions
_SPARSE = 4  # px between those at which the nearest motion is fitted
_NEAR = 0.05  # units: what is closer to the camera is not seen
_FLAT = 1e-9  # of a denominator that may be zero
_MARGIN = 3.0  # px around the corners of a surface in which it is looked for
_FLOOR = 1.9  # height of a storey [units]
_ALONG_STREETS = 0.8  # share of the houses that stand along the same streets
_CLEAR = 1.5  # units around the camera without houses


@dataclass(frozen=True, eq=False)
class Surface:
    """A parallelogram with a texture."""

    corner: np.ndarray  # [3] its upper left corner
    across: np.ndarray  # [3] from there to the upper right one,
    down: np.ndarray  # [3] and to the lower left one
    texture: Float32[np.ndarray, "h w 3"]

    def corners(self) -> Float64[np.ndarray, "4 3"]:
        """Returns all four corners."""
        shares = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        return self.corner + shares @ np.stack([self.across, self.down])


@dataclass(frozen=True)
class Passing:
    """A camera that rotates as recorded in a log, whose first row is read at time 0, and moves evenly."""

    camera: Camera
    log: RotationLog
    readout_s: float  # time from the first row to that after the last
    speed: tuple[float, float] = (0.0, 0.0)  # units per second, along x and z of the street

    def poses(self, rows: Float64[np.ndarray, "*rows"]) -> tuple[Float64[np.ndarray, "*rows 3 3"], np.ndarray]:
        """Returns the rotations from the camera's axes to those of the street, and its places, at rows."""
        times = np.asarray(rows, float) * (self.readout_s / self.camera.height)
        rotations = self.log.rotations(np.append(times.ravel(), 0.0))
        turned = (rotations[:-1] @ rotations[-1].T).reshape(*times.shape, 3, 3)
        return self.camera.attitude() @ turned.swapaxes(-1, -2), times[..., None] * _flat(np.array(self.speed))


class Street:
    """Surfaces before a place."""

    def __init__(self, surfaces: Sequence[Surface], ground: np.ndarray, behind: Place):
        self._surfaces = surfaces
        self._ground = ground  # texture of two units
        self._behind = behind

    def seen(self, passing: Passing, finer: int = 1, *, is_global: bool = False) -> UInt8[np.ndarray, "h w 3"]:
        """Returns the picture, RGB, rendered so many times finer and averaged down; or that of the first row alone."""
        camera = passing.camera
        rows = (np.arange(camera.height * finer) + 0.5) / finer - 0.5
        picture, _ = self._rendered(passing, 0 * rows if is_global else rows, finer)
        size = camera.width, camera.height
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if finer > 1 else picture
        return np.clip(np.rint(picture), 0, 255).astype(np.uint8)

    def moved(self, passing: Passing) -> Float64[np.ndarray, "2 h w"]:
        """Returns how far off the rolling-shutter picture shows what each pixel of the first row's camera sees.

        Columns, then rows [px]; also of what is hidden there.
        """
        camera = passing.camera
        _, depth = self._rendered(passing, np.zeros(camera.height), 1)
        rotations, _ = passing.poses(np.zeros(1))
        directions = np.stack(_rays(rotations.repeat(camera.height, 0), camera, 1), -1).astype(np.float64)
        reach = np.where(np.isfinite(depth), depth, 1.0)[..., None]
        far = ~np.isfinite(depth)[..., None]
        row = np.broadcast_to(np.arange(camera.height, dtype=float)[:, None], depth.shape)
        keys = np.arange(-camera.height, 2 * camera.height + 1, 4.0)
        attitudes, places = passing.poses(keys)
        for _ in range(_ITERATIONS):
            at = np.clip((row - keys[0]) / 4, 0, len(keys) - 1.001)
            before, share = at.astype(int), at % 1
            attitude = _between(attitudes, before, share)
            moved = directions * reach - np.where(far, 0.0, _between(places, before, share))
            x, y, z = np.moveaxis((attitude.swapaxes(-1, -2) @ moved[..., None])[..., 0], -1, 0)
            z = np.maximum(z, _NEAR / 10)
            row = camera.focal_px * y / z + (camera.height - 1) / 2
        col = camera.focal_px * x / z + (camera.width - 1) / 2
        return np.stack([col, row]) - np.indices(depth.shape)[::-1]

    def _rendered(self, passing: Passing, rows: np.ndarray, finer: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns the picture [h, w, 3] float32, and how many times the rays reach what is seen [h, w]."""
        rotations, places = passing.poses(rows)
        x, y, z = _rays(rotations, passing.camera, finer)
        picture = self._behind.along(np.stack([x, y, z], -1), passing.camera.focal_px * finer).astype(np.float32)
        depth = np.full(x.shape, np.inf, np.float32)
        place = places.astype(np.float32)
        reach = (1 - place[:, 1:2]) / np.where(y > 1e-3, y, np.nan)
        below = np.isfinite(reach)
        depth[below] = reach[below]
        on_x, on_z = (place[:, k : k + 1] + reach * axis for k, axis in ((0, x), (2, z)))
        tiles = _repeated(self._ground, np.where(below, on_x, 0) / 2, np.where(below, on_z, 0) / 2)
        haze = np.clip(np.where(below, reach, 0) / 25, 0, 1)[..., None]  # tiles too small to be seen are one colour
        picture[below] = (tiles + (self._ground.mean((0, 1)) - tiles) * haze)[below]
        for surface in self._surfaces:
            part = _part(surface, passing, rows, finer, depth.shape)
            if part is not None:
                _paint(surface, (x[part], y[part], z[part]), place[part[0]], picture[part], depth[part])
        return picture, depth


def draw_street(dice: np.random.Generator, behind: Place, camera: Camera) -> Street:
    """Draws houses around a camera, the first of them in front of it."""
    streets = dice.uniform(0, np.pi / 2)
    tall = dice.uniform(0, 0.7)  # share of high houses
    surfaces: list[Surface] = []
    for number in range(int(dice.integers(5, 13))):
        angle = streets if dice.random() < _ALONG_STREETS else dice.uniform(0, np.pi / 2)
        distance, towards = dice.uniform(3, 18), dice.uniform(0, 2 * np.pi)
        if number == 0:
            distance, towards = dice.uniform(5, 13), np.pi / 2 - np.radians(camera.yaw + dice.uniform(-20, 20))
        middle = distance * np.array([np.cos(towards), np.sin(towards)])
        half = dice.uniform(1.5, 7, 2)
        axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        if np.all(np.abs(axes @ middle) < half + _CLEAR):  # the camera would stand in it
            continue
        floors = int(dice.integers(6, 18)) if dice.random() < tall else int(dice.integers(2, 6))
        surfaces += _house(dice, middle, half, axes, floors)
    ground = np.full((128, 128, 3), dice.uniform(50, 190) + dice.uniform(-20, 20, 3), np.float32)
    ground *= 1 + dice.uniform(0.05, 0.2) * clouds(dice, 128)[..., None]
    thick = int(dice.integers(1, 6))
    ground[:thick] *= 0.75
    ground[:, :thick] *= 0.75
    return Street(surfaces, ground, behind)


def _house(
    dice: np.random.Generator, middle: np.ndarray, half: np.ndarray, axes: np.ndarray, floors: int
) -> list[Surface]:
    """Returns the walls of a house that can be seen, with what stands out from them, and its roof."""
    height = floors * _FLOOR
    bay = dice.uniform(1.2, 2.5)  # from window to window
    base = draw_wall(dice, 1.0, (floors, round(2 * float(half.mean()) / bay)))
    pitch = dice.uniform(0.3, 1.1) * half.min() if dice.random() < 0.5 else 0.0
    roof = _plain(dice)
    surfaces: list[Surface] = []
    for side in range(4):
        outwards = axes[side % 2] * (1 if side < 2 else -1)
        reach, width = half[side % 2], 2 * half[1 - side % 2]
        foot = middle + outwards * reach
        along = np.array([outwards[1], -outwards[0]])  # to the right, as seen from outside
        light = dice.uniform(0.55, 1.15)
        edge = _at(foot - along * width / 2, 1 - height)
        across, inwards = _flat(along * width), _flat(-outwards)
        if pitch:
            over = 0.25 * -inwards + np.array([0.0, 0.25 * pitch / half.min(), 0.0])
            rise = np.array([0.0, -pitch, 0.0]) + inwards * half.min()
            surfaces.append(Surface(edge + rise, across, over - rise, roof * light))
        if foot @ outwards > 0:  # it is seen from behind
            continue
        own = draw_wall(dice, 1.0, (floors, round(width / bay))) if dice.random() < 0.4 else base
        wall = Surface(edge, across, np.array([0.0, height, 0.0]), _reduced(own * light, foot, width, height))
        surfaces.append(wall)
        if dice.random() < 0.6 and np.hypot(*foot) < 16:
            surfaces += _balconies(dice, wall, -inwards, floors)
        if dice.random() < 0.4:
            surfaces += _slab(dice, edge, across, -inwards, dice.uniform(0.1, 0.5), 0.25, light)
    return surfaces


def _balconies(dice: np.random.Generator, wall: Surface, outwards: np.ndarray, floors: int) -> list[Surface]:
    """Returns balconies in columns, from the first floor on."""
    width = float(np.linalg.norm(wall.across))
    columns = max(1, int(dice.integers(1, max(2, int(width / 2.5) + 1))))
    share = dice.uniform(0.25, 0.9) if columns > 1 else dice.uniform(0.15, 1.0)
    depth, high, light = dice.uniform(0.3, 0.9), dice.uniform(0.4, 0.7), dice.uniform(0.6, 1.1)
    found: list[Surface] = []
    for floor in range(1, min(floors, 7)):
        for column in range(columns):
            start = (column + (1 - share) / 2) / columns
            top = np.array([0.0, 1 - floor * _FLOOR - high, 0.0])
            corner = wall.corner * [1, 0, 1] + wall.across * start + top
            found += _slab(dice, corner, wall.across * (share / columns), outwards, depth, high, light)
    return found


def _slab(
    dice: np.random.Generator,
    corner: np.ndarray,
    across: np.ndarray,
    outwards: np.ndarray,
    depth: float,
    high: float,
    light: float,
) -> list[Surface]:
    """Returns what is seen of a box on a wall: its front, its ends, and its upper or lower side."""
    colour = _plain(dice) * light
    out, down = outwards * depth, np.array([0.0, high, 0.0])
    level = corner if corner[1] > 0 else corner + down
    sides = [
        Surface(corner + out, across, down, _railing(dice, colour)),
        Surface(corner, out, down, colour * 0.8),
        Surface(corner + across, out, down, colour * 0.7),
        Surface(level, across, out, colour * 0.5),
    ]
    return sides


def _railing(dice: np.random.Generator, colour: np.ndarray) -> np.ndarray:
    """Returns the texture of a front: plain, or of bars."""
    front = colour.copy()
    if dice.random() < 0.5:
        step = int(dice.integers(4, 9))
        front[8:, ::step] *= 0.5
        front[:3] *= 0.7
    return front


def _plain(dice: np.random.Generator) -> np.ndarray:
    """Returns a texture of one colour with stains and courses."""
    texture = np.full((64, 64, 3), dice.uniform(40, 220) + dice.uniform(-30, 30, 3), np.float32)
    texture *= 1 + dice.uniform(0, 0.2) * clouds(dice, 64)[..., None]
    texture[:: int(dice.integers(4, 16))] *= dice.uniform(0.75, 1.0)
    return texture


def _reduced(texture: np.ndarray, foot: np.ndarray, width: float, height: float) -> np.ndarray:
    """Returns a texture about as large as the wall is seen, so that it is not sampled too coarsely."""
    px = 500 / max(float(np.hypot(*foot)), 1.0)
    columns, rows = (int(np.clip(px * length, 8, TEXTURE)) for length in (width, height))
    return cv2.resize(texture, (columns, rows), interpolation=cv2.INTER_AREA)


def _flat(along: np.ndarray) -> np.ndarray:
    return np.array([along[0], 0.0, along[1]])


def _at(point: np.ndarray, y: float) -> np.ndarray:
    return np.array([point[0], y, point[1]])


def _rays(rotations: np.ndarray, camera: Camera, finer: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the directions of a picture's pixels, given the rotation of each of its rows."""
    return pixel_directions(rotations, camera.focal_px * finer, camera.width * finer)


def _between(values: np.ndarray, before: np.ndarray, share: np.ndarray) -> np.ndarray:
    share = share.reshape(*share.shape, *[1] * (values.ndim - 1))
    return values[before] * (1 - share) + values[before + 1] * share


def _repeated(texture: np.ndarray, across: np.ndarray, along: np.ndarray) -> np.ndarray:
    col, row = (((place % 1) * len(texture)).astype(np.float32) for place in (across, along))
    return cv2.remap(texture, col, row, cv2.INTER_LINEAR, None, cv2.BORDER_WRAP)


def _part(
    surface: Surface, passing: Passing, rows: np.ndarray, finer: int, shape: tuple[int, ...]
) -> tuple[slice, slice] | None:
    """Returns the part of a picture in which a surface may be seen; None if there is none."""
    camera, ends = passing.camera, []
    for attitude, place in zip(*passing.poses(rows[[0, len(rows) // 2, -1]]), strict=True):
        x, y, z = ((surface.corners() - place) @ attitude).T
        if (z < _NEAR).all():
            continue
        if (z < _NEAR).any():
            return slice(0, shape[0]), slice(0, shape[1])
        ends.append(np.stack([x, y]) / z * camera.focal_px * finer)
    if not ends:
        return None
    low, high = (pick(np.concatenate(ends, 1), axis=1) for pick in (np.min, np.max))
    reach = _MARGIN * finer + 0.03 * (high - low)
    middle = np.array([shape[1] - 1, shape[0] - 1]) / 2
    first = np.maximum(np.floor(low - reach + middle), 0).astype(int)
    last = np.minimum(np.ceil(high + reach + middle) + 1, [shape[1], shape[0]]).astype(int)
    return (slice(first[1], last[1]), slice(first[0], last[0])) if (last > first).all() else None


def _paint(
    surface: Surface,
    rays: tuple[np.ndarray, np.ndarray, np.ndarray],
    places: np.ndarray,
    picture: np.ndarray,
    depth: np.ndarray,
) -> None:
    """Draws a surface where it is nearer than what is there already; picture and depth are changed."""
    normal = np.cross(surface.across, surface.down)
    sizes = surface.across @ surface.across, surface.down @ surface.down
    slope = sum(float(n) * ray for n, ray in zip(normal, rays, strict=True))
    ahead = ((surface.corner - places) @ normal)[:, None]
    reach = (ahead / np.where(np.abs(slope) < _FLAT, _FLAT, slope)).astype(np.float32)
    start = places - surface.corner
    shares = []
    for edge, size in zip((surface.across, surface.down), sizes, strict=True):
        along = sum(float(e) * ray for e, ray in zip(edge, rays, strict=True))
        shares.append(((start @ edge)[:, None] + reach * along) / size)
    across, down = (share.astype(np.float32) for share in shares)
    shown = (reach > _NEAR) & (reach < depth) & (across >= 0) & (across <= 1) & (down >= 0) & (down <= 1)
    if not shown.any():
        return
    rows, columns = surface.texture.shape[:2]
    at = across * columns - 0.5, down * rows - 0.5
    colours = cv2.remap(surface.texture, *at, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    picture[shown] = colours[shown]
    depth[shown] = reach[shown]


def nearest_motion(moved: Float64[np.ndarray, "2 h w"]) -> RowMotion:
    """Returns the cubic t_x and r_z with the least mean square distance from how far pixels move, as far as they stay.

    To first order in the angles. The first row is the reference.
    """
    height, width = moved.shape[1:]
    last = np.array([[width - 1], [height - 1]])
    own, off = (each[:, ::_SPARSE, ::_SPARSE].reshape(2, -1) for each in (np.indices((height, width))[::-1], moved))
    stays = ((own + off >= 0) & (own + off <= last)).all(0)
    (right, down), (off_right, off_down), read = (own - last / 2)[:, stays], off[:, stays], (own + off)[1, stays]
    powers = (read[:, None] / height) ** np.arange(1, 4)
    across = np.concatenate([powers, -down[:, None] * powers], 1)
    along = np.concatenate([np.zeros_like(powers), right[:, None] * powers], 1)
    found = np.linalg.lstsq(np.concatenate([across, along]), np.concatenate([off_right, off_down]), rcond=None)[0]
    tx, rz = found.reshape(2, 3) @ ((np.arange(height) / height) ** np.arange(1, 4)[:, None])
    return RowMotion(width, tx, rz)
