"""Cases of several frames: |R_F| over consecutive frames, and sequences of a rotating camera with known motion.

The paper gives |R_F| for a video without defining it. Our interpretation: the number of matches between two consecutive
rectified frames that are inliers of one fundamental matrix, as all would be for a moving global-shutter camera. More is
better. Features are SIFT, matched by Lowe's ratio test; OpenCV's USAC (MAGSAC), seeded, estimates the matrix.

A sequence is a photo seen by a camera rotating as recorded, at several readout ratios.
"""

from __future__ import annotations

import hashlib
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

from unshutter.frames.sequence import CameraMotion
from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.options import Camera, Reference
from unshutter.photo import Photo
from unshutter.readout_time import ReadoutRatio
from unshutter.single.estimator import View
from unshutter_lab.evaluation.case import Answer, Case, Example, Loaded, Record, ask, compared, in_8_bits, rectified
from unshutter_lab.evaluation.metrics import epe_of_nothing, motion_error
from unshutter_lab.evaluation.pair_cases import Frame
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera

TRUTH = "true global shutter"
_REFERENCE: Reference = "middle"
_RATIO = 0.75
_MOST_FEATURES = 3000
_THRESHOLD = 1.0  # px from the epipolar line
_MIN_MATCHES = 8  # matches required for a fundamental matrix
# a frame: uint8 [H, W, bands], and the bool mask [H, W] of its visible pixels
_Masked = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class VideoCase(Case):
    """Two consecutive frames."""

    group: str  # name of the data set in the tables
    frames: tuple[Frame, Frame]  # their files
    seed: int  # seed of the run

    @property
    def key(self) -> str:
        """Group, sequence and first file."""
        return f"{self.group}|{self.frames[0].sequence}|{self.frames[0].rs.name}"

    @property
    def place(self) -> Record:
        """Group, sequence and number of the first frame."""
        frame = self.frames[0]
        return {"suite": "consecutive frames", "group": self.group, "photo": frame.sequence, "draw": frame.number}

    @property
    def oracles(self) -> tuple[str, ...]:
        """The true global-shutter frames, if available."""
        return (TRUTH,) if all(_REFERENCE in frame.gs for frame in self.frames) else ()

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per name."""
        photos = [Photo.open(frame.rs) for frame in self.frames]
        nothing = agreeing_matches(*(_as_it_is(photo) for photo in photos), seed=self.seed)[0]
        records = []
        for name in names:
            answers, frames = self._rectified_frames(name, photos, loaded)
            inliers, matches = agreeing_matches(*frames, seed=self.seed)
            figures = {"inliers": inliers, "inliers_input": nothing, "matches": matches}
            records.append({**self.place, "estimator": name, **answers[0].figures(), **figures})
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures of the first frame."""
        photo = Photo.open(self.frames[0].rs)
        motions = {name: ask(loaded(name), View(photo)).motion for name in names}
        pictures = compared(photo, motions, _REFERENCE)
        return Example(f"{self.group} {self.frames[0].sequence}", pictures, motions)

    def _rectified_frames(self, name: str, photos: list[Photo], loaded: Loaded) -> tuple[list[Answer], list[_Masked]]:
        """Returns the answers, and the resulting frames with their masks."""
        if name == TRUTH:
            nothing = Answer(Finding(RowMotion.zero(photos[0].height, photos[0].width)))
            return [nothing], [_as_it_is(Photo.open(frame.gs[_REFERENCE])) for frame in self.frames]
        answers = [ask(loaded(name), View(photo)) for photo in photos]
        motions = [answer.motion.rereferenced(_REFERENCE) for answer in answers]
        return answers, [rectified(photo, motion) for photo, motion in zip(photos, motions, strict=True)]


def _as_it_is(photo: Photo) -> _Masked:
    return in_8_bits(photo), np.ones((photo.height, photo.width), bool)


