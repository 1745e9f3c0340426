"""The prior of a photo's unknowns: typical of photos in general, known for this camera, and assumed for its motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from unshutter.estimators.right_angles.beliefs import (
    MOTION,
    ROLL,
    TILT,
    UNKNOWNS,
    Beliefs,
    KnownCamera,
    MotionKind,
    SecondOpinion,
)
from unshutter.estimators.right_angles.calibration import shipped


class Prior:
    """The prior of every kind of motion, each combined with the same prior of the camera.

    Student's t around no motion and around a second opinion; Gaussians for the camera, mixtures of two for roll and
    tilt.

    Args:
        beliefs: priors for photos in general.
        known: what is known about this photo's camera.
        aspect: width / height of the picture.
        opinion: another estimate to include.
        kinds: kinds of motion.

    Attributes:
        kinds: kinds of motion.
        mean: [10] prior mean.
        sigma: [10] standard deviations of the camera (for roll and tilt, of the main part of the mixture); infinite
            for the motion, which :attr:`kinds` describe.
        log_volume: [kinds] log density of the motion at no motion, up to a constant. It makes hypotheses with motion
            comparable with one without.
    """

    def __init__(
        self,
        beliefs: Beliefs,
        known: KnownCamera,
        aspect: float,
        opinion: SecondOpinion | None = None,
        kinds: Sequence[MotionKind] = (),
    ):
        b = beliefs
        log_focal, sigma_log_focal = math.log(b.median_focal_rows * (1 + aspect) / 2), b.sigma_log_focal
        if known.log_focal is not None:
            log_focal, sigma_log_focal = known.log_focal, b.sigma_known_log_focal
        self.mean = np.array([*[0.0] * 6, known.roll or 0.0, known.tilt or 0.0, log_focal, 0.0])
        any_yaw = 1e3
        self.sigma = np.array([*[math.inf] * 6, b.sigma_roll, b.sigma_tilt, sigma_log_focal, any_yaw])
        # for roll and tilt: sigmas of the main and the rare component, share of the rare one
        measured = b.sigma_known_attitude, b.sigma_known_attitude, 0.5
        self._mixtures = {
            ROLL: measured if known.roll is not None else (b.sigma_roll, b.sigma_askew, b.askew_share),
            TILT: measured if known.tilt is not None else (b.sigma_tilt, b.sigma_steep, b.steep_share),
        }
        self._opinion = opinion
        self._of_speed = np.zeros((6, 6)) if known.speed is None else known.speed.precision
        self.kinds = tuple(kinds) or shipped().kinds
        self._precision = np.stack([kind.precision for kind in self.kinds])
        self._freedom = np.array([kind.freedom for kind in self.kinds])
        self.log_volume = np.array([self._log_volume(kind) for kind in self.kinds])

    def _log_volume(self, kind: MotionKind) -> float:
        """Returns the log volume of one kind; exact without a speed limit, or if it is much narrower than the kind."""
        precision = kind.precision * math.exp(2 * kind.log_peak / len(kind.scale)) + self._of_speed
        return 0.5 * float(np.linalg.slogdet(precision)[1])

    def expanded(
        self, unknowns: np.ndarray, kind: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the negative log prior [S], its gradient [S, 10], and a positive definite Hessian [S, 10, 10].

        The Hessian ignores how mixture weights and the trust in an opinion change with the unknowns. Normalised as far
        as it differs between the hypotheses of a photo, except for :attr:`log_volume`.

        Args:
            unknowns: [S, 10].
            kind: [S] index of each motion's kind in :attr:`kinds`; the first by default.
        """
        kind = np.zeros(len(unknowns), int) if kind is None else kind
        off = unknowns - self.mean
        precision = np.broadcast_to(1 / self.sigma**2, unknowns.shape).copy()
        scaled = off / self.sigma
        energy = np.zeros(len(unknowns))
        for k, mixture in self._mixtures.items():
            scaled[:, k] = 0
            part, precision[:, k] = two_gaussians(off[:, k], *mixture)
            energy += part
        energy += 0.5 * (scaled**2).sum(-1)
        gradient = precision * off
        hessian = precision[:, :, None] * np.eye(UNKNOWNS)
        slowed = unknowns[:, MOTION] @ self._of_speed
        energy += 0.5 * (slowed * unknowns[:, MOTION]).sum(-1)
        gradient[:, MOTION] += slowed
        hessian[:, MOTION, MOTION] += self._of_speed
        pulls = [_student_t(unknowns[:, MOTION], self._precision[kind], self._freedom[kind])]
        if self._opinion is not None:
            off, opinion = unknowns[:, MOTION] - self._opinion.motion, self._opinion
            pulls.append(_student_t(off, opinion.precision, opinion.freedom))
        for part, J_motion, H_motion in pulls:
            energy = energy + part
            gradient[:, MOTION] += J_motion
            hessian[:, MOTION, MOTION] += H_motion
        return energy, gradient, hessian

    def of_motions(self, motions: np.ndarray) -> np.ndarray:
        """Returns the negative log density of the first kind, relative to that of no motion: [M, 6] -> [M]."""
        return _student_t(motions, self._precision[0], self._freedom[0])[0]


def two_gaussians(off: np.ndarray, usual: float, rare: float, rare_share: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns E = -log sum_j share_j / sigma_j exp(-off^2 / 2 sigma_j^2) of off [...], and P in dE/doff = P off."""
    log_usual, log_rare = (
        math.log(share / sigma) - 0.5 * (off / sigma) ** 2
        for share, sigma in ((1 - rare_share, usual), (rare_share, rare))
    )
    log_both = np.logaddexp(log_usual, log_rare)
    is_usual = np.exp(log_usual - log_both)
    return -log_both, is_usual / usual**2 + (1 - is_usual) / rare**2


def _student_t(
    off: np.ndarray, precision: np.ndarray, freedom: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns E = (nu + 6) / 2 log(1 + off^T P off / nu) of off [S, 6], dE/doff = t P off, and t P.

    Here t = (nu + 6) / (nu + off^T P off) is the trust, P is [6, 6] or [S, 6, 6], nu a number or [S].
    """
    dimensions = off.shape[1]
    pulled = (precision @ off[..., None])[..., 0]
    distance2 = (pulled * off).sum(-1)
    trust = (freedom + dimensions) / (freedom + distance2)
    energy = 0.5 * (freedom + dimensions) * np.log1p(distance2 / freedom)
    return energy, trust[:, None] * pulled, trust[:, None, None] * precision
