"""Calibration shared by all photos: the network's errors, the odds of motion, and the accuracy of answers.

``unshutter calibrate`` (unshutter-lab) measures it and writes weights/calibration.json, which names its data.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from unshutter.estimators.right_angles.beliefs import NORMAL, MotionKind

_SHIPPED = Path(__file__).parents[2] / "weights" / "calibration.json"


@dataclass(frozen=True)
class NetworkErrors:
    """Errors of the network's six coefficients (t_x [rows], then r_z [rad]): Student's t distribution.

    Attributes:
        freedom: degrees of freedom; the fewer, the more often errors are large.
        scales: [6] scales of the distribution.
        correlations: [6, 6] between the coefficients.
        usual_px: size of the estimate [px of 256 rows] at which squared errors are twice those of small estimates.
    """

    freedom: float
    scales: np.ndarray
    correlations: np.ndarray
    usual_px: float

    @classmethod
    def of(cls, fields: dict[str, Any]) -> NetworkErrors:
        """Reads the errors from the fields of a file."""
        scales, correlations = np.array(fields["scales"]), np.array(fields["correlations"])
        return cls(fields["freedom"], scales, correlations, fields["usual_px"])

    def precision(self, size_px: float) -> np.ndarray:
        """[6, 6] inverse of the scale matrix.

        Args:
            size_px: root mean square displacement of the network's estimate [px of 256 rows].
        """
        scale = self.correlations * np.outer(self.scales, self.scales)
        return np.linalg.inv(scale) / (1 + (size_px / self.usual_px) ** 2)


@dataclass(frozen=True)
class Forest:
    """Gradient-boosted decision trees of equal size. The values of their leaves add up to log odds.

    Attributes:
        features: names of the figures tested by nodes.
        baseline: constant to which the leaves' values are added.
        depth: steps from a root to its farthest leaf.
        feature, threshold, left, right, value: [trees, nodes]: a node leads to ``left`` if its figure is at most the
            threshold, otherwise to ``right``; a leaf leads to itself and has a value.
    """

    features: tuple[str, ...]
    baseline: float
    depth: int
    feature: np.ndarray
    threshold: np.ndarray
    left: np.ndarray
    right: np.ndarray
    value: np.ndarray

    def odds(self, figures: dict[str, float]) -> float:
        """Returns the log odds that undoing the motion is better than leaving it."""
        asked = np.array([figures[name] for name in self.features])
        tree, node = np.arange(len(self.value)), np.zeros(len(self.value), int)
        for _ in range(self.depth):
            below = asked[self.feature[tree, node]] <= self.threshold[tree, node]
            node = np.where(below, self.left[tree, node], self.right[tree, node])
        return self.baseline + float(self.value[tree, node].sum())

    @classmethod
    def of(cls, fields: dict[str, Any]) -> Forest:
        """Reads the forest from the fields of a file."""
        arrays = {name: np.array(fields[name]) for name in ("feature", "threshold", "left", "right", "value")}
        return cls(tuple(fields["features"]), fields["baseline"], fields["depth"], **arrays)


@dataclass(frozen=True)
class Regression:
    """A logistic regression.

    Attributes:
        constant: log odds if all figures are 0.
        slopes: name of a figure -> change of the log odds per unit of it.
    """

    constant: float
    slopes: dict[str, float]

    def log_odds(self, figures: dict[str, float]) -> float:
        """Returns the log odds.

        Args:
            figures: at least those of the slopes.
        """
        return self.constant + sum(slope * figures[name] for name, slope in self.slopes.items())


@dataclass(frozen=True)
class Calibration:
    """All parts of the default method other than its network.

    Attributes:
        kinds: kinds of motion and their priors.
        network_errors: error distribution of the network's estimate.
        forest: odds that there was motion, if the network was run.
        odds_without_network: odds that there was motion, if it was not.
        confidence: for photos that are rectified and those left unchanged, with the network's estimate and without:
            "rectified", "left", "rectified without network", "left without network" -> log odds that the error is below
            1 px of 256 rows or a tenth of the motion.
    """

    kinds: tuple[MotionKind, ...]
    network_errors: NetworkErrors
    forest: Forest
    odds_without_network: Regression
    confidence: dict[str, Regression]

    @classmethod
    def read(cls, path: Path) -> Calibration:
        """Reads a calibration file written by ``unshutter calibrate``."""
        fields = json.loads(path.read_text(encoding="utf-8"))
        return cls(
            kinds_of(fields["kinds"]),
            NetworkErrors.of(fields["network_errors"]),
            Forest.of(fields["forest"]),
            Regression(**fields["odds_without_network"]),
            {name: Regression(**each) for name, each in fields["confidence"].items()},
        )


def kinds_of(fields: dict[str, Any]) -> tuple[MotionKind, ...]:
    """Reads the kinds of motion from the fields of a file."""
    return tuple(
        MotionKind(
            name,
            np.array(each["correlations"]) * np.outer(each["scales"], each["scales"]),
            each["freedom"] or NORMAL,
            each["share"],
        )
        for name, each in fields.items()
    )


@cache
def shipped() -> Calibration:
    """Returns the calibration that comes with unshutter."""
    return Calibration.read(_SHIPPED)
