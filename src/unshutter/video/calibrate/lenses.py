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

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError, UsageError, shortened
from unshutter.frames.camera import ROWS, padded_ends, rotation_jacobian
from unshutter.frames.self_calibration import fewer
from unshutter.frames.tracks import Tracks
from unshutter.motion.lens import Lens
from unshutter.motion.robust import student_log_likelihoods, student_weights
from unshutter.motion.shapes import Float64
from unshutter.options import USUAL_FOCAL
from unshutter.progress import in_columns
from unshutter.reasons import JsonObject
from unshutter.storage.files import read_text
from unshutter.video.calibrate import cameras
from unshutter.video.calibrate.sampled_frames import SampledFrames, TrackedFrame
from unshutter.video.file.clip import ClipRequest


def lens_of_clip(request: ClipRequest, sampled: SampledFrames) -> Lens | None:
    """Returns the lens of a clip's camera if it bends lines, or None if it does not or nothing tells."""
    shutter = request.options.shutter
    if shutter.lens is not None:
        return lens_of_file(Path(shutter.lens), request)
    if shutter.focal_px is not None:
        return None
    return lens_in_frames(sampled) or _listed(request)


# ---- a lens file -----------------------------------------------------------------------------------------------

_MATRIX = "camera_matrix", "cameraMatrix", "K"
_COEFFICIENTS = "distortion_coeffs", "distortion_coefficients", "dist_coeffs", "distCoeffs", "D"
_SIDES = (("image_width", "width", "w"), ("image_height", "height", "h"))
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LIST = r"[^\[]{0,200}(\[[\[\]\s\d.,eE+-]*)"  # of numbers, also nested; other facts of the matrix may come first
_FISHEYE = ("fisheye", "equidistant")
_RADIAL = ("standard", "plumb", "rational", "radial", "pinhole")


def lens_of_file(path: Path, request: ClipRequest) -> Lens:
    """Reads a calibration: OpenCV's YAML or JSON, ROS's YAML, or Gyroflow's JSON.

    Four coefficients are those of a fisheye unless the file names another model; five or more are k1, k2, p1, p2, k3,
    of which p1 and p2 are ignored.

    Raises:
        UnshutterError: the file cannot be read, or is of frames of another shape.
    """
    try:
        text = read_text(path, 1 << 20)
    except OSError as error:
        raise UnshutterError(f"cannot read lens file {path}: {error.strerror}") from None
    except ValueError:
        text = ""
    lists = (re.findall(_NUMBER, _value(text, names, _LIST)) for names in (_MATRIX, _COEFFICIENTS))
    matrix, k = (np.array(numbers, np.float64) for numbers in lists)
    width, height = (float(_value(text, names, rf"\s*({_NUMBER})") or 0) for names in _SIDES)
    if matrix.size != 9 or k.size < 2 or not width > 0 or not height > 0 or not np.isfinite([*matrix, *k]).all():
        raise UnshutterError(
            f"{path}: not a lens file: it needs a camera matrix, distortion coefficients and the picture's size"
        )
    model = _value(text, ("distortion_model", "model"), r'\s*"?([\w-]+)').lower()
    fisheye = any(word in model for word in _FISHEYE) or (k.size == 4 and not any(word in model for word in _RADIAL))
    (rows, columns), (fx, fy), middle = request.clip.picture_size, matrix[[0, 4]], matrix[[2, 5]]
    if abs(width * rows / (height * columns) - 1) > 0.01:
        raise UsageError(
            f"the lens file is of pictures of {width:.0f}x{height:.0f} px, the clip has frames of {columns}x"
            f"{rows} px: they must have the same shape"
        )
    if not fx > 0 or abs(fy / fx - 1) > 0.03:  # pixels whose sides differ by more are those of an anamorphic lens
        raise UnshutterError(f"{path}: lenses that stretch the picture in one direction are not supported")
    scale = columns / width
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
    """Returns the lens of a clip by its focal length and the position of its axis in what the camera saw [px]."""
    rows, columns = request.frame_size
    size = request.clip.picture_size
    col, row = request.scan_direction.points_to_frame(np.array(axis[0]), np.array(axis[1]), *size)
    shift = (float(col) - (columns - 1) / 2) / focal_px, (float(row) - (rows - 1) / 2) / focal_px
    if fisheye:
        return Lens(focal_px / rows, (*k, 0.0, 0.0, 0.0, 0.0)[:4], shift, source)
    reach = float(np.hypot(rows, columns)) / 2 / focal_px
    lens = Lens.of_radial(focal_px / rows, (*k[:2], *k[4:5]), shift, 1.2 * reach)
    return replace(lens, source=source)


