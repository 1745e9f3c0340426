"""RectifiedFrame: a photo as its neighbours in time say that a global shutter would have taken it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from unshutter.motion import Motion
from unshutter.motion.verdict import Verdict
from unshutter.options import Edges, PictureFormat, Save, Subsampling
from unshutter.photo import Photo
from unshutter.photo.encoding import Encoded
from unshutter.result import Rectified, encode_result, save_result

Model = Literal["camera", "dense", "alone"]


@dataclass(frozen=True)
class RectifiedFrame:
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

    @property
    def changed(self) -> bool:
        """Whether anything was undone; if not, :attr:`reason` says why."""
        return self.verdict.changes

    @property
    def reason(self) -> str:
        """Why the photo was left as it is; empty where it was changed."""
        return self.verdict.reason

    @property
    def pixels(self) -> np.ndarray:
        """The stored pixels [H, W, bands] (bands is 1 for grey), uint8 or uint16, not to be written to."""
        return self.photo.pixels

    def to_array(self) -> np.ndarray:
        """A copy of the stored pixels, [H, W] or [H, W, bands], uint8 or uint16."""
        return self.photo.to_array()

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = False,
        quality: int | None = None,
        subsampling: Subsampling | None = None,
        keep_times: bool = False,
    ) -> tuple[str, ...]:
        """Writes the picture; a photo that was left as it is is copied byte for byte. See :meth:`Photo.save`."""
        return save_result(
            self.photo, self.original, Path(path), overwrite, Save(None, quality, subsampling, keep_times)
        )

    def encode(
        self, format: PictureFormat | None = None, quality: int | None = None, subsampling: Subsampling | None = None
    ) -> Encoded:
        """The picture as an encoded file, and what of its metadata did not go in; see :meth:`Photo.to_bytes`."""
        return encode_result(self.photo, Save(format, quality, subsampling))

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
