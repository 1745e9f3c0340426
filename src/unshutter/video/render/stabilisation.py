"""Stabilises a clip: the camera's smoothed path, and the zoom at which no frame shows its border.

Scenes are smoothed one by one. An unknown rotation is assumed to be even: shake remains there, but nothing jumps. All
frames are enlarged equally, as far as the frame with the largest correction needs. If that exceeds the limit, the
smoothing of its scene is restricted to stay within it (frames/smoothing.py).

The small rotations between frames are added up as vectors in the camera's axes. The resulting error, and the curvature
of the borders' motion, are taken into account by solving again around the last solution.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from unshutter.frames.frame_motion import Step
from unshutter.frames.smoothing import Smoothing, stiffness_for
from unshutter.motion import RotationMotion, RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.lens import Lens
from unshutter.motion.motion import row_index
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.motion.shapes import Float32, Float64
from unshutter.motion.verdict import undone_part
from unshutter.options.clip_options import ClipUndo, Steadiness
from unshutter.orientation import ScanDirection
from unshutter.reasons import JsonObject, Reason
from unshutter.video.calibrate.gain import TALL, is_visible
from unshutter.video.file.row_samples import ROWS, RowSamples
from unshutter.video.render.views import SteadyView, borders_of, margins, zoom_needed

_ROWS = 256  # rotations are weighted in px of a picture with this many rows
_ROUNDS = 3  # of linearisation
_SPARE = 5e-4  # heights kept free for errors of linearisation
_LEVEL = 50.0  # weight of a level horizon, relative to that of a rotation
_NEGLIGIBLE = 1.0005  # smaller zooms are treated as none
_GAPS = 0.1, 10.0  # limits of the frame intervals within a scene
_SHRINKS = 12  # bisection steps of the search for a rotation that fits


@dataclass(eq=False)
class CameraPath:
    """The motion of the frames of a clip, in order: about 1 kB per frame, or 2 kB with a gyro."""

    undo: ClipUndo  # how their motion is undone
    scan_direction: ScanDirection  # direction in which stored pixels were read
    aspect: float  # width of the readout frame divided by its height
    lens: Lens | None = None  # the camera's lens, if it bends straight lines
    times_s: list[float] = field(default_factory=list)  # presentation time of each frame [s]
    cuts: list[bool] = field(default_factory=list)  # whether a frame shows another scene than the previous one
    # rotation since the previous frame, at the reference row [rad]; NaN if unknown
    steps: list[Float64[np.ndarray, "3"]] = field(default_factory=list)
    focals: list[float] = field(default_factory=list)  # focal length of each frame [heights]; NaN if unknown
    # extent of each frame once its motion is undone (:func:`borders_of`)
    borders: list[Float32[np.ndarray, "4 9"]] = field(default_factory=list)
    # rotation since the previous frame, between middle rows; None if unknown
    middle_steps: list[Step | None] = field(default_factory=list)
    _motions: list[RowSamples | Reason | None] = field(default_factory=list)
    _at_reference: np.ndarray = field(default_factory=lambda: np.eye(3))  # of the last frame, from its middle row

    def __len__(self) -> int:
        return len(self.times_s)

    def add(self, found: Finding, step: Step | None, cut: bool, time_s: float) -> None:
        """Adds the next frame.

        Args:
            found: motion of a small picture, with the first row as the reference.
        """
        motion = found.motion
        focal = np.nan if step is None else step.focal_heights
        at_reference = np.eye(3)
        if isinstance(motion, RotationMotion):
            focal = motion.focal_px / motion.height
            rows = [row_index(reference, motion.height) for reference in ("middle", self.undo.reference)]
            middle, reference = rotation_matrix(motion.rotations[rows])
            at_reference = reference @ middle.T
        rotation = np.full(3, np.nan)
        if step is not None and not cut:
            rotation = rotation_vector(at_reference @ rotation_matrix(step.rotation) @ self._at_reference.T)
        self.times_s.append(time_s)
        self.cuts.append(cut)
        self.steps.append(rotation)
        self.focals.append(focal)
        self.borders.append(borders_of(undone_part(motion, self.undo), self.aspect))
        self.middle_steps.append(step)
        self._motions.append(RowSamples.of(motion) if isinstance(motion, RotationMotion) else found.reason)
        self._at_reference = at_reference

    def finding(self, frame: int) -> Finding:
        """Returns the motion of a frame, first row as the reference; zero, with a reason, if it has none."""
        kept = self._motions[frame]
        if isinstance(kept, RowSamples):
            return Finding(kept.motion(self.lens))
        return Finding(RowMotion.zero(ROWS, ROWS), reason=kept)


@dataclass(frozen=True, eq=False)
class Stabilisation:
    """The stabilised views of a clip's frames."""

    path: CameraPath
    # [frames, 3] rotation from the stabilised to the real camera, at the reference row [rad]
    rotations: Float64[np.ndarray, "frames 3"]
    focals: Float64[np.ndarray, "frames"]  # [frames] focal length [heights]
    zoom: float  # zoom of all frames
    limited: int  # number of frames in which the zoom limit weakened the smoothing
    unknown: int  # number of frames whose rotation since the previous frame is unknown
    level: bool  # whether horizons are level

    @property
    def is_idle(self) -> bool:
        """Whether the path was smooth already, so that it is left unchanged."""
        return self.zoom == 1.0 and not self.limited and not self.rotations.any()

    def view(self, frame: int) -> SteadyView | None:
        """Returns the stabilised view of a frame, or None if it is the camera's own."""
        if self.zoom == 1.0 and not self.rotations[frame].any():
            return None
        return SteadyView(
            self.rotations[frame], float(self.focals[frame]), self.zoom, self.path.scan_direction, self.path.lens
        )

    def as_json(self) -> JsonObject:
        """Returns the record for a log of runs."""
        return {
            "zoom": self.zoom,
            "cut_share": 1 - 1 / self.zoom,
            "frames_limited": self.limited,
            "frames_unknown": self.unknown,
            "level": self.level,
        }


