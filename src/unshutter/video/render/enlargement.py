"""The enlargement of a clip: one for all its frames, so that none shows its border once its motion is undone.

It is part of the one resampling: views of the frames are narrower. Frames in which little is missing need none; the
border is repeated there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from unshutter.orientation import ScanDirection
from unshutter.reasons import JsonObject
from unshutter.video.render.views import SteadyView, StraightView, View, depths, outline

if TYPE_CHECKING:
    from unshutter.video.render.stabilisation import CameraPath

LARGEST = 1.05  # enlargement
NEGLIGIBLE = 0.01  # share of a frame's width that may be missing without an enlargement
_HALVINGS = 12
_LEAST_PX = 1.0  # smaller gaps are not mentioned


@dataclass(frozen=True)
class Enlargement:
    """The enlargement of all frames of a clip, and what remains missing."""

    zoom: float  # enlargement, 1 to :data:`LARGEST`
    missing_px: float  # the most that is still missing at a side of a frame [px]
    frames: int  # number of frames in which a pixel or more is missing
    scan_direction: ScanDirection  # direction in which the stored pixels were read

    @classmethod
    def least(cls, path: CameraPath, height: int, width: int, straight: StraightView | None = None) -> Enlargement:
        """Returns the least enlargement that is necessary for frames of height x width [px].

        Args:
            straight: the view to enlarge, if it is not the camera's own.
        """
        rows = path.scan_direction.frame_size(height, width)[0]
        borders = np.array(path.borders).reshape(-1, 4, 9)
        x, y, side = outline(path.aspect)

        def missing(zoom: float) -> np.ndarray:  # [frames] the most at any side [px]
            seen = (x / zoom, y / zoom) if straight is None else straight.enlarged(zoom).seen(x, y)
            return -depths(borders, *seen, side, path.aspect).min(axis=1, initial=0.0) * rows

        zoom = 1.0
        if missing(zoom).max(initial=0.0) > NEGLIGIBLE * width:
            low, zoom = zoom, LARGEST
            for _ in range(_HALVINGS if not missing(zoom).any() else 0):
                middle = (low + zoom) / 2
                low, zoom = (middle, zoom) if missing(middle).any() else (low, middle)
        left = missing(zoom)
        return cls(zoom, float(left.max(initial=0.0)), int((left >= _LEAST_PX).sum()), path.scan_direction)

    def of(self, view: View | None) -> View | None:
        """Returns the enlarged view; None for the camera's own."""
        if self.zoom == 1.0:
            return view
        if isinstance(view, StraightView):
            return view.enlarged(self.zoom)
        if view is None:
            return SteadyView(np.zeros(3), 1.0, self.zoom, self.scan_direction)
        return replace(view, zoom=self.zoom)

    def as_json(self) -> JsonObject:
        """Returns the record for a log of runs."""
        return {"zoom": self.zoom, "missing_px": self.missing_px, "frames_missing": self.frames}
