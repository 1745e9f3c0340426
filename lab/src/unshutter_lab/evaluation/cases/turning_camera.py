"""Sequences with known motion: a photo seen by a camera rotating as recorded, at several readout ratios."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from unshutter.estimators.base import Estimator, View
from unshutter.frames.self_calibration import ReadoutRatio
from unshutter.frames.sequence import CameraMotion
from unshutter.motion import Motion, RowMotion
from unshutter.options import Camera
from unshutter.photo import Photo
from unshutter_lab.evaluation.cases.case import (
    NOTHING,
    Answer,
    Case,
    Example,
    Loaded,
    Record,
    ask,
    in_8_bits,
    rectified,
)
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import TurningCamera

RATIO_ESTIMATED, RATIO_KNOWN = "frames-camera", "frames-camera, ratio given"
RATIOS = (0.3, 0.6, 0.9)
_FRAMES, _FPS, _NOISE = 60, 30.0, 2.0
_HEIGHT, _WIDTH, _FOCAL = 360, 640, 550.0  # px
_JITTER_S = 0.03  # smoothing of motion-capture logs
_EVERY = 12  # every twelfth frame is given to single-photo methods
_COVERED = 1.645  # standard deviations of a 90 % interval


@dataclass(frozen=True)
class SequenceCase(Case):
    """One synthetic sequence.

    Attributes:
        photo: name of the photo in its folder.
        path: path of the photo.
        log: recorded camera motion.
        ratio: readout time in frame intervals.
        seed: seed of the run.
    """

    photo: str
    path: Path
    log: Path
    ratio: float
    seed: int

    @property
    def key(self) -> str:
        """Log, photo and ratio."""
        return f"{self.log.stem}|{self.photo}|{self.ratio}"

    @property
    def oracles(self) -> tuple[str, ...]:
        """The methods that see the whole sequence, with and without the readout ratio."""
        return (RATIO_ESTIMATED, RATIO_KNOWN)

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per name."""
        camera, frames = self._camera_and_frames()
        return [self._record(name, camera, frames, loaded) for name in names]

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures and curves of the middle frame."""
        camera, frames = self._camera_and_frames()
        k = _FRAMES // 2
        curves = {
            name: self._motions(name, camera, frames, [k], loaded)[0][0].motion for name in [*names, RATIO_ESTIMATED]
        }
        photo = Photo.from_array(frames[k])
        pictures = [("input", in_8_bits(photo))]
        pictures += [(name, rectified(photo, motion)[0]) for name, motion in curves.items() if name != NOTHING]
        truth = camera.motion(k)
        pictures.append(("true motion", rectified(photo, truth)[0]))
        return Example(f"{self.log.stem}, ratio {self.ratio}", pictures, {"truth": truth, **curves})

    def _camera_and_frames(self) -> tuple[TurningCamera, list[np.ndarray]]:
        """Returns the camera and its frames, which depend only on the seed and the case."""
        digest = int(hashlib.sha256(self.path.read_bytes() + self.key.encode()).hexdigest(), 16)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, digest]))
        size = {"height": _HEIGHT, "width": _WIDTH, "focal_px": _FOCAL}
        camera = TurningCamera.drawn(rng, _log(self.log), _FRAMES, fps=_FPS, readout_ratio=self.ratio, **size)
        pixels = in_8_bits(Photo.open(self.path))
        return camera, list(camera.rendered(np.ascontiguousarray(pixels), _NOISE, self.seed))

    def _record(self, name: str, camera: TurningCamera, frames: list[np.ndarray], loaded: Loaded) -> Record:
        numbers = list(range(_FRAMES)) if name in self.oracles else list(range(_EVERY // 2, _FRAMES, _EVERY))
        answers, ratio = self._motions(name, camera, frames, numbers, loaded)
        truths = [camera.motion(k) for k in numbers]
        errors = [motion_error(answer.motion, truth).epe for answer, truth in zip(answers, truths, strict=True)]
        nothing = [motion_error(_zero(truth), truth).epe for truth in truths]
        record: Record = {"suite": f"{_FRAMES} frames", "group": self.log.stem, "photo": self.photo, "draw": self.ratio}
        record |= {"estimator": name, **_middle(answers).figures()}
        record |= {"epe": float(np.mean(errors)), "worst_epe": max(errors), "epe_nothing": float(np.mean(nothing))}
        return record | (self._of_ratio(ratio) if name == RATIO_ESTIMATED else {})

    def _of_ratio(self, ratio: ReadoutRatio | None) -> Record:
        if ratio is None:
            return {"ratio_told": False}
        error = abs(ratio.value - self.ratio)
        within = {"ratio_within": error <= 0.1, "ratio_covered": error <= _COVERED * ratio.error}
        return {"ratio_told": True, "ratio_error": error, "ratio_sigma": ratio.error, **within}

    def _motions(
        self, name: str, camera: TurningCamera, frames: list[np.ndarray], numbers: list[int], loaded: Loaded
    ) -> tuple[list[Answer], ReadoutRatio | None]:
        if name in self.oracles:
            known = ReadoutRatio(self.ratio, 0.0, "the truth") if name == RATIO_KNOWN else None
            finder = CameraMotion(known)
            motions = [frame.motion() for frame in finder.frames(frames)]
            return [Answer(motions[k], declined=str(motions[k].reason or "")) for k in numbers], finder.ratio
        estimator: Estimator = loaded(name)
        views = [View(Photo.from_array(frames[k]), Camera(focal_px=camera.focal_px)) for k in numbers]
        return [ask(estimator, view) for view in views], None


def _middle(answers: list[Answer]) -> Answer:
    return answers[len(answers) // 2]


def _zero(motion: Motion) -> Motion:
    return RowMotion.zero(motion.height, motion.width)


@lru_cache(maxsize=16)
def _log(path: Path) -> RotationLog:
    log = RotationLog.load(path)
    return log.smoothed(_JITTER_S) if log.from_poses else log
