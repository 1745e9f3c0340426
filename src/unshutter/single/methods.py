"""The methods that estimate a single photo's motion, and the choice among their answers."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import replace
from pathlib import Path

import numpy as np

from unshutter.motion.finding import Candidate, Finding, list_single
from unshutter.motion.upright import Pose
from unshutter.motion.verdict import Certainty
from unshutter.reasons import Code, Reason
from unshutter.single import Method
from unshutter.single.borders import has_border
from unshutter.single.candidates import LEAST_GAIN, candidates_by_smear, candidates_of
from unshutter.single.estimator import Estimator, View
from unshutter.single.likelihood import (
    MOST_SEGMENTS,
    SHORT_SIDE,
    STARTS,
    ManhattanLikelihood,
    find_segments,
    in_rows,
    likelihood_of,
    segments_of,
    unusable,
)
from unshutter.single.network import SegmentNetwork
from unshutter.single.prior import MotionKind, NetworkErrors, NetworkObservation, PriorParams, shipped
from unshutter.single.register import method as method_named
from unshutter.single.roll import roll_error
from unshutter.single.row_network import RowNetwork, motion_in_grey
from unshutter.single.search import PX, Posterior, cameras_for, displacement, explore


class DoNothing(Estimator):
    """none: leaves photos unchanged, the baseline of every table."""

    def estimate(self, view: View) -> Finding:
        """Returns zero motion."""
        return view.no_motion(self.name, Reason(Code.ASKED_FOR_NOTHING))


def find_candidates(estimator: Estimator, view: View, insisted: bool = False) -> tuple[Candidate, ...]:
    """Returns the possible motions of a photo, the best one first, including no change.

    A camera that exposes all rows at once, as its name in the metadata tells, leaves none, whatever the pixels show;
    without an exposure time in the metadata, though, a user may take one. Other motions that would have blurred the
    photo more than it is are dropped; if this removes the first one, it is replaced by zero motion with the reason. So
    it is where a wide lens bends lines, unless a focal length is stated.

    Args:
        insisted: whether the user asks for a motion all the same, and so takes one.
    """
    candidates = estimator.candidates(view)
    at_once = view.read_at_once()
    if at_once is not None and not (insisted and view.exposure_s() is None):
        held = candidates[0].finding.held_at_rest
        none = replace(view.no_motion(estimator.name, at_once), held=held, held_at_rest=held)
        others = [each for each in candidates if not each.motion.is_zero] if view.exposure_s() is None else []
        candidates = (Candidate("still", none, orientation=view.photo.orientation), *others)
    if not candidates[0].motion.is_zero and view.camera.focal_px is None and view.photo.bends_lines():
        none = Candidate("still", view.no_motion(estimator.name, Reason(Code.WIDE_LENS)))
        candidates = (none, *(each for each in candidates if each.kind != "still"))
    limit = None if all(each.motion.is_zero for each in candidates) else view.speed_limit
    if limit is not None:
        possible = tuple(each for each in candidates if each.motion.is_zero or not limit.refutes(each.motion))
        if candidates[0] not in possible:
            none = Candidate("still", view.no_motion(estimator.name, limit.reason))
            possible = (none, *(each for each in possible if each.kind != "still"))
        candidates = possible
    return tuple(replace(each, finding=view.noted(each.finding)) for each in candidates)


_Modes = tuple[tuple[Candidate, ...], Posterior]


class _RightAngles(Estimator):
    """Finds the posterior of the motion under the Manhattan likelihood (likelihood.py, search.py)."""

    def estimate(self, view: View) -> Finding:
        """Returns cubic t_x and r_z; zero motion with a reason if there are too few segments."""
        return self.candidates(view)[0].finding

    def candidates(self, view: View) -> tuple[Candidate, ...]:
        """Returns the modes of the posterior; zero motion with a reason with a border, or too few segments."""
        grey = view.grey(SHORT_SIDE)
        segments, size = segments_of(view, grey)
        reason = Reason(Code.BORDER) if has_border(grey) else unusable(segments, view.height, view.width)
        if reason:
            return list_single(view.no_motion(self.name, reason), view.photo.orientation)
        candidates, posterior = self._modes(view, segments, size, grey)
        return _with_poses(candidates, posterior, likelihood_of(view, segments, size, params=_HELD_ASKEW), view)

    @abstractmethod
    def _modes(self, view: View, segments: np.ndarray, size: tuple[int, int], grey: np.ndarray) -> _Modes: ...


_HELD_ASKEW = PriorParams(sigma_roll=math.radians(3), sigma_askew=math.radians(6))  # of photos that are to be turned


def _with_poses(
    candidates: tuple[Candidate, ...], posterior: Posterior, likelihood: ManhattanLikelihood, view: View
) -> tuple[Candidate, ...]:
    """Returns the candidates with how the camera was held: at rest, and given the motion of each.

    None where the lines, seen like this, are not those of buildings, and so do not show it.
    """
    motions = np.array([np.zeros(6), *(view.cubic_of(each.motion) for each in candidates)])
    near = [posterior.pose if motion.any() else posterior.pose_at_rest for motion in motions]
    cameras = cameras_for(likelihood, motions, near)
    at_rest, *poses = (
        Pose(-math.degrees(roll), math.degrees(tilt), math.exp(log_focal), view.up)
        for roll, tilt, log_focal, _ in cameras.tolist()
    )
    if posterior.gain_at_rest >= LEAST_GAIN:
        error = roll_error(likelihood, cameras[0])
        at_rest = replace(at_rest, roll_error_deg=None if error is None else math.degrees(error))
    else:
        at_rest = None
    held = []
    for each, pose in zip(candidates, poses, strict=True):
        moving = pose if posterior.lines_gain >= LEAST_GAIN else None
        now = at_rest if each.motion.is_zero else moving
        held.append(replace(each, finding=replace(each.finding, held=now, held_at_rest=at_rest)))
    return tuple(held)


class Manhattan(_RightAngles):
    """manhattan: the motion, camera and focal length that make line segments straight and square; no learning."""

    def _modes(self, view: View, segments: np.ndarray, size: tuple[int, int], grey: np.ndarray) -> _Modes:
        posterior = explore(likelihood_of(view, segments, size), STARTS)
        return candidates_of(posterior, view, self.name), posterior


class _WithNetwork(Estimator):
    """Has the network (network.py)."""

    def __init__(self, method: Method, weights: Path | None = None):
        super().__init__(method, weights)
        self._network = SegmentNetwork(weights)

    def prepare(self) -> None:
        """Opens the network."""
        self._network.open()


# weight of the motion that kandula2020 sees if it is the same; displacement [rows] that counts as none beside it
_MOST_SECONDED, _FAINT = 0.4, 0.5 / PX
_SEEN_TILTS = (-15.0, 50.0)  # degrees: range of the network's training data


class SegmentManhattan(_WithNetwork, _RightAngles):
    """segment-manhattan: the posterior mean, including the network's estimate as an observation.

    The network estimates curvature well and shear poorly; right angles, if present, determine the shear. Its estimate
    therefore enters the likelihood as one more observation, with the covariance of its errors. Of a motion that is to
    be undone, a network that sees pixels (kandula2020) is asked, too.
    """

    def __init__(
        self,
        method: Method,
        weights: Path | None = None,
        errors: NetworkErrors | None = None,
        kinds: tuple[MotionKind, ...] = (),
    ):
        super().__init__(method, weights)
        pixels = method_named("kandula2020")
        self._pixels = RowNetwork(pixels.name, pixels.weights)
        self._errors = errors or shipped().network_errors
        self.kinds = kinds or shipped().kinds

    def _modes(self, view: View, segments: np.ndarray, size: tuple[int, int], grey: np.ndarray) -> _Modes:
        _, tilt = view.attitude_deg()
        if tilt is not None and not _SEEN_TILTS[0] <= tilt <= _SEEN_TILTS[1]:
            posterior = explore(likelihood_of(view, segments, size, kinds=self.kinds), STARTS)
            return candidates_of(posterior, view, self.name), posterior
        posterior, answer = self.weigh(view, segments, size)
        by_smear = candidates_by_smear(posterior, view, self.name)
        return by_smear or self._seconded(candidates_of(posterior, view, self.name, answer), view, grey), posterior

    def _seconded(self, candidates: tuple[Candidate, ...], view: View, grey: np.ndarray) -> tuple[Candidate, ...]:
        """Returns the candidates, the motion to undo drawn towards that which kandula2020 sees in the pixels.

        The errors of the two are hardly related, least of all in the shear. The farther apart they are, the less the
        motion is changed. It stays where it is sure or the roll is known, and in pictures that are not upright, as
        none was in training.
        """
        first, *others = candidates
        is_sure = Certainty.of(first.finding.confidence or 0.0) is Certainty.SURE
        if first.motion.is_zero or is_sure or view.attitude_deg()[0] is not None or view.up != (0, -1):
            return candidates
        found, seen = view.cubic_of(first.motion), view.cubic_of(motion_in_grey(self._pixels, view, grey))
        distance = displacement(seen - found) / (displacement(found) / 2 + _FAINT)
        weight = _MOST_SECONDED / (1 + distance**2)
        motion = view.cubic_motion((found + weight * (seen - found)).reshape(2, 3), self.name).motion
        return (replace(first, finding=replace(first.finding, motion=motion)), *others)

    def weigh(self, view: View, segments: np.ndarray, size: tuple[int, int]) -> tuple[Posterior, np.ndarray]:
        """Returns the posterior including the network's estimate, and that estimate: [6] coefficients."""
        answer = self._network.coefficients(segments, view.up).ravel()
        precision = self._errors.precision(PX * displacement(answer))
        observation = NetworkObservation(answer, precision, self._errors.freedom)
        towards = [view.heading * STARTS[0]] if view.heading else []
        return explore(likelihood_of(view, segments, size, observation, self.kinds), [answer, *towards]), answer


_NETWORK_SIDE = 512  # of the grey copy in which segments are detected [px]


class SegmentTransformer(_WithNetwork):
    """segment-transformer: the answer of the network (network.py) on the line segments of a photo."""

    def estimate(self, view: View) -> Finding:
        """Returns cubic t_x and r_z; zero motion with a reason if there are too few segments."""
        grey = view.grey(_NETWORK_SIDE)
        segments = find_segments(grey, MOST_SEGMENTS)
        reason = unusable(segments, view.height, view.width)
        if reason:
            return view.no_motion(self.name, reason)
        coefficients = self._network.coefficients(in_rows(segments, *grey.shape), view.up)
        return view.cubic_motion(coefficients, self.name)
