"""Contact sheets: the input, each method's result, and the truth, side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unshutter.photo import Photo
from unshutter_lab.evaluation.cases.case import Example

_SIDE = 200  # px of the pictures' longer side
_ACROSS = 5
_GAP = 6
_CAPTION = 18  # px above each picture


def write_sheet(example: Example, path: Path, quality: int = 82) -> None:
    """Writes a JPEG with all pictures of an example, in rows.

    Raises:
        UnshutterError: it cannot be written.
    """
    Photo.from_array(sheet(example.pictures)).save(path, quality=quality, overwrite=True)


def sheet(pictures: list[tuple[str, np.ndarray]]) -> np.ndarray:
    """Returns a uint8 [H, W, 3] sheet of captioned pictures [h, w, 1 or 3] of one size."""
    tiles = [_tile(caption, picture) for caption, picture in pictures]
    height, width = tiles[0].shape[:2]
    across = min(_ACROSS, len(tiles))
    down = -(-len(tiles) // across)
    whole = np.full((down * (height + _GAP) - _GAP, across * (width + _GAP) - _GAP, 3), 255, np.uint8)
    for k, tile in enumerate(tiles):
        top, left = (k // across) * (height + _GAP), (k % across) * (width + _GAP)
        whole[top : top + height, left : left + width] = tile
    return whole


def _tile(caption: str, picture: np.ndarray) -> np.ndarray:
    import cv2

    scale = _SIDE / max(picture.shape[:2])
    size = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(np.ascontiguousarray(picture), size, interpolation=method).reshape(size[1], size[0], -1)
    tile = np.full((size[1] + _CAPTION, size[0], 3), 255, np.uint8)
    tile[_CAPTION:] = small
    font, fit = cv2.FONT_HERSHEY_SIMPLEX, 0.42
    (wide, _), _ = cv2.getTextSize(caption, font, fit, 1)
    fit *= min(1.0, (size[0] - 4) / max(wide, 1))
    return cv2.putText(tile, caption, (2, _CAPTION - 6), font, fit, (0, 0, 0), 1, cv2.LINE_AA)
