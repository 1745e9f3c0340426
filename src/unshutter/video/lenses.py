"""Finds the lens of a clip: in a file of the user's, in its frames, or in the table of lens profiles.

In the frames, a turn of the camera moves the picture's border by another distance than its middle, and this difference
tells how the lens bends lines. Between two frames, each track is explained by turns about three axes, which change with
the row (at most quadratically: this takes the place of the readout time, which is not known yet), and a change of
scale. What is common to all pairs of frames is the focal length and one number m, the bend of the lens:

    r = tan(sqrt(m) theta) / sqrt(m)

keeps lines straight if m = 1, is stereographic if m = 1/4, equidistant if m = 0; for m < 0 it is continued by tanh.
Errors of tracks follow Student's t.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.camera import DEGREES, ROWS, padded_ends, student_weights, turn_jacobian
from unshutter.frames.tracks import TRACKED_SIDE, Tracks
from unshutter.motion.lens import Lens
from unshutter.storage.files import read_text
from unshutter.video import cameras
from unshutter.video.clip import ClipRequest, followed

if TYPE_CHECKING:
    from unshutter.motion.shapes import Float64


def lens_of_clip(request: ClipRequest) -> Lens | None:
    """Returns the lens of a clip's camera if it bends lines, or None if it does not or nothing tells."""
    shutter = request.options.shutter
    if shutter.lens is not None:
        return lens_of_file(Path(shutter.lens), request)
    if shutter.focal_px is not None:
        return None
    return lens_in_frames(request) or _listed(request)


# ---- a lens file -----------------------------------------------------------------------------------------------

_LARGEST = 1 << 20  # bytes
_MATRIX = "camera_matrix", "cameraMatrix", "K"
_COEFFICIENTS = "distortion_coeffs", "distortion_coefficients", "dist_coeffs", "distCoeffs", "D"
_SIDES = (("image_width", "width", "w"), ("image_height", "height", "h"))
_FISHEYE, _RADIAL = ("fisheye", "equidistant"), ("standard", "plumb", "rational", "radial", "pinhole")
_SQUARE = 0.03  # pixels whose sides differ by more are those of an anamorphic lens
_ALIKE = 0.01  # difference of aspect ratios


def lens_of_file(path: Path, request: ClipRequest) -> Lens:
    """Reads a calibration: OpenCV's YAML or JSON, ROS's YAML, or Gyroflow's JSON.

    Four coefficients are those of a fisheye unless the file names another model; five or more are k1, k2, p1, p2, k3,
    of which p1 and p2 are ignored.

    Raises:
        UnshutterError: the file cannot be read, or is of frames of another shape.
    """
    try:
        text = read_text(path, _LARGEST)
        data = _json(text) if text.lstrip().startswith("{") else None
        matrix, k = (np.array(_numbers(data, text, names), np.float64) for names in (_MATRIX, _COEFFICIENTS))
        width, height = (float(_word(data, text, names) or 0) for names in _SIDES)
    except OSError as error:
        raise UnshutterError(f"cannot read lens file {path}: {error.strerror}") from None
    except (ValueError, TypeError, RecursionError):
        matrix = k = np.zeros(0)
        width = height = 0.0
    if matrix.size != 9 or k.size < 2 or not width > 0 or not height > 0 or not np.isfinite([*matrix, *k]).all():
        raise UnshutterError(
            f"{path}: not a lens file: it needs a camera matrix, distortion coefficients and the picture's size"
        )
    model = (_word(data, text, ("distortion_model", "model")) or "").lower()
    fisheye = any(word in model for word in _FISHEYE) or (k.size == 4 and not any(word in model for word in _RADIAL))
    clip, (fx, fy), middle = request.clip, matrix[[0, 4]], matrix[[2, 5]]
    if abs(width * clip.height / (height * clip.width) - 1) > _ALIKE:
        raise UsageError(
            f"the lens file is of pictures of {width:.0f}x{height:.0f} px, the clip has frames of {clip.width}x"
            f"{clip.height} px: they must have the same shape"
        )
    if not fx > 0 or abs(fy / fx - 1) > _SQUARE:
        raise UnshutterError(f"{path}: lenses that stretch the picture in one direction are not supported")
    scale = clip.width / width
    axis = (float(each) for each in (middle + 0.5) * scale - 0.5)
    try:
        return _of_camera(request, float(fx) * scale, (*axis,), tuple(map(float, k)), "lens file", fisheye)
    except UnshutterError as error:
        raise UnshutterError(f"{path}: {error}") from None


