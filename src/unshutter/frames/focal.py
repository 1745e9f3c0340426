"""The focal length, found from a sequence: how much faster the corners of a picture move than its middle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unshutter.frames.camera import ROWS, Fit, Problem
from unshutter.frames.tracks import Tracks

_USUAL, _SPREAD = 0.85, 0.4  # of width + height, and of its logarithm: what is expected beforehand
_TRIED = _USUAL * 2.0 ** np.arange(-1.5, 4.1, 0.5)  # of width + height; the longest hardly differ from a translation
_FINE = (0.12, 0.04)  # steps of its logarithm, one after the other
_COMMON = 20.0  # tracks err together, and lenses distort: evidence counts for so much less


def usual_focal(pair: Tracks) -> float:
    """The focal length to expect of a picture [px of ROWS rows]."""
    return _USUAL * (pair.width + pair.height) * ROWS / pair.height


def focal_from_motion(pairs: Sequence[Tracks], ratio: float) -> float:
    """The focal length that explains tracks best [px of ROWS rows].

    The expectation beforehand decides where the camera turned too little to say. Cameras that move rather than turn
    come out with a very long one, as which they are described best.

    Args:
        pairs: tracks of the background from each frame to the next.
        ratio: readout time in frame intervals; a guess will do.
    """
    unit = usual_focal(pairs[0]) / _USUAL
    near: Fit | None = None

    def height(share: float) -> float:
        nonlocal near
        near = Problem(pairs, float(share * unit)).fit(ratio, near=near)
        return near.log_evidence / _COMMON - 0.5 * (np.log(share / _USUAL) / _SPREAD) ** 2

    best = _vertex(np.log(_TRIED), np.array([height(share) for share in _TRIED]))
    for step in _FINE:
        at = best + step * np.array([-1.0, 0.0, 1.0])
        best = _vertex(at, np.array([height(share) for share in np.exp(at)]))
    return float(np.exp(best) * unit)


def _vertex(at: np.ndarray, heights: np.ndarray) -> float:
    """Where the parabola through the highest of evenly spaced points and its neighbours is highest."""
    k = int(np.clip(heights.argmax(), 1, len(at) - 2))
    before, here, after = heights[k - 1 : k + 2]
    bend = before - 2 * here + after
    if bend >= 0:
        return float(at[heights.argmax()])
    return float(np.clip(at[k] + (before - after) / (2 * bend) * (at[1] - at[0]), at[k - 1], at[k + 1]))