def agreeing_matches(first: _Masked, second: _Masked, seed: int) -> tuple[int, int]:
    """Returns (inliers of one fundamental matrix, all matches) between two frames."""
    (points_a, words_a), (points_b, words_b) = _features(*first), _features(*second)
    if min(len(points_a), len(points_b)) < 2:
        return 0, 0
    nearest = cv2.BFMatcher(cv2.NORM_L2).knnMatch(words_a, words_b, k=2)
    distinct = [best for best, next_best in nearest if best.distance < _RATIO * next_best.distance]
    if len(distinct) < _MIN_MATCHES:
        return 0, len(distinct)
    a, b = points_a[[match.queryIdx for match in distinct]], points_b[[match.trainIdx for match in distinct]]
    _, agreeing = cv2.findFundamentalMat(a, b, _usac(seed))
    return (0 if agreeing is None else int(np.count_nonzero(agreeing))), len(distinct)


def _features(picture: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns positions [N, 2] and descriptors [N, 128] of the strongest SIFT features, away from the mask's border."""
    grey = picture[..., 0] if picture.shape[-1] == 1 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    inner = cv2.erode(mask.astype(np.uint8) * 255, np.ones((15, 15), np.uint8), borderValue=[255])
    points, words = cv2.SIFT.create(_MOST_FEATURES).detectAndCompute(np.ascontiguousarray(grey), inner)
    return np.array([p.pt for p in points]).reshape(-1, 2), np.zeros((0, 128), np.float32) if words is None else words


def _usac(seed: int):
    settings = cv2.UsacParams()
    settings.randomGeneratorState = seed
    settings.threshold = _THRESHOLD
    settings.confidence = 0.9999
    settings.maxIterations = 10_000
    settings.score = cv2.SCORE_METHOD_MAGSAC
    settings.sampler = cv2.SAMPLING_UNIFORM
    settings.loMethod = cv2.LOCAL_OPTIM_SIGMA
    return settings


RATIO_ESTIMATED, RATIO_KNOWN = "frames-camera", "frames-camera, ratio given"


class RotatingClip(Case):
    """Frames of a rotating camera with known motion. Methods that see one photo get some of them."""

    shown: ClassVar[str]  # the method of several frames whose result is shown

    @property
    @abstractmethod
    def title(self) -> str:
        """Title of the case where it is shown."""

    @property
    @abstractmethod
    def singles(self) -> Sequence[int]:
        """Numbers of the frames given to methods that see one photo."""

    @abstractmethod
    def camera_and_frames(self) -> tuple[RotatingCamera, list[np.ndarray]]:
        """Returns the camera and its frames, uint8 [H, W, bands]."""

    @abstractmethod
    def view_of(self, frame: np.ndarray, camera: RotatingCamera) -> View:
        """Returns a frame as it is given to methods that see one photo."""

    @abstractmethod
    def more_figures(self, name: str, errors: list[float], ratio: ReadoutRatio | None) -> Record:
        """Returns further figures of a method, from its errors [px at 256 rows] and the readout ratio that it used."""

    @property
    def oracles(self) -> tuple[str, ...]:
        """The methods that see all frames, with and without the readout ratio."""
        return (RATIO_ESTIMATED, RATIO_KNOWN)

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per name."""
        camera, frames = self.camera_and_frames()
        records = []
        for name in names:
            numbers = range(len(frames)) if name in self.oracles else self.singles
            answers, ratio = self._answers(name, camera, frames, numbers, loaded)
            truths = [camera.motion(k) for k in numbers]
            errors = [motion_error(answer.motion, truth).epe for answer, truth in zip(answers, truths, strict=True)]
            nothing = float(np.mean([epe_of_nothing(truth) for truth in truths]))
            figures = {"epe": float(np.mean(errors)), "epe_nothing": nothing, **self.more_figures(name, errors, ratio)}
            records.append({**self.place, "estimator": name, **answers[len(answers) // 2].figures(), **figures})
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures and curves of the middle frame."""
        camera, frames = self.camera_and_frames()
        k = camera.frames // 2
        names = [*names, self.shown]
        curves = {name: self._answers(name, camera, frames, [k], loaded)[0][0].motion for name in names}
        truth = camera.motion(k)
        pictures = compared(Photo.from_array(frames[k]), {**curves, "true motion": truth})
        return Example(self.title, pictures, {"truth": truth, **curves})

    def _answers(
        self, name: str, camera: RotatingCamera, frames: list[np.ndarray], numbers: Sequence[int], loaded: Loaded
    ) -> tuple[list[Answer], ReadoutRatio | None]:
        if name in self.oracles:
            finder = CameraMotion(ReadoutRatio(camera.readout_ratio) if name == RATIO_KNOWN else None)
            found = [frame.finding() for frame in finder.frames(frames)]
            return [Answer(found[k], declined=str(found[k].reason or "")) for k in numbers], finder.ratio
        return [ask(loaded(name), self.view_of(frames[k], camera)) for k in numbers], None


RATIOS = (0.3, 0.6, 0.9)
_FRAMES, _FPS, _NOISE = 60, 30.0, 2.0
_HEIGHT, _WIDTH, _FOCAL = 360, 640, 550.0  # px
_EVERY = 12  # frames from one that is given to methods that see one photo to the next
_COVERED = 1.645  # standard deviations of a 90 % interval


@dataclass(frozen=True)
class SequenceCase(RotatingClip):
    """One synthetic sequence."""

    photo: str  # name of the photo in its folder
    path: Path  # path of the photo
    log: Path  # recorded camera motion
    ratio: float  # readout time in frame intervals
    seed: int  # seed of the run

    shown = RATIO_ESTIMATED

    @property
    def key(self) -> str:
        """Log, photo and ratio."""
        return f"{self.log.stem}|{self.photo}|{self.ratio}"

    @property
    def place(self) -> Record:
        """Frames, log, photo and ratio."""
        return {"suite": f"{_FRAMES} frames", "group": self.log.stem, "photo": self.photo, "draw": self.ratio}

    @property
    def title(self) -> str:
        """Log and ratio."""
        return f"{self.log.stem}, ratio {self.ratio}"

    @property
    def singles(self) -> Sequence[int]:
        """Every twelfth frame."""
        return range(_EVERY // 2, _FRAMES, _EVERY)

    def camera_and_frames(self) -> tuple[RotatingCamera, list[np.ndarray]]:
        """See :class:`RotatingClip`. Both depend only on the seed and the case."""
        digest = int(hashlib.sha256(self.path.read_bytes() + self.key.encode()).hexdigest(), 16)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, digest]))
        size = {"height": _HEIGHT, "width": _WIDTH, "focal_px": _FOCAL}
        camera = RotatingCamera.drawn(rng, _log(self.log), _FRAMES, fps=_FPS, readout_ratio=self.ratio, **size)
        pixels = in_8_bits(Photo.open(self.path))
        return camera, list(camera.rendered(np.ascontiguousarray(pixels), _NOISE, self.seed))

    def view_of(self, frame: np.ndarray, camera: RotatingCamera) -> View:
        """See :class:`RotatingClip`."""
        return View(Photo.from_array(frame), Camera(focal_px=camera.focal_px))

    def more_figures(self, name: str, errors: list[float], ratio: ReadoutRatio | None) -> Record:
        """See :class:`RotatingClip`."""
        figures: Record = {"worst_epe": max(errors)}
        if name == RATIO_ESTIMATED:
            figures["ratio_told"] = ratio is not None
            if ratio is not None:
                error = abs(ratio.value - self.ratio)
                figures |= {"ratio_error": error, "ratio_sigma": ratio.error}
                figures |= {"ratio_within": error <= 0.1, "ratio_covered": error <= _COVERED * ratio.error}
        return figures


@lru_cache(maxsize=16)
def _log(path: Path) -> RotationLog:
    return RotationLog.load_steady(path)
