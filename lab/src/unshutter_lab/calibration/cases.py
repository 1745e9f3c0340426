"""Cases for calibration: photos with known motions and without motion, with the results of network and search."""

from __future__ import annotations

import json
import zlib
from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from unshutter.estimators.base import View
from unshutter.estimators.methods.segment_manhattan import SegmentManhattan
from unshutter.estimators.register import method
from unshutter.estimators.right_angles.answers import LARGEST, LEAST_GAIN
from unshutter.estimators.right_angles.calibration import NetworkErrors, kinds_of
from unshutter.estimators.right_angles.odds import confidence_figures, figures
from unshutter.estimators.right_angles.posterior import Posterior, displacement
from unshutter.estimators.right_angles.search import explore
from unshutter.estimators.right_angles.view import STARTS, likelihood_of, segments_of
from unshutter.estimators.segment_network import SegmentNetwork
from unshutter.estimators.segments import unusable
from unshutter.frames.sequence import estimate_frames
from unshutter.motion import Motion, RowMotion
from unshutter.options import DEFAULT_ESTIMATOR
from unshutter.photo import Photo
from unshutter_lab.calibration.distributions import coefficients_of
from unshutter_lab.evaluation.cases.case import Loaded, Record, Trial, in_8_bits
from unshutter_lab.evaluation.cases.synthetic import Suite, SyntheticCase
from unshutter_lab.evaluation.metrics import motion_error

DRAWN = (
    Suite("256 px", of_pictures=False),
    Suite("native size", rows=None, of_pictures=False),
    Suite("portrait", turned=1, orientation=6, of_pictures=False),
)
MOVED = (
    *DRAWN,
    Suite("50 ms", readout_s=0.05, of_pictures=False),
    Suite("20 ms", readout_s=0.02, of_pictures=False),
    Suite("100 ms", readout_s=0.1, of_pictures=False),
)
STILL = (
    Suite("still 256 px", still=True),
    Suite("still native size", rows=None, still=True),
    Suite("still portrait", still=True, turned=1, orientation=6),
)
WHOLE, CROP, FRAME = "whole", "crop", "frame"  # suites of real photos and of frames from clips
CROPS = 8  # of each photo
_ALONE = ("256 px", "still 256 px", WHOLE, CROP)  # suites also searched without the network
_LONGEST_SIDE = 900  # of a crop [px]


@dataclass(frozen=True)
class NetworkCase(Trial):
    """A photo with a known motion, for recording the network's estimate.

    Attributes:
        photo: the photo with synthetic motion.
    """

    photo: SyntheticCase

    @property
    def key(self) -> str:
        """Key of the photo."""
        return f"network|{self.photo.key}"

    @property
    def oracles(self) -> tuple[str, ...]:
        """No oracles."""
        return ()

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns the estimate and the truth, [6] each; no record if the photo has too few segments."""
        exam = self.photo.exam()
        segments, _ = segments_of(exam.view)
        if unusable(segments, exam.view.height, exam.view.width):
            return []
        answer = _network().coefficients(segments, exam.view.up).ravel()
        truth = coefficients_of(exam.truth)
        return [{"estimator": name, "answer": answer.tolist(), "truth": truth.tolist()} for name in names]


@dataclass(frozen=True)
class SearchCase(Trial):
    """A photo, for recording the results of the search.

    Attributes:
        suite: name of the suite.
        photo: name of the photo.
        known: sections of the calibration already fitted, as JSON: kinds of motion and the network's errors.
    """

    suite: str
    photo: str
    known: str

    @property
    def oracles(self) -> tuple[str, ...]:
        """No oracles."""
        return ()

    @abstractmethod
    def picture(self) -> tuple[View, Motion]:
        """Returns the photo and its true motion."""

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns the search's results with the network's estimate and without; no record if neither applies."""
        view, truth = self.picture()
        segments, size = segments_of(view)
        if unusable(segments, view.height, view.width) or view.attitude_deg()[0] is not None:
            return []
        estimator = _estimator(self.known)
        posterior, answer = estimator.weigh(view, segments, size)
        record = {
            "suite": self.suite,
            "photo": self.photo,
            "nothing": motion_error(RowMotion.zero(view.height, view.width), truth).epe,
            "with_network": _found(posterior, view, truth, answer),
            "without_network": None,
        }
        if self.suite in _ALONE:
            alone = explore(likelihood_of(view, segments, size, kinds=estimator.kinds), STARTS)
            record["without_network"] = _found(alone, view, truth, None)
        return [{"estimator": name, **record} for name in names]