def _value(text: str, names: Sequence[str], form: str) -> str:
    """Returns what follows the first of these keys that the file has, if it has this form; empty if it has none."""
    found = (re.search(rf"(?<!\w){name}\"?\s*:{form}", text) for name in names)
    return next((each[1] for each in found if each), "")


# ---- the frames ------------------------------------------------------------------------------------------------

# frames of a part; the first is examined roughly, the next if lines may be bent, all if that is too vague
PART = 13
FIRST, FURTHER = 2 * PART, 4  # frames of the first two parts, and number of parts after these


@dataclass(frozen=True)
class LensParams:
    """How a lens is found in frames, and when it is used (docs/research/lenses.md; lab/benchmarks/clip_lenses.py)."""

    min_pairs: int = 10  # pairs of frames
    min_tracks: int = 40  # of a pair
    rough_tracks: int = 60  # tracks of a pair that are looked at first
    least_moved_px: float = 0.5  # px of ROWS rows: a pair that moves by less tells nothing
    bends: tuple[float, ...] = (0.8, 0.4, 0.1, -0.2)  # tried first
    widest: float = 1.1  # how far a lens is described, in distances of the corner
    spread: float = 1.0  # prior: standard deviation of the focal length's logarithm
    rough: tuple[float, int] = (0.1, 3)  # roughly: first step of both unknowns, and rounds of Newton's method
    exact: tuple[float, int] = (0.05, 8)  # the same, exactly
    rough_weighings: int = 2  # rounds of the tracks' weights, roughly
    weighings: int = 4  # and exactly
    finest: float = 0.03  # step at which Newton's method may end
    common: float = 20.0  # divisor of the evidence: errors of tracks are correlated
    sure: float = 8.0  # by so much must a bent lens explain the tracks better than one that keeps lines straight
    hopeless: float = 0.25  # share of that, at the rough look
    # largest standard deviation of the corner's distance from the middle, as a share of it: to end the search
    sure_corner: float = 0.01
    sure_enough: float = 0.02  # and at its end


_PARAMS = LensParams()

_FOCALS = tuple(USUAL_FOCAL * 2.0 ** (k / 2) for k in range(-5, 4))  # tried first, as shares of width + height
_FOCAL_ONLY = np.array([[0.0, 1.0]])  # a lens that keeps lines straight has no other unknown


def lens_in_frames(sampled: SampledFrames) -> Lens | None:
    """Finds the lens in tracked frames of a clip; None if it keeps lines straight, or if the frames do not tell."""
    if not sampled.parts:
        return None
    first = _shown(sampled.parts[0][:FIRST])
    further = sampled.runs(FURTHER, PART, skipped=FIRST)
    return _lens_in(first[:PART], first[PART:], (tracks for run in further for tracks in _shown(run)))


def _shown(frames: Sequence[TrackedFrame]) -> list[Tracks]:
    """Returns the background's tracks between consecutive frames: what moves by itself turns with no lens."""
    planes = (frame.background for frame in frames[1:] if frame.since is not None)
    return [plane.tracks for plane in planes if plane is not None and plane.joined]


def may_bend_lines(sampled: SampledFrames) -> bool:
    """Whether the lens may bend lines, as far as the clip's first frames show."""
    pairs = _moving(_shown(sampled.parts[0][: PART + 1])) if sampled.parts else []
    return len(pairs) < _PARAMS.min_pairs or _may_bend(pairs)


