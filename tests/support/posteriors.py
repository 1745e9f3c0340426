"""Posteriors as the search finds them, made up."""

import numpy as np

from unshutter.single.search import Optima, Posterior


def posterior_of(motion: np.ndarray, evidence: float, sigma: float = 0.004, lines_gain: float = 1.0) -> Posterior:
    """Of many segments all over the picture that say much the same; its camera was held nearly upright.

    Args:
        motion: [6] the mean.
        evidence: for motion against none [nats].
        sigma: standard deviation of every coefficient.
        lines_gain: of the segments against chance.
    """
    return Posterior(
        motion=motion,
        covariance=np.eye(6) * sigma**2,
        optima=Optima(motion[None], np.eye(6)[None] * sigma**2, np.zeros(1, int), np.ones(1)),
        kinds={"quadratic": 0.2, "hand": 0.6, "pan": 0.2},
        evidence_of=dict.fromkeys(("quadratic", "hand", "pan"), evidence),
        evidence=evidence,
        lines_gain=lines_gain,
        weight=60.0,
        gain_at_rest=lines_gain - 0.1,
        breadth=3 * np.tanh(evidence / 20),
        against=0.05 if evidence > 0 else 0.6,
        in_favour=0.6 if evidence > 0 else 0.4,
        pose=np.array([0.01, 0.1, 0.0, 0.0]),
        pose_at_rest=np.array([0.01, 0.1, 0.0, 0.0]),
    )
