"""Fits the rotation of the camera during a photo's readout to the photo's points matched in the frames of its film.

The film's frames give the camera's rotation T(t) over time (frames/camera.py). A point of the photo at x, in row y
(0 ... 1), and at x' in frame k shows the rotation Q(y) of that row against the film:

    x' - x = J (T(t of its row in frame k) - Q(y)) + g x + (p . x) x + r |x|^2 x

where J is the Jacobian of a rotation, g the remaining scale, p the effect of moving towards a slanted surface, and r
the difference between two lens corrections. Q is modelled as a parabola: q0 + q1 (y - 1/2) + q2 ((y - 1/2)^2 - 1/12).
All unknowns are linear. The change of Q from row to row is the photo's motion; neither the photo's readout time nor
the time at which it was taken is needed.

Both serve as a check, though. If the film was not stabilised, its centre is that of the sensor, so q0 lies on the path
T, and q1 equals the rate of T there times a plausible readout time. A stabilised film follows a path of its own and
fails this check.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unshutter.frames.camera import ROWS, Fit, turn_jacobian
from unshutter.motion_photo.registration import Matches

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64

_ROUNDS = 6
_DEGREES = 3.0  # degrees of freedom of Student's t
_FINEST = 0.05  # px of ROWS rows; lower limit of the matches' noise
_CURVATURE = 0.25  # px of ROWS rows: prior standard deviation of q2
_COMMON = 4.0  # errors of matches are correlated
_TURNS = 9  # unknowns of q0, q1, q2; followed by those of scale, slant and lens


@dataclass(frozen=True, eq=False)
class Frames:
    """The camera's rotation as estimated from a film.

    Attributes:
        fit: the camera's rotation over time.
        times: times of the frames in the fit [frame intervals].
        ratio: readout time of a frame, in frame intervals.
        height, width: size of the frames' copies [px].
    """

    fit: Fit
    times: Float64[np.ndarray, "frames"]
    ratio: float
    height: int
    width: int

    def path(self, at: Float64[np.ndarray, "*times"]) -> Float64[np.ndarray, "*times 3"]:
        """Rotation at given times, as shifts in the picture [px of ROWS rows; about z: at the focal length]."""
        return self.fit.turn(at) * self.fit.focal_px


@dataclass(frozen=True, eq=False)
class StillFit:
    """The fitted rotation of a photo's rows.

    Attributes:
        turn: [3, 3] q0, q1, q2 about three axes [px of ROWS rows of the film].
        error: [3, 3] their standard deviations.
        noise_px: noise of the matches [px of ROWS rows].
        matches: number of matches.
    """

    turn: Float64[np.ndarray, "3 3"]
    error: Float64[np.ndarray, "3 3"]
    noise_px: float
    matches: int

    def rotation(self, row: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3"]:
        """Returns the rotation of rows, 0 ... 1, relative to the first [px of ROWS rows of the film]."""
        centred = row - 0.5
        moved = centred[:, None] * self.turn[1] + (centred**2)[:, None] * self.turn[2]
        first = -0.5 * self.turn[1] + 0.25 * self.turn[2]
        return moved - first


def fit_still(film: Frames, found: Mapping[int, Matches], height: float) -> StillFit:
    """Fits the rotation of a photo's rows.

    Args:
        film: the camera's rotation, from the film.
        found: frame -> points of the photo matched in it.
        height: rows of the photo [px of the film's copies, at its scale].
    """
    unit = ROWS / film.height
    parts = [_equations(film, k, each, height, unit) for k, each in found.items()]
    design, moved = zip(*parts, strict=True)
    A, b = np.concatenate(design), np.concatenate(moved)
    prior = np.zeros(A.shape[-1])
    prior[6:9] = _CURVATURE**-2.0
    weights, noise, unknowns, covariance = np.ones(len(b)), np.nan, np.zeros(A.shape[-1]), np.eye(A.shape[-1])
    for _ in range(_ROUNDS):
        normal = np.einsum("n,nik,nil->kl", weights, A, A) + np.diag(prior) * (noise**2 if np.isfinite(noise) else 1e-3)
        unknowns = np.linalg.solve(normal, np.einsum("n,nik,ni->k", weights, A, b))
        squared = ((b - A @ unknowns) ** 2).sum(axis=1)
        noise = np.sqrt(np.median(squared) / 1.4) if np.isnan(noise) else noise
        share = (_DEGREES + 2) / (_DEGREES + squared / noise**2)
        noise = max(float(np.sqrt((share * squared).mean() / 2)), _FINEST)
        weights = (_DEGREES + 2) / (_DEGREES + squared / noise**2)
        covariance = np.linalg.inv(normal) * noise**2 * _COMMON
    error = np.sqrt(np.diag(covariance)[:_TURNS]).reshape(3, 3)
    return StillFit(unknowns[:_TURNS].reshape(3, 3), error, noise, len(b))


def _equations(film: Frames, frame: int, found: Matches, height: float, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """[N, 2, unknowns] and [N, 2]: linear equations for the matches in a frame [px of ROWS rows]."""
    start, end = found.photo * unit, found.frame * unit
    focal, middle = film.fit.focal_px, np.array([film.width * unit, ROWS]) / 2
    J = turn_jacobian((start + end) / 2 + middle, film.width * unit, focal)
    row = np.clip(0.5 + end[:, 1] / ROWS, 0, 1)
    seen = film.path(film.times[frame] + film.ratio * row)
    moved = end - start - np.einsum("nij,nj->ni", J[..., :3], seen)
    centred = found.photo[:, 1] / height  # y - 1/2
    shape = np.stack([np.ones_like(centred), centred, centred**2 - 1 / 12], axis=-1)  # [N, 3]
    turns = -(shape[:, None, :, None] * J[:, :, None, :3]).reshape(len(start), 2, _TURNS)
    at = start / (ROWS / 2)
    others = [at, at * at[:, :1], at * at[:, 1:], at * (at**2).sum(axis=1, keepdims=True)]
    return np.concatenate([turns, np.stack(others, axis=-1)], axis=-1), moved
