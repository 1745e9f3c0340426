"""Cases for calibration: photos with known motions and without motion, with the results of network and search.

Also fits the distributions of motions, drawn and recorded, and of the network's errors.
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.sequence import estimate_frames
from unshutter.motion import Motion, RowMotion
from unshutter.options import DEFAULT_ESTIMATOR
from unshutter.photo import Photo
from unshutter.single.candidates import LEAST_GAIN, modes_of
from unshutter.single.estimator import View
from unshutter.single.likelihood import STARTS, likelihood_of, segments_of, unusable
from unshutter.single.methods import SegmentManhattan
from unshutter.single.network import SegmentNetwork
from unshutter.single.prior import NORMAL, MotionKind, NetworkErrors, kinds_of
from unshutter.single.prospects import features
from unshutter.single.register import method
from unshutter.single.search import Posterior, bend, displacement, explore
from unshutter_lab.evaluation.case import Loaded, Record, Trial
from unshutter_lab.evaluation.metrics import epe_of_nothing, motion_error
from unshutter_lab.evaluation.synthetic import Suite, SyntheticCase, crop_of
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import draw_from_trajectory, draw_quadratic

FREEDOM = 3.0  # few: occasionally a hand moves much faster, or a network errs much more
USUAL_PX = 25.0  # of 256 rows: larger estimates of the network have larger errors
READOUTS_S = (0.02, 0.05, 0.1)  # of recorded motions: phones, cameras with electronic shutters
SHARES = {"quadratic": 0.2, "hand": 0.6, "pan": 0.2}  # priors, chosen on validation photos
_DRAWS = 2000  # of quadratic motions
_WINDOWS = 150  # per log and readout time
_EVEN = 0.15  # largest share of a pan's displacement that remains after removing its best shear
_ROWS, _FOCAL_PX = 256, 256.0
_LEAST_CUBIC = 0.01  # least cubic coefficient of drawn quadratics, so that their distribution has a density
_MEDIAN_OF_NORMAL = 0.6745  # of the absolute value, in standard deviations
_MOST_STEPS = 1000
_ARRIVED = 1e-10  # relative change of a step


def fit_motion_kinds(logs: Sequence[Path], seed: int) -> tuple[MotionKind, ...]:
    """Fits the priors of motions: benchmarks' quadratics, and recorded hand motion.

    Shake: all windows of the logs. Pans: windows that are little more than a shear; the shape of their distribution
    is that of all such windows together, its scale that of the median one.
    """
    rng = np.random.default_rng(seed)
    drawn = np.array([coefficients_of(draw_quadratic(rng).crop) for _ in range(_DRAWS)])
    quadratic = drawn.T @ drawn / len(drawn) + np.diag([0, 0, _LEAST_CUBIC**2] * 2)
    recorded = _windows(logs, rng)
    sizes = np.array([displacement(motion) for motion in recorded])
    even = np.array([bend(motion) for motion in recorded]) < _EVEN * sizes
    if even.sum() < 2 * recorded.shape[1]:
        raise UnshutterError(f"the recorded motions hold {even.sum()} even pans: too few to tell how hands move")
    shape = recorded[even].T @ recorded[even] / (sizes[even] ** 2).sum()
    pan = shape * (np.median(sizes[even]) / _MEDIAN_OF_NORMAL) ** 2
    scales = {"quadratic": (quadratic, NORMAL), "hand": (student_scale(recorded), FREEDOM), "pan": (pan, NORMAL)}
    return tuple(MotionKind(name, scale, freedom, SHARES[name]) for name, (scale, freedom) in scales.items())


def fit_network_errors(errors: np.ndarray, sizes_px: np.ndarray) -> NetworkErrors:
    """Returns the maximum-likelihood scales and correlations of the network's errors [N, 6] (estimates minus truths).

    ``sizes_px`` [N] are the root mean square displacements of the estimates [px of 256 rows].
    """
    scale = student_scale(errors / np.sqrt(1 + (sizes_px / USUAL_PX) ** 2)[:, None])
    return NetworkErrors(FREEDOM, *scales_and_correlations(scale), USUAL_PX)


def student_scale(values: np.ndarray) -> np.ndarray:
    """Returns the maximum-likelihood [D, D] scale matrix of Student's t around zero, for values [N, D]."""
    scale = values.T @ values / len(values)
    for _ in range(_MOST_STEPS):  # expectation maximisation
        squares = np.einsum("ni,ij,nj->n", values, np.linalg.inv(scale), values)
        weights = (FREEDOM + scale.shape[0]) / (FREEDOM + squares)
        before, scale = scale, (weights[:, None] * values).T @ values / len(values)
        if np.abs(scale - before).max() <= _ARRIVED * np.abs(scale).max():
            break
    return scale


