"""Fills areas that a frame does not show from its neighbours, by the motion of the camera.

Each neighbour is sampled once, at the positions where its rows saw what the picture shows; where both saw the scene,
the frame's own pixels are left unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.frame_motion import FrameMotion
from unshutter.motion import Motion
from unshutter.motion.edges import HAIRLINE
from unshutter.motion.grid import SamplingGrid, gs_to_rs_map
from unshutter.motion.shapes import Bool, UInt
from unshutter.motion.warp import sampled_pixels, seen_mask, straighten
from unshutter.photo import Photo


def borrow(
    photo: Photo, motion: Motion, camera: FrameMotion, neighbours: Mapping[int, UInt[np.ndarray, "height width bands"]]
) -> (
    tuple[UInt[np.ndarray, "height width bands"], Bool[np.ndarray, "height width"], Bool[np.ndarray, "height width"]]
    | None
):
    """Undoes a photo's motion and takes what it did not see from its neighbours.

    Args:
        motion: the motion to undo, that of ``camera`` at its reference row.
        neighbours: -1 and 1 -> the stored pixels of the frames before and after, with the photo's size and type.

    Returns:
        The stored pixels, uncropped, 0 where no frame saw anything; the mask of those that any frame saw; and that of
        those that the photo saw. None if nothing is missing, or no neighbour has any of it.
    """
    grid = SamplingGrid.of(gs_to_rs_map(motion), photo.height, photo.width)
    own = seen_mask(grid, HAIRLINE)
    if own.all():
        return None
    seen = own.copy()
    pixels = straighten(photo.pixels, motion, "keep", photo.masked)[0]
    for side, theirs in neighbours.items():
        try:
            position = gs_to_rs_map(camera.as_seen_from(side, motion.reference))
        except UnshutterError:  # it turned too far, or too fast
            continue
        grid = SamplingGrid.of(position, photo.height, photo.width)
        new = seen_mask(grid) & ~seen
        if new.any():
            np.copyto(pixels, sampled_pixels(theirs, grid, masked=photo.masked), where=new[..., None])
            seen |= new
    return None if np.array_equal(seen, own) else (pixels, seen, own)