def stabilised(
    path: CameraPath, steadiness: Steadiness, interval_s: float, up: Float64[np.ndarray, "frames 3"] | None = None
) -> Stabilisation:
    """Computes the stabilised views of a clip.

    Args:
        up: upward direction in the camera's axes; None if horizons need not be level.
    """
    scenes = list(_scenes(path, interval_s, up))
    stiffness = stiffness_for((steadiness.stabilize or 0.0) / interval_s)
    most = steadiness.largest_zoom
    free = [scene.smoothed(stiffness, None) for scene in scenes]
    if all(scene.unknown == 0 for scene in scenes) and not _visible(scenes, free):
        return Stabilisation(path, np.zeros((len(path), 3)), np.ones(len(path)), 1.0, 0, 0, up is not None)
    needed = [scene.needed(each) for scene, each in zip(scenes, free, strict=True)]
    limited = [zooms > most for zooms in needed]
    rotations = [
        scene.within(scene.smoothed(stiffness, most), most) if over.any() else smooth
        for scene, smooth, over in zip(scenes, free, limited, strict=True)
    ]
    zoom = max((float(scene.needed(each).max()) for scene, each in zip(scenes, rotations, strict=True)), default=1.0)
    zoom = 1.0 if zoom < _NEGLIGIBLE else min(zoom, most)
    return Stabilisation(
        path,
        np.concatenate(rotations) if rotations else np.zeros((0, 3)),
        np.concatenate([np.full(len(scene.times), scene.focal) for scene in scenes]) if scenes else np.zeros(0),
        zoom,
        int(sum(over.sum() for over in limited)),
        sum(scene.unknown for scene in scenes),
        up is not None,
    )


def _visible(scenes: list[_Scene], rotations: list[Float64[np.ndarray, "frames 3"]]) -> bool:
    """Whether anyone can see that the path changes."""
    axes_px = [
        np.abs(each) * [scene.focal * TALL, scene.focal * TALL, TALL / 2]
        for scene, each in zip(scenes, rotations, strict=True)
    ]
    return bool(axes_px) and is_visible(np.concatenate(axes_px).max(axis=1))


def _scenes(path: CameraPath, interval_s: float, up: np.ndarray | None) -> list[_Scene]:
    cuts = [0, *(k for k in range(1, len(path)) if path.cuts[k]), len(path)]
    known = np.array(path.focals)[np.isfinite(path.focals)]
    usual = float(np.median(known)) if len(known) else 1.0
    parts = [slice(first, last) for first, last in pairwise(cuts) if last > first]
    return [_scene(path, part, interval_s, usual, None if up is None else up[part]) for part in parts]