def _of_camera(
    request: ClipRequest,
    focal_px: float,
    axis: Sequence[float],
    k: tuple[float, ...],
    source: str,
    fisheye: bool = True,
) -> Lens:
    """Returns the lens of a clip by its focal length and the position of its axis in stored frames [px]."""
    clip, (rows, columns) = request.clip, request.frame_size
    col, row = request.readout.points_to_frame(np.array(axis[0]), np.array(axis[1]), clip.height, clip.width)
    shift = (float(col) - (columns - 1) / 2) / focal_px, (float(row) - (rows - 1) / 2) / focal_px
    if fisheye:
        return Lens(focal_px / rows, (*k, 0.0, 0.0, 0.0, 0.0)[:4], shift, source)
    reach = float(np.hypot(rows, columns)) / 2 / focal_px
    lens = Lens.of_radial(focal_px / rows, (*k[:2], *k[4:5]), shift, 1.2 * reach)
    return replace(lens, source=source)


def _json(text: str) -> dict[str, Any]:
    """Returns the keys and values of a JSON file, those of nested objects included."""
    found: dict[str, Any] = {}

    def collect(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found.update({key: value for key, value in pairs if key not in found})
        return dict(pairs)

    json.loads(text, object_pairs_hook=collect)
    return found


def _numbers(data: dict[str, Any] | None, text: str, names: Sequence[str]) -> list[float]:
    for name in names:
        if data is None:
            value = re.search(rf"^\s*{name}\s*:[^\[]*\[([^\]]*)\]", text, re.MULTILINE)
            if value is not None:
                return [float(each) for each in value[1].split(",")]
        elif name in data:
            value = data[name]
            return list(np.ravel(value["data"] if isinstance(value, dict) else value))
    return []


def _word(data: dict[str, Any] | None, text: str, names: Sequence[str]) -> str | None:
    for name in names:
        if data is None:
            value = re.search(rf"^\s*{name}\s*:\s*\"?([\w.-]+)", text, re.MULTILINE)
            if value is not None:
                return value[1]
        elif data.get(name) is not None:
            return str(data[name])
    return None


# ---- the frames ------------------------------------------------------------------------------------------------

_PART, _FEW_PARTS, _PARTS = 13, 2, 6  # frames of a part; parts examined, and if they show a bent lens too vaguely
_FEWEST = 10  # pairs of frames
_LEAST_TRACKS = 40  # of a pair
_LEAST_MOVED_PX = 0.5  # px of ROWS rows: a pair that moves by less tells nothing
_BENDS, _WIDEST = (0.8, 0.4, 0.1, -0.2), 1.1  # tried first; how far a lens is described, in distances of the corner
_FOCALS = tuple(0.85 * 2.0 ** (k / 2) for k in range(-5, 4))  # tried first, as shares of width + height
_USUAL, _SPREAD = 0.85, 1.0  # prior: share of width + height, and standard deviation of its logarithm
_STEPS, _ROUNDS, _WEIGHINGS = 0.1, 8, 4  # of both unknowns at first; of Newton's method; of the tracks' weights
_COMMON = 20.0  # divisor of the evidence: errors of tracks are correlated
_SURE = 8.0  # by so much must a bent lens explain the tracks better than one that keeps lines straight
_SURE_CORNER = 0.02  # largest standard deviation of the corner's distance from the middle, as a share of it


def lens_in_frames(request: ClipRequest) -> Lens | None:
    """Finds the lens in parts of a clip; None if it keeps lines straight, or if the frames do not tell."""
    (begin, end), length_s = request.span, _PART * request.clip.interval_s
    count = min(_PARTS, max(1, int((end - begin) / length_s)))
    starts = np.linspace(begin, max(end - 1.01 * length_s, begin), count)
    chosen = np.unique(np.linspace(0, count - 1, 2 * _FEW_PARTS + 1).astype(int)[1::2])
    pairs: list[Tracks] = []
    for part in (starts[chosen], np.delete(starts, chosen)):
        for start in part:
            for _, since, tracks, straight in followed(request, float(start), float(start) + length_s, TRACKED_SIDE):
                if since is not None and tracks is not None and straight is not None and not straight.cut:
                    pairs.append(tracks)
        lens = lens_of_tracks(pairs)
        if lens is None or lens.error < _SURE_CORNER:
            return lens
    return None


def lens_of_tracks(pairs: Sequence[Tracks]) -> Lens | None:
    """Finds the lens through which tracks between frames were seen; None if it keeps lines straight, or if they
    do not tell.
    """
    pairs = [pair for pair in pairs if len(pair) >= _LEAST_TRACKS]
    unit = ROWS / pairs[0].height if pairs else 1.0
    pairs = [pair for pair in pairs if np.median(np.hypot(*(pair.end - pair.start).T)) * unit > _LEAST_MOVED_PX]
    if len(pairs) < _FEWEST:
        return None
    turning = _Turning.of(pairs)
    usual = np.log(_USUAL * (turning.width + ROWS))
    prior: Callable[[np.ndarray], float] = lambda at: -0.5 * float((at[1] - usual) / _SPREAD) ** 2  # noqa: E731
    focals = np.log(np.array(_FOCALS) * (turning.width + ROWS))

    def height(at: np.ndarray) -> float:
        return turning.evidence(at) + prior(at)

    straight = max((np.array([1.0, focal]) for focal in focals), key=height)
    best = max((np.array([bend, focal]) for bend in _BENDS for focal in focals), key=height)
    straight, _ = _highest(height, straight, np.array([[0.0, 1.0]]))
    best, covariance = _highest(height, best, np.eye(2))
    if height(best) - height(straight) < _SURE:
        return None
    lens = turning.lens(best)
    corner = turning.corner / lens.focal
    angle = lens.angle(corner)
    small = 1e-3 * np.eye(2)
    ends = [
        [(each := turning.lens(best + sign * step)).distance(angle) * each.focal for sign in (1, -1)] for step in small
    ]
    slopes = np.array([np.log(more / less) / 2e-3 for more, less in ends])
    error = float(np.sqrt(slopes @ covariance @ slopes))
    return replace(lens, source="frames", error=error)


def _highest(height: Callable[[np.ndarray], float], at: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Climbs to the maximum of a function by Newton's method with numerical derivatives.

    Args:
        along: [n, unknowns] directions in which to climb.

    Returns:
        The position, and the covariance of the coordinates along these directions if the function is a log probability.
    """
    step, inverse = _STEPS, np.eye(len(along))
    for _ in range(_ROUNDS):
        moves = step * along
        here = height(at)
        up, down = (np.array([height(at + sign * move) for move in moves]) for sign in (1, -1))
        bend = np.diag(up + down - 2 * here)
        if len(along) == 2:
            both = height(at + moves.sum(axis=0)) + height(at - moves.sum(axis=0)) - 2 * here
            bend[0, 1] = bend[1, 0] = (both - np.trace(bend)) / 2
        values, vectors = np.linalg.eigh(bend)
        inverse = (vectors / np.maximum(np.abs(values), 1e-2)) @ vectors.T
        jump = inverse @ (up - down) / 2
        jump = jump * min(1.0, 2 / np.abs(jump).max())
        tried = [at + share * jump @ moves for share in (1, 0.3, 0.1)]
        tried += [at + sign * move for sign in (1, -1) for move in moves]
        better = max(tried, key=height)
        if height(better) < here + 0.02:
            if step < 0.3 * _STEPS:
                break
            step = step / 3
        else:
            at, step = better, step / 2 if np.abs(jump).max() < 1 else step
    return at, inverse * step**2


@dataclass(eq=False)
class _Turning:
    """Tracks between frames, explained by turns of the camera through any lens."""

    used: np.ndarray  # [pairs, most] which entries of the padded arrays hold a track
    middles: np.ndarray  # [pairs, most, 2] of the tracks [px of ROWS rows]
    moved: np.ndarray  # [pairs, 2 most] their displacements [px of ROWS rows]
    width: float  # of the frames [px of ROWS rows]

    @classmethod
    def of(cls, pairs: Sequence[Tracks]) -> _Turning:
        ends, used = padded_ends(pairs)
        ends = ends * ROWS / pairs[0].height
        moved = (ends[1] - ends[0]).reshape(len(pairs), -1)
        return cls(used, ends.mean(axis=0), moved, pairs[0].width * ROWS / pairs[0].height)

    @property
    def corner(self) -> float:
        """Distance of a corner from the middle [heights]."""
        return float(np.hypot(self.width / ROWS, 1)) / 2

    def lens(self, at: Float64[np.ndarray, "2"]) -> Lens:
        """Returns the lens of a bend and the logarithm of a focal length [px of ROWS rows]."""
        bend, focal = float(at[0]), float(np.exp(at[1])) / ROWS
        root = max(abs(bend), 1e-9) ** 0.5
        reach = _WIDEST * root * self.corner / focal
        angles = np.linspace(0.02, 1, 40) * (np.arctan(reach) if bend > 0 else np.arctanh(min(reach, 0.97))) / root
        seen = (np.tan if bend > 0 else np.tanh)(root * angles) / root
        k1, k2, k3, k4 = np.linalg.lstsq(angles[:, None] ** [2, 4, 6, 8], seen / angles - 1, rcond=None)[0].tolist()
        return Lens(focal, (k1, k2, k3, k4))

    def evidence(self, at: Float64[np.ndarray, "2"]) -> float:
        """Returns the log probability of the tracks, up to a constant, with the most probable turns of each pair."""
        try:
            lens = None if at[0] == 1 else self.lens(at)
        except UnshutterError:
            return -np.inf
        shown = turn_jacobian(self.middles, self.width, float(np.exp(at[1])), lens)
        row = (2 * self.middles[..., 1] / ROWS - 1)[..., None, None]
        design = np.concatenate([shown, shown[..., :3] * row, shown[..., :3] * row**2], axis=-1)
        design = design.reshape(*self.moved.shape, -1)
        weights, noise, squared = self.used.astype(np.float64), np.nan, np.zeros(0)
        for _ in range(_WEIGHINGS):
            weighted = (design * np.repeat(weights, 2, axis=1)[..., None]).swapaxes(1, 2)
            normal = weighted @ design + 1e-4 * np.eye(design.shape[-1])
            left = self.moved - (design @ np.linalg.solve(normal, weighted @ self.moved[..., None]))[..., 0]
            squared = (left.reshape(*self.used.shape, 2) ** 2).sum(axis=-1)
            weights, noise = student_weights(squared, self.used, noise)
        each = -2 * np.log(noise) - (DEGREES + 2) / 2 * np.log1p(squared[self.used] / (DEGREES * noise**2))
        return float(each.sum()) / _COMMON


# ---- the table of lens profiles --------------------------------------------------------------------------------

_AGREE = 0.03  # share by which the angles of lenses that are alike may differ at the corner


@dataclass(frozen=True)
class LensProfile:
    """A lens of a camera in one of its modes: one line of the table."""

    brand: str
    model: str
    lens: str  # one of its lenses or fields of view; empty if the profiles do not name it
    width: int  # of the frames [px]
    height: int
    focal: float  # focal length [widths]
    axis: tuple[float, float]  # position of the axis [widths, heights]
    k: tuple[float, ...]  # OpenCV's fisheye k1 to k4
    profiles: int  # number of profiles that agree

    @property
    def name(self) -> str:
        """Name of the camera, with its lens."""
        return " ".join(dict.fromkeys(filter(None, (self.brand, self.model, self.lens))))

    @property
    def degrees(self) -> float:
        """Field of view from corner to corner [degrees]."""
        corner = float(np.hypot(self.width, self.height)) / 2 / self.width / self.focal
        return 2 * float(np.degrees(Lens(1.0, self.k).angle(corner)))


@cache
def table() -> tuple[LensProfile, ...]:
    """Returns all known lenses, sorted by brand, model, lens and mode."""
    text = (files("unshutter") / "video" / "lenses.csv").read_text(encoding="utf-8")
    lines = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    return tuple(
        LensProfile(
            line["brand"],
            line["model"],
            line["lens"],
            int(line["width"]),
            int(line["height"]),
            float(line["focal"]),
            (float(line["axis_x"]), float(line["axis_y"])),
            tuple(float(line[name]) for name in ("k1", "k2", "k3", "k4")),
            int(line["profiles"]),
        )
        for line in lines
    )


def _listed(request: ClipRequest) -> Lens | None:
    """Returns the lens of the clip's camera if all profiles of its frame size agree on it, and at least two unless the
    user named the camera; otherwise None.
    """
    clip, named = request.clip, request.options.shutter.camera
    make, model = cameras.camera_of(clip.tags)
    known = (
        [each for each in table() if cameras.is_of((each.brand, each.model), make, model)]
        if named is None
        else named_lenses(named)
    )
    alike = [each for each in known if {each.width, each.height} == {clip.width, clip.height}]
    degrees = [each.degrees for each in alike]
    if not alike or max(degrees) > (1 + _AGREE) * min(degrees):
        return None
    if named is None and sum(each.profiles for each in alike) < 2:
        return None
    best = max(alike, key=lambda each: each.profiles)
    if best.width != clip.width:  # profiles are of frames as recorded, this one was turned
        return None
    axis = best.axis[0] * clip.width - 0.5, best.axis[1] * clip.height - 0.5
    return _of_camera(request, best.focal * clip.width, axis, best.k, f"table of lenses ({best.name})")


def named_lenses(name: str) -> list[LensProfile]:
    """Returns the lenses of cameras whose name contains a word, in any case and spelling."""
    return [each for each in table() if cameras.is_named(each.name, name)]


def as_text(lenses: Sequence[LensProfile]) -> str:
    """Formats lenses, one per line."""
    rows = [(each.name, f"{each.width}x{each.height} px", f"{each.degrees:.0f} degrees") for each in lenses]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(f"{name:{widths[0]}}  {size:{widths[1]}}  {view:>{widths[2]}}" for name, size, view in rows)
