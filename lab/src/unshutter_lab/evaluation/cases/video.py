"""|R_F| over consecutive frames, as interpreted by this project.

The paper gives |R_F| for a video without defining it. Our interpretation: the number of matches between two consecutive
rectified frames that are inliers of one fundamental matrix, as all would be for a moving global-shutter camera. More is
better. Features are SIFT, matched by Lowe's ratio test; OpenCV's USAC (MAGSAC), seeded, estimates the matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unshutter.estimators.base import View
from unshutter.motion import RowMotion
from unshutter.options import Reference
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
from unshutter_lab.evaluation.cases.folders import Frame

TRUTH = "true global shutter"
_REFERENCE: Reference = "middle"
_RATIO = 0.75
_MOST_FEATURES = 3000
_THRESHOLD = 1.0  # px from the epipolar line
_FEWEST = 8  # matches required for a fundamental matrix
# a frame: uint8 [H, W, bands], and the bool mask [H, W] of its visible pixels
_Masked = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class VideoCase(Case):
    """Two consecutive frames.

    Attributes:
        group: name of the data set in the tables.
        frames: their files.
        seed: seed of the run.
    """

    group: str
    frames: tuple[Frame, Frame]
    seed: int

    @property
    def key(self) -> str:
        """Group, sequence and first file."""
        return f"{self.group}|{self.frames[0].sequence}|{self.frames[0].rs.name}"

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
            record: Record = {"suite": "consecutive frames", "group": self.group, "photo": self.frames[0].sequence}
            record |= {"draw": self.frames[0].number, "estimator": name, **answers[0].figures()}
            records.append(record | {"inliers": inliers, "inliers_input": nothing, "matches": matches})
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures of the first frame."""
        photos = [Photo.open(frame.rs) for frame in self.frames]
        motions = {name: ask(loaded(name), View(photos[0])).motion for name in names}
        pictures = [("input", in_8_bits(photos[0]))]
        for name, motion in motions.items():
            if name != NOTHING:
                pictures.append((name, rectified(photos[0], motion.rereferenced(_REFERENCE))[0]))
        return Example(f"{self.group} {self.frames[0].sequence}", pictures, motions)

    def _rectified_frames(self, name: str, photos: list[Photo], loaded: Loaded) -> tuple[list[Answer], list[_Masked]]:
        """Returns the answers, and the resulting frames with their masks."""
        if name == TRUTH:
            nothing = Answer(RowMotion.zero(photos[0].height, photos[0].width))
            return [nothing], [_as_it_is(Photo.open(frame.gs[_REFERENCE])) for frame in self.frames]
        answers = [ask(loaded(name), View(photo)) for photo in photos]
        motions = [answer.motion.rereferenced(_REFERENCE) for answer in answers]
        return answers, [rectified(photo, motion) for photo, motion in zip(photos, motions, strict=True)]


def _as_it_is(photo: Photo) -> _Masked:
    return in_8_bits(photo), np.ones((photo.height, photo.width), bool)


def agreeing_matches(first: _Masked, second: _Masked, seed: int) -> tuple[int, int]:
    """Returns (inliers of one fundamental matrix, all matches) between two frames.

    Args:
        first, second: frames, each with its mask.
        seed: seed of the estimation.
    """
    import cv2

    (points_a, words_a), (points_b, words_b) = _features(*first), _features(*second)
    if min(len(points_a), len(points_b)) < 2:
        return 0, 0
    nearest = cv2.BFMatcher(cv2.NORM_L2).knnMatch(words_a, words_b, k=2)
    distinct = [best for best, next_best in nearest if best.distance < _RATIO * next_best.distance]
    if len(distinct) < _FEWEST:
        return 0, len(distinct)
    a, b = points_a[[match.queryIdx for match in distinct]], points_b[[match.trainIdx for match in distinct]]
    _, agreeing = cv2.findFundamentalMat(a, b, _usac(seed))
    return (0 if agreeing is None else int(np.count_nonzero(agreeing))), len(distinct)


def _features(picture: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns positions [N, 2] and descriptors [N, 128] of the strongest SIFT features, away from the mask's border."""
    import cv2

    grey = picture[..., 0] if picture.shape[-1] == 1 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    inner = cv2.erode(mask.astype(np.uint8) * 255, np.ones((15, 15), np.uint8), borderValue=[255])
    points, words = cv2.SIFT.create(_MOST_FEATURES).detectAndCompute(np.ascontiguousarray(grey), inner)
    return np.array([p.pt for p in points]).reshape(-1, 2), np.zeros((0, 128), np.float32) if words is None else words


def _usac(seed: int):
    import cv2

    settings = cv2.UsacParams()
    settings.randomGeneratorState = seed
    settings.threshold = _THRESHOLD
    settings.confidence = 0.9999
    settings.maxIterations = 10_000
    settings.score = cv2.SCORE_METHOD_MAGSAC
    settings.sampler = cv2.SAMPLING_UNIFORM
    settings.loMethod = cv2.LOCAL_OPTIM_SIGMA
    return settings