def _scene(path: CameraPath, part: slice, interval_s: float, usual_focal: float, up: np.ndarray | None) -> _Scene:
    gaps = np.clip(np.diff(path.times_s[part]) / interval_s, *_GAPS)
    times = np.concatenate([[0.0], np.cumsum(gaps)])
    focals = np.array(path.focals[part])
    known = np.isfinite(focals)
    focal = float(np.median(focals[known])) if known.any() else usual_focal
    across = np.where(known, focals, focal) / focal
    steps = np.array(path.steps[part]) * np.stack([across, across, np.ones_like(across)], axis=-1)
    steps[0] = 0.0
    unknown = np.asarray(np.isnan(steps).any(axis=1))
    if unknown.any():  # rotation is assumed to be even there
        rates = steps[1:] / gaps[:, None]
        seen = ~unknown[1:]
        for axis in range(3):
            even = np.interp(times[1:], times[1:][seen], rates[seen, axis]) if seen.any() else np.zeros_like(gaps)
            steps[1:, axis] = np.where(seen, steps[1:, axis], even * gaps)
    return _Scene(times, steps, focal, path.aspect, np.array(path.borders[part]), int(unknown.sum()), up, path.lens)


@dataclass(frozen=True, eq=False)
class _Scene:
    """Frames without a cut."""

    times: np.ndarray  # presentation times [usual frame intervals]
    steps: np.ndarray  # [frames, 3] rotation from the previous frame to each frame [rad]
    focal: float  # focal length [heights]
    aspect: float  # width of the readout frame divided by its height
    borders: np.ndarray  # extent of each frame
    unknown: int  # number of unknown steps
    up: np.ndarray | None  # [frames, 3] upward direction; None if horizons are left unchanged
    lens: Lens | None = None  # the lens, if it bends straight lines

    def smoothed(self, stiffness: float, zoom: float | None) -> Float64[np.ndarray, "frames 3"]:
        """Returns the rotation from the stabilised to the real camera for each frame.

        Args:
            stiffness: stiffness of the path (:func:`stiffness_for`).
            zoom: zoom at which no border may show; None for no such constraint.
        """
        rotations = np.zeros_like(self.steps)
        unit = self.focal * _ROWS
        for _ in range(_ROUNDS):
            weights = np.ones_like(rotations)
            target = np.zeros_like(rotations)
            if self.up is not None:
                off, weights[:, 2] = self._off_level(rotations)
                target[:, 2] = rotations[:, 2] + off
            room = None
            if zoom is not None:
                inside, slopes = margins(self.borders, rotations, self.focal, zoom, self.aspect, self.lens)
                slopes = slopes / self.focal  # heights per unit
                left = inside - _SPARE - np.einsum("nmi,ni->nm", slopes, rotations * self.focal)
                room = -slopes, left * _ROWS
            smoothing = Smoothing(self.times, stiffness, weights)
            rotations = smoothing.corrections(self._path(rotations) * unit, target * unit, room) / unit
        return rotations

    def needed(self, rotations: np.ndarray) -> Float64[np.ndarray, "frames"]:
        """Returns the zoom that each frame needs to hide its border."""
        return zoom_needed(self.borders, rotations, self.focal, self.aspect, self.lens)

    def within(self, rotations: np.ndarray, zoom: float) -> np.ndarray:
        """Returns the rotations, reduced where the border would still show."""
        low = np.zeros(len(rotations))
        high = np.ones(len(rotations))
        over = self.needed(rotations) > zoom
        optics = self.focal, zoom, self.aspect, self.lens
        for _ in range(_SHRINKS if over.any() else 0):
            middle = (low + high) / 2
            fits = margins(self.borders, rotations * middle[:, None], *optics)[0].min(axis=1) >= 0
            low = np.where(fits, middle, low)
            high = np.where(fits, high, middle)
        return np.where(over, low, 1.0)[:, None] * rotations

    def _path(self, rotations: np.ndarray) -> np.ndarray:
        """Returns a path with these rotations as corrections; its smooth part is the stabilised camera's, added up."""
        to_camera = rotation_matrix(rotations)
        steady = to_camera[1:].transpose(0, 2, 1) @ rotation_matrix(self.steps[1:]) @ to_camera[:-1]
        return np.concatenate([np.zeros((1, 3)), np.cumsum(rotation_vector(steady), axis=0)]) + rotations

    def _off_level(self, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the clockwise angle of each stabilised view's horizon [rad], and its weight.

        The frame side nearest to up is taken as up: cameras are also held upright or mounted upside down.
        """
        assert self.up is not None
        right, down, _ = np.einsum("nji,nj->in", rotation_matrix(rotations), self.up)
        angle = np.unwrap(np.arctan2(right, -down))
        quarter = np.pi / 2
        sure = right**2 + down**2  # undetermined for a camera that looks straight up or down
        return angle - quarter * np.round(np.average(angle, weights=sure + 1e-9) / quarter), 1 + _LEVEL * sure
