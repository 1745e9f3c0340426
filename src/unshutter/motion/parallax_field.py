"""Displacement that depth adds to a rotation during a readout, on a coarse grid of the picture, bilinear between nodes.

The nodes are spread evenly from border to border of the picture, row by row.
"""

from __future__ import annotations

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.motion_file import read_only
from unshutter.motion.shapes import Float64

NODES = (7, 9)  # rows and columns of nodes
_MOST = 0.1  # of the height: farther than a frame of a clip moves during its readout


def checked_parallax(parallax: np.ndarray, height: int) -> Float64[np.ndarray, "nodes 2"]:
    """Returns displacements [px] for a picture of this height, read-only; raises UnshutterError if they are none."""
    parallax = read_only(parallax)
    if parallax.shape != (NODES[0] * NODES[1], 2) or not np.isfinite(parallax).all():
        raise UnshutterError(f"parallax needs a displacement for each of {NODES[0] * NODES[1]} places")
    if np.abs(parallax).max() > _MOST * height + 1:
        raise UnshutterError("the parallax moves the picture by more than a tenth of its height")
    return parallax


def node_weights(
    across: Float64[np.ndarray, "*at"], down: Float64[np.ndarray, "*at"]
) -> Float64[np.ndarray, "*at nodes"]:
    """Returns the weights of the nodes at places of the picture, given as shares of its width and height."""
    by_column, by_row = (_hats(share, nodes) for share, nodes in ((across, NODES[1]), (down, NODES[0])))
    both = by_row[..., :, None] * by_column[..., None, :]
    return both.reshape(*both.shape[:-2], -1)


def between_nodes(
    parallax: Float64[np.ndarray, "nodes 2"], across: Float64[np.ndarray, "*at"], down: Float64[np.ndarray, "*at"]
) -> Float64[np.ndarray, "*at 2"]:
    """Returns the displacement at places of the picture, given as shares of its width and height."""
    grid = parallax.reshape(*NODES, 2)
    row, below = _before(down, NODES[0])
    col, beside = _before(across, NODES[1])
    above = grid[row, col] + beside[..., None] * (grid[row, col + 1] - grid[row, col])
    under = grid[row + 1, col] + beside[..., None] * (grid[row + 1, col + 1] - grid[row + 1, col])
    return above + below[..., None] * (under - above)


def _before(share: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the node before each place along one side, and how far behind it the place is [node intervals]."""
    place = np.clip(np.nan_to_num(share), 0.0, 1.0) * (nodes - 1)
    node = np.minimum(place.astype(np.int64), nodes - 2)
    return node, place - node


def _hats(share: np.ndarray, nodes: int) -> np.ndarray:
    """[*at, nodes] weights of the nodes along one side."""
    place = np.clip(np.nan_to_num(share), 0.0, 1.0) * (nodes - 1)
    return np.maximum(0.0, 1 - np.abs(place[..., None] - np.arange(nodes)))
