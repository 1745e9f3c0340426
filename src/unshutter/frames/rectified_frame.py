"""RectifiedFrame: a photo as its neighbours in time say that a global shutter would have taken it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from unshutter.motion import Motion
from unshutter.motion.verdict import Verdict
from unshutter.options import Edges
from unshutter.photo import Photo
from unshutter.result import Rectified, Result

Model = Literal["camera", "dense", "alone"]


@dataclass(frozen=True)
class RectifiedFrame(Result):
    """A photo rectified with the help of its neighbours.

    Attributes:
        photo: the new pixels with the metadata of the original.
        valid: bool [H, W], where the original (with ``borrow``: or a neighbour) shows what belongs there, before any
            crop or fill.
        original: the photo as it was read.
        verdict: whether its pixels were changed, and why not.
        edges: ``keep``, ``crop``, ``fill`` or ``borrow``: what was done about places that the photo did not see.
        whole: share of the photo's area that a crop leaves; None where no crop was looked for.
        model: how its motion was described: ``camera`` (one motion for the whole picture), ``dense`` (near and far
            move differently), or ``alone`` (neighbours said nothing, and what the photo itself says was asked for).
        motion: what was undone; None where it is dense, and so no motion of the camera alone.
    """

    photo: Photo
    valid: np.ndarray
    original: Photo
    verdict: Verdict
    edges: Edges = "keep"
    whole: float | None = None
    model: Model = "dense"
    motion: Motion | None = None

    @classmethod
    def of(cls, result: Rectified, model: Model) -> RectifiedFrame:
        """What became of a photo by one motion for the whole picture."""
        return cls(
            result.photo,
            result.valid,
            result.original,
            result.verdict,
            result.edges,
            result.whole,
            model,
            result.motion,
        )