@dataclass(frozen=True)
class SyntheticSearchCase(SearchCase):
    """A photo with known synthetic motion, or none.

    Attributes:
        made: the synthetic case.
    """

    made: SyntheticCase

    @property
    def key(self) -> str:
        """Key of the synthetic case."""
        return self.made.key

    def picture(self) -> tuple[View, Motion]:
        """Returns the photo and its true motion."""
        exam = self.made.exam()
        return exam.view, exam.truth


@dataclass(frozen=True)
class OrdinarySearchCase(SearchCase):
    """A photo without motion, whole or cropped.

    Attributes:
        path: path of the photo.
        crop: number of the crop; None for the whole photo.
    """

    path: Path
    crop: int | None

    @property
    def key(self) -> str:
        """Suite, name of the photo, and number of the crop."""
        return f"{self.suite}|{self.photo}|{self.crop}"

    def picture(self) -> tuple[View, Motion]:
        """Returns the photo and zero motion."""
        photo = Photo.open(self.path)
        view = View(photo if self.crop is None else crop_of(photo, self.photo, self.crop))
        return view, RowMotion.zero(view.height, view.width)


@dataclass(frozen=True)
class FrameSearchCase(SearchCase):
    """A frame of a clip. Its true motion is taken from the neighbouring frames.

    Attributes:
        clip: all frames, in order.
        ratio: readout time in frame intervals.
        number: number of the frame in the clip.
    """

    clip: tuple[Path, ...]
    ratio: float
    number: int

    @property
    def key(self) -> str:
        """Suite, clip, and number of the frame."""
        return f"{self.suite}|{self.photo}|{self.number}"

    def picture(self) -> tuple[View, Motion]:
        """Returns the frame and its motion."""
        return View(Photo.open(self.clip[self.number])), _frame_motions(self.clip, self.ratio)[self.number]


def crop_of(photo: Photo, name: str, number: int) -> Photo:
    """Returns a crop of a photo as another camera might have seen it, held slightly askew.

    Args:
        photo: the whole photo.
        name, number: name of the photo and number of the crop, which determine the crop.
    """
    rows, columns = photo.height, photo.width
    pixels = np.broadcast_to(in_8_bits(photo), (rows, columns, 3))
    rng = np.random.default_rng([zlib.crc32(name.encode()), number])
    share, roll_deg = rng.uniform(0.55, 0.85), rng.normal(0, 3)
    height, width = int(rows * share), int(columns * share)
    scale = min(1, _LONGEST_SIDE / max(height, width))
    right, down = rng.uniform(-0.3, 0.3, 2)
    middle = (columns / 2 + right * (columns - width), rows / 2 + down * (rows - height))
    size = (int(width * scale), int(height * scale))
    matrix = cv2.getRotationMatrix2D(middle, roll_deg, scale)
    matrix[:, 2] += np.array(size) / 2 - middle
    small = cv2.GaussianBlur(pixels, (0, 0), 0.5 / scale) if scale < 1 else pixels
    crop = cv2.warpAffine(small, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    crop = crop[:, ::-1] if rng.random() < 0.5 else crop
    return replace(Photo.from_array(np.ascontiguousarray(crop)), orientation=photo.orientation)


@cache
def _frame_motions(clip: tuple[Path, ...], ratio: float) -> list[Motion]:
    return list(estimate_frames(clip, readout_ratio=ratio))


@cache
def _network() -> SegmentNetwork:
    return SegmentNetwork(method(DEFAULT_ESTIMATOR).weights)


@cache
def _estimator(known: str) -> SegmentManhattan:
    fields = json.loads(known)
    own = method(DEFAULT_ESTIMATOR)
    return SegmentManhattan(own, own.weights, NetworkErrors.of(fields["network_errors"]), kinds_of(fields["kinds"]))


def _found(posterior: Posterior, view: View, truth: Motion, answer: np.ndarray | None) -> Record | None:
    """Returns the figures for odds and confidence, and the error of the motion; None if it would be declined."""
    if posterior.lines_gain < LEAST_GAIN or displacement(posterior.motion) > LARGEST:
        return None
    motion = view.cubic_motion(posterior.motion.reshape(2, 3), DEFAULT_ESTIMATOR)
    return {
        "error": motion_error(motion, truth).epe,
        "figures": {"evidence": posterior.evidence} if answer is None else figures(posterior, answer),
        "confidence_figures": confidence_figures(posterior, answer, odds=0.0),  # the odds are fitted later
    }