def _may_bend(pairs: Sequence[Tracks]) -> bool:
    return _roughly(pairs)[0] >= _PARAMS.hopeless * _PARAMS.sure / 2


def _lens_in(first: Iterable[Tracks], *others: Iterable[Tracks]) -> Lens | None:
    """Finds the lens in tracks of some frames, or of more if it is too vague in those."""
    pairs = _moving(first)
    if len(pairs) >= _PARAMS.min_pairs and not _may_bend(pairs):
        return None
    for part in others:
        pairs += _moving(part)
        lens = lens_of_tracks(pairs)
        if lens is None or lens.error < _PARAMS.sure_corner:
            return lens
    return lens if lens.error < _PARAMS.sure_enough else None


def _moving(pairs: Iterable[Tracks]) -> list[Tracks]:
    """Returns the pairs of frames that may show the lens."""
    shifts = ((pair, np.hypot(*(pair.end - pair.start).T)) for pair in pairs if len(pair) >= _PARAMS.min_tracks)
    return [pair for pair, shift in shifts if np.median(shift) * ROWS / pair.height > _PARAMS.least_moved_px]


def _roughly(pairs: Sequence[Tracks]) -> tuple[float, np.ndarray, np.ndarray]:
    """Fits both kinds of lens to a few of the tracks; returns their difference in log-likelihood, and either lens."""
    few = [fewer(pair, _PARAMS.rough_tracks) for pair in pairs]
    turning = _RotatingCamera.of(few, _PARAMS.rough_weighings)
    focals = turning.usual + np.log(_FOCALS) - np.log(USUAL_FOCAL)
    straight, _ = turning.highest([np.array([1.0, focal]) for focal in focals], _FOCAL_ONLY, *_PARAMS.rough)
    starts = [np.array([bend, focal]) for bend in _PARAMS.bends for focal in focals]
    bent, _ = turning.highest(starts, np.eye(2), *_PARAMS.rough)
    if bent[1] > np.log(turning.corner * ROWS / np.tan(np.radians(20))):  # narrow lenses bend no lines
        return -np.inf, straight, bent
    share = sum(map(len, few)) / sum(map(len, pairs))
    return (turning.height(bent) - turning.height(straight)) / share, straight, bent


def lens_of_tracks(pairs: Sequence[Tracks]) -> Lens | None:
    """Finds the lens through which tracks between frames were seen; None if it keeps lines straight, or if they
    do not tell.
    """
    pairs = _moving(pairs)
    if len(pairs) < _PARAMS.min_pairs:
        return None
    advantage, straight, bent = _roughly(pairs)
    if advantage < _PARAMS.hopeless * _PARAMS.sure:
        return None
    turning = _RotatingCamera.of(pairs, _PARAMS.weighings)
    straight, _ = turning.highest([straight], _FOCAL_ONLY, *_PARAMS.exact)
    best, covariance = turning.highest([bent], np.eye(2), *_PARAMS.exact)
    if turning.height(best) - turning.height(straight) < _PARAMS.sure:
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


