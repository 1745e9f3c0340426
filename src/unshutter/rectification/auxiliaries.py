"""Warps the auxiliary pictures of a photo, such as its gain map, as its pixels were."""

from __future__ import annotations

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.edges import EdgePolicy
from unshutter.motion.grid import SamplingGrid, Tile, gs_to_rs_map
from unshutter.motion.verdict import Verdict
from unshutter.motion.warp import sampled_auxiliary
from unshutter.options import Edges
from unshutter.orientation import ScanDirection
from unshutter.photo import Photo
from unshutter.photo.auxiliary_pictures import Auxiliaries


def undone_in_auxiliaries(photo: Photo, verdict: Verdict, edges: Edges, window: Tile) -> Auxiliaries | None:
    """Returns the auxiliary pictures of a result, those that can be decoded; None if there are none.

    Areas borrowed from other frames get the values at the photo's border.

    Args:
        edges: how areas that the photo does not see were handled.
        window: the part of the picture that is kept.
    """
    if photo.auxiliaries is None:
        return None
    grid = SamplingGrid.of(gs_to_rs_map(verdict.motion, verdict.upright), photo.height, photo.width)
    return sampled_auxiliaries(photo, grid, ScanDirection.TOP_TO_BOTTOM, edges, window)


def sampled_auxiliaries(
    photo: Photo, grid: SamplingGrid, scan_direction: ScanDirection, edges: Edges, window: Tile
) -> Auxiliaries | None:
    """Returns the auxiliary pictures of a result like :func:`undone_in_auxiliaries`.

    Args:
        grid: where it samples the photo, both in the readout frame of this direction.
    """
    if photo.auxiliaries is None:
        return None
    col, row = scan_direction.points_to_frame(
        np.array([window.left, window.right - 1]), np.array([window.top, window.bottom - 1]), photo.height, photo.width
    )
    in_frame = Tile(int(row.min()), int(row.max()) + 1, int(col.min()), int(col.max()) + 1)
    new_pixels = []
    for each in photo.auxiliaries.pictures:
        try:
            pixels = scan_direction.to_scan_frame(each.stored.pixels())
        except UnshutterError:  # the photo is good without it
            new_pixels.append(None)
            continue
        sampled = sampled_auxiliary(pixels, grid, in_frame, EdgePolicy(edges).black_beyond, each.is_nearest)
        new_pixels.append(np.rot90(sampled, -scan_direction.quarter_turns))
    return photo.auxiliaries.rendered(new_pixels)
