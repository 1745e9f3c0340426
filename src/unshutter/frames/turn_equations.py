"""Linear equations for the displacement of tracks by a spline of rotations, and their weighted normal equations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Bool, Float64

DEGREES = 3.0  # degrees of freedom of Student's t, the model of the tracks' errors
_FINEST = 0.02  # px; lower limit of the tracks' noise


@dataclass(frozen=True, eq=False)
class TurnEquations:
    """For each track: moved = jacobian @ (spline @ coefficients).

    The product of both factors is six times as large as the two together, and is never formed.

    Attributes:
        spline: difference of each spline, among those that a pair's times overlap, between a track's two ends.
        jacobian: displacement of a track per unknown.
        moved: measured displacement [px].
    """

    spline: Float64[np.ndarray, "pairs most local"]
    jacobian: Float64[np.ndarray, "pairs most 2 unknowns"]
    moved: Float64[np.ndarray, "pairs most 2"]

    def squared(self, coefficients: Float64[np.ndarray, "pairs local unknowns"]) -> Float64[np.ndarray, "pairs most"]:
        """Squared distance of each track's end from its predicted position [px^2]."""
        turned = self.spline @ coefficients
        left = self.moved - (self.jacobian @ turned[..., None])[..., 0]
        return (left**2).sum(axis=-1)

    def normal(
        self, weights: Float64[np.ndarray, "pairs most"]
    ) -> tuple[Float64[np.ndarray, "pairs n n"], Float64[np.ndarray, "pairs n"]]:
        """Returns each pair's normal equations for its coefficients, spline by spline: matrix and right-hand side."""
        pairs, _, local = self.spline.shape
        unknowns = self.jacobian.shape[-1]
        first, second = np.triu_indices(local)
        half = self._spline_products @ (self._jacobian_products * weights[..., None])
        blocks = np.empty((pairs, local, unknowns, local, unknowns))
        half = half.reshape(pairs, -1, unknowns, unknowns).swapaxes(0, 1)
        blocks[:, first, :, second], blocks[:, second, :, first] = half, half
        right = self.spline.swapaxes(1, 2) @ (self._moved_products * weights[..., None])
        return blocks.reshape(pairs, local * unknowns, -1), right.reshape(pairs, -1)

    @cached_property
    def _spline_products(self) -> np.ndarray:
        """[pairs, local (local + 1) / 2, most] products of every two splines."""
        first, second = np.triu_indices(self.spline.shape[-1])
        each = np.ascontiguousarray(self.spline.swapaxes(1, 2))
        return each[:, first] * each[:, second]

    @cached_property
    def _jacobian_products(self) -> np.ndarray:
        """[pairs, most, unknowns^2] J^T J of each track."""
        products = self.jacobian.swapaxes(2, 3) @ self.jacobian
        return products.reshape(*products.shape[:2], -1)

    @cached_property
    def _moved_products(self) -> np.ndarray:
        """[pairs, most, unknowns] J^T moved of each track."""
        return (self.jacobian * self.moved[..., None]).sum(axis=2)


def student_weights(
    squared: Float64[np.ndarray, "pairs most"], used: Bool[np.ndarray, "pairs most"], noise: float
) -> tuple[Float64[np.ndarray, "pairs most"], float]:
    """Returns weights of the tracks under Student's t, which limits the influence of outliers, and their noise [px].

    Args:
        squared: squared distance of each track's end from its expected position [px^2].
        used: which entries of the padded arrays hold a track; the others get zero weight.
        noise: current estimate [px]; NaN for none.
    """
    known = squared[used]
    noise = np.sqrt(np.median(known) / 1.4) if np.isnan(noise) else noise
    for _ in range(3):
        noise = max(noise, _FINEST)
        share = (DEGREES + 2) / (DEGREES + known / noise**2)
        noise = np.sqrt((share * known).mean() / 2)
    noise = max(noise, _FINEST)
    return used * (DEGREES + 2) / (DEGREES + squared / noise**2) / noise**2, noise