@dataclass(eq=False)
class _RotatingCamera:
    """Tracks between frames, explained by turns of the camera through any lens.

    A lens is given by its bend and the logarithm of its focal length [px of ROWS rows].
    """

    used: np.ndarray  # [pairs, most] which entries of the padded arrays hold a track
    middles: np.ndarray  # [pairs, most, 2] of the tracks [px of ROWS rows]
    moved: np.ndarray  # [pairs, 2 most] their displacements [px of ROWS rows]
    width: float  # of the frames [px of ROWS rows]
    usual: float  # the logarithm of the focal length to expect
    weighings: int  # rounds of the tracks' weights
    _heights: dict[tuple[float, ...], float] = field(default_factory=dict)

    @classmethod
    def of(cls, pairs: Sequence[Tracks], weighings: int) -> _RotatingCamera:
        ends, used = padded_ends(pairs)
        ends = ends * ROWS / pairs[0].height
        width = pairs[0].width * ROWS / pairs[0].height
        moved = (ends[1] - ends[0]).reshape(len(pairs), -1)
        usual = float(np.log(USUAL_FOCAL * (width + ROWS)))
        return cls(used, ends.mean(axis=0), moved, width, usual, weighings)

    @property
    def corner(self) -> float:
        """Distance of a corner from the middle [heights]."""
        return float(np.hypot(self.width / ROWS, 1)) / 2

    def lens(self, at: Float64[np.ndarray, "2"]) -> Lens:
        """Returns a lens."""
        bend = float(at[0])
        focal = float(np.exp(at[1])) / ROWS
        root = max(abs(bend), 1e-9) ** 0.5
        reach = _PARAMS.widest * root * self.corner / focal
        angles = np.linspace(0.02, 1, 40) * (np.arctan(reach) if bend > 0 else np.arctanh(min(reach, 0.97))) / root
        seen = (np.tan if bend > 0 else np.tanh)(root * angles) / root
        k1, k2, k3, k4 = np.linalg.lstsq(angles[:, None] ** [2, 4, 6, 8], seen / angles - 1, rcond=None)[0].tolist()
        return Lens(focal, (k1, k2, k3, k4))

    def highest(
        self, starts: Sequence[np.ndarray], along: Float64[np.ndarray, "n 2"], step: float, rounds: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Finds the most probable lens by Newton's method with numerical derivatives, from the best of several starts.

        Args:
            along: directions in which to climb.

        Returns:
            The lens, and the covariance of its coordinates along these directions.
        """
        at = max(starts, key=self.height)
        inverse = np.eye(len(along))
        for _ in range(rounds):
            moves = step * along
            here = self.height(at)
            up, down = (np.array([self.height(at + sign * move) for move in moves]) for sign in (1, -1))
            bend = np.diag(up + down - 2 * here)
            if len(along) == 2:
                both = sum(self.height(at + sign * moves.sum(axis=0)) for sign in (1, -1)) - 2 * here
                bend[0, 1] = bend[1, 0] = (both - np.trace(bend)) / 2
            values, vectors = np.linalg.eigh(bend)
            inverse = (vectors / np.maximum(np.abs(values), 1e-2)) @ vectors.T
            jump = inverse @ (up - down) / 2
            jump = jump * min(1.0, 2 / np.abs(jump).max())
            tried = [at + share * jump @ moves for share in (1, 0.3, 0.1)]
            tried += [at + sign * move for sign in (1, -1) for move in moves]
            better = max(tried, key=self.height)
            if self.height(better) < here + 0.02:
                if step < _PARAMS.finest:
                    break
                step = step / 3
            else:
                at = better
                step = step / 2 if np.abs(jump).max() < 1 else step
        return at, inverse * step**2

    def height(self, at: Float64[np.ndarray, "2"]) -> float:
        """Returns the log probability of a lens given the tracks, up to a constant."""
        if (key := tuple(at.tolist())) not in self._heights:
            self._heights[key] = self._evidence(at) - 0.5 * float((at[1] - self.usual) / _PARAMS.spread) ** 2
        return self._heights[key]

    def _evidence(self, at: Float64[np.ndarray, "2"]) -> float:
        """Returns the log probability of the tracks, up to a constant, with the most probable turns of each pair."""
        try:
            lens = None if at[0] == 1 else self.lens(at)
        except UnshutterError:
            return -np.inf
        shown = rotation_jacobian(self.middles, self.width, float(np.exp(at[1])), lens)
        row = (2 * self.middles[..., 1] / ROWS - 1)[..., None, None]
        design = np.concatenate([shown, shown[..., :3] * row, shown[..., :3] * row**2], axis=-1)
        design = design.reshape(*self.moved.shape, -1)
        weights = self.used.astype(np.float64)
        noise = np.nan
        squared = np.zeros(0)
        for _ in range(self.weighings):
            weighted = (design * np.repeat(weights, 2, axis=1)[..., None]).swapaxes(1, 2)
            normal = weighted @ design + 1e-4 * np.eye(design.shape[-1])
            left = self.moved - (design @ np.linalg.solve(normal, weighted @ self.moved[..., None]))[..., 0]
            squared = (left.reshape(*self.used.shape, 2) ** 2).sum(axis=-1)
            weights, noise = student_weights(squared, self.used, noise)
        each = student_log_likelihoods(squared[self.used], noise)
        return float(each.sum()) / _PARAMS.common


# ---- the table of lens profiles --------------------------------------------------------------------------------

_NEAR = 0.06  # share by which a lens may differ from the stated field of view
_AGREE = 0.03  # share by which the angles of lenses that are alike may differ at the corner


@dataclass(frozen=True)
class LensProfile(cameras.Profile):
    """A lens of a camera in one of its modes."""

    focal: float  # focal length [widths]
    axis: tuple[float, float]  # position of the axis [widths, heights]
    k: tuple[float, ...]  # OpenCV's fisheye k1 to k4
    profiles: int  # number of profiles that agree

    @property
    def degrees(self) -> float:
        """Field of view from corner to corner [degrees]."""
        corner = float(np.hypot(self.width, self.height)) / 2 / self.width / self.focal
        return 2 * float(np.degrees(Lens(1.0, self.k).angle(corner)))

    def as_json(self) -> JsonObject:
        """Returns the columns of the table by name, and the field of view from corner to corner [degrees]."""
        return super().as_json() | {"degrees": round(self.degrees, 1)}


@cache
def table() -> tuple[LensProfile, ...]:
    """Returns all known lenses, sorted by brand, model, lens and mode."""
    return tuple(
        LensProfile(
            *cameras.begin_of(line),
            focal=float(line["focal"]),
            axis=(float(line["axis_x"]), float(line["axis_y"])),
            k=tuple(float(line[name]) for name in ("k1", "k2", "k3", "k4")),
            profiles=int(line["profiles"]),
        )
        for line in cameras.lines_of("lenses.csv")
    )


def _listed(request: ClipRequest) -> Lens | None:
    """Returns the lens of the clip's camera if all profiles of its frame size agree on it, and at least two unless the
    user named the camera; otherwise None. A GoPro's field of view, if its file states it (ZFOV), narrows the choice.
    """
    clip = request.clip
    height, width = clip.picture_size
    named = request.options.shutter.camera
    if named is None:
        known = cameras.tagged(table(), *cameras.camera_of(clip.tags))
    else:
        known = cameras.closest(named_lenses(named), named)
    alike = [each for each in known if {each.width, each.height} == {width, height}]
    view = clip.camera.view_degrees
    if alike and view is not None and 0 < view < 200.0:
        alike = [each for each in alike if abs(each.degrees / view - 1) < _NEAR]
    degrees = [each.degrees for each in alike]
    if not alike or max(degrees) > (1 + _AGREE) * min(degrees):
        return None
    if named is None and sum(each.profiles for each in alike) < 2:
        return None
    best = max(alike, key=lambda each: each.profiles)
    if best.width != width:  # profiles are of frames as recorded, this one was turned
        return None
    axis = best.axis[0] * width - 0.5, best.axis[1] * height - 0.5
    return _of_camera(request, best.focal * width, axis, best.k, f"table of lenses ({best.name})")


def named_lenses(name: str) -> list[LensProfile]:
    """Returns the lenses of cameras whose name contains a word, in any case and spelling."""
    return cameras.named(table(), name)


def listed(word: str) -> list[LensProfile]:
    """Returns the lenses of cameras whose name contains a word; all if the word is empty."""
    lenses = named_lenses(word)
    if not lenses:
        raise UsageError(f"the table has no lens of a camera called '{shortened(word)}'")
    return lenses


def describe_lenses(lenses: Sequence[LensProfile]) -> str:
    """Formats lenses, one per line."""
    rows = [(each.name, f"{each.width}x{each.height} px", f"{each.degrees:.0f} degrees") for each in lenses]
    return in_columns(rows, right=2)
