"""The poses of one picture of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unshutter.motion.shapes import Float64
from unshutter.orientation import ScanDirection
from unshutter.poses.colmap import ColmapPicture


@dataclass(frozen=True, eq=False)
class PicturePoses:
    """The camera's poses while a picture was read.

    Attributes:
        picture: the picture in the model, with the pose that COLMAP found.
        scan_direction: direction in which its stored pixels were read.
        lines: [N] the rows for which there are poses, from the first to the last that was read, evenly spaced, in
            stored pixels from 0; columns if the picture was read sideways.
        times_s: [N] when each was read, on the video's clock [s].
        world_to_camera: [N, 4, 4] pose of each.
        moved: whether neighbours showed how the camera moved; otherwise its position is the same for all rows.
    """

    picture: ColmapPicture
    scan_direction: ScanDirection
    lines: Float64[np.ndarray, "rows"]
    times_s: Float64[np.ndarray, "rows"]
    world_to_camera: Float64[np.ndarray, "rows 4 4"]
    moved: bool

    def at(self, share: float) -> Float64[np.ndarray, "4 4"]:
        """Returns the pose at a share of the readout: 0 the first row, 0.5 the middle, 1 the last."""
        return self.world_to_camera[round(share * (len(self.lines) - 1))]