def scales_and_correlations(scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Splits a scale matrix as in the file, so that cases are searched with the shipped precision."""
    scales = np.sqrt(np.diag(scale))
    correlations = np.round(scale / np.outer(scales, scales), 3)
    return np.array([float(f"{each:.4g}") for each in scales]), correlations


def coefficients_of(motion: Motion) -> np.ndarray:
    """[6] of u, u^2, u^3 with u = (row + 1/2) / rows: t_x [rows], r_z [rad], from a least-squares fit."""
    u = (np.arange(motion.height) + 0.5) / motion.height
    powers = np.stack([u, u**2, u**3], axis=1)
    tx, rz = (np.linalg.lstsq(powers - powers[0], a, rcond=None)[0] for a in (motion.tx_px, motion.rz_rad))
    return np.concatenate([tx / motion.height, rz])


def _windows(logs: Sequence[Path], rng: np.random.Generator) -> np.ndarray:
    """[N, 6] motions in windows of the logs, equally many per log and readout time."""
    found = []
    for log in map(RotationLog.load, logs):
        for readout_s in np.repeat(READOUTS_S, _WINDOWS):
            window = draw_from_trajectory(rng, log, float(readout_s), _FOCAL_PX, _ROWS, canvas=_ROWS + 2)
            found.append(coefficients_of(window.crop))
    return np.array(found)


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
CROPPED = (
    Suite("cropped", rows=None, cropped=True, of_pictures=False),
    Suite("cropped 20 ms", rows=None, cropped=True, readout_s=0.02, of_pictures=False),
    Suite("cropped 50 ms", rows=None, cropped=True, readout_s=0.05, of_pictures=False),
    Suite("cropped still", rows=None, cropped=True, still=True),
)
WHOLE, CROP, FRAME = "whole", "crop", "frame"  # suites of real photos and of frames from clips
CROPS = 8  # of each photo
_ALONE = ("256 px", "still 256 px", WHOLE, CROP)  # suites also searched without the network


@dataclass(frozen=True)
class NetworkCase(Trial):
    """A photo with a known motion, for recording the network's estimate."""

    photo: SyntheticCase  # the photo with synthetic motion

    @property
    def key(self) -> str:
        """Key of the photo."""
        return f"network|{self.photo.key}"

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
    """A photo, for recording the results of the search."""

    suite: str
    photo: str
    known: str  # sections of the calibration already fitted, as JSON: kinds of motion and the network's errors

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
        record = {"suite": self.suite, "photo": self.photo, "nothing": epe_of_nothing(truth)}
        record |= {"with_network": found(posterior, view, truth, answer), "without_network": []}
        if self.suite in _ALONE:
            alone = explore(likelihood_of(view, segments, size, kinds=estimator.kinds), STARTS)
            record["without_network"] = found(alone, view, truth, None)
        return [{"estimator": name, **record} for name in names]


@dataclass(frozen=True)
class SyntheticSearchCase(SearchCase):
    """A photo with known synthetic motion, or none."""

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
    """A photo without motion, whole or cropped."""

    path: Path  # path of the photo
    crop: int | None  # number of the crop; None for the whole photo

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
    """A frame of a clip. Its true motion is taken from the neighbouring frames."""

    clip: tuple[Path, ...]  # all frames, in order
    ratio: float  # readout time in frame intervals
    number: int  # number of the frame in the clip

    @property
    def key(self) -> str:
        """Suite, clip, and number of the frame."""
        return f"{self.suite}|{self.photo}|{self.number}"

    def picture(self) -> tuple[View, Motion]:
        """Returns the frame and its motion."""
        return View(Photo.open(self.clip[self.number])), _frame_motions(self.clip, self.ratio)[self.number]


@cache
def _frame_motions(clip: tuple[Path, ...], ratio: float) -> list[Motion]:
    return [found.motion for found in estimate_frames(clip, readout_ratio=ratio)]


@cache
def _network() -> SegmentNetwork:
    return SegmentNetwork(method(DEFAULT_ESTIMATOR).weights)


@cache
def _estimator(known: str) -> SegmentManhattan:
    fields = json.loads(known)
    own = method(DEFAULT_ESTIMATOR)
    return SegmentManhattan(own, own.weights, NetworkErrors.of(fields["network_errors"]), kinds_of(fields["kinds"]))


def found(posterior: Posterior, view: View, truth: Motion, answer: np.ndarray | None) -> list[Record]:
    """Returns error and features of each motion that might be undone; none if all would be declined."""
    if posterior.lines_gain < LEAST_GAIN:
        return []
    records = []
    for mode in modes_of(posterior):
        motion = view.cubic_motion(mode.motion.reshape(2, 3), DEFAULT_ESTIMATOR).motion
        records.append({"error": motion_error(motion, truth).epe, "features": features(posterior, mode, answer)})
    return records
