"""The preview of a run: one picture with each photo before and after, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.batch.job import Job, Outcome
from unshutter.batch.lookahead import open_photo
from unshutter.photo import Photo
from unshutter.storage.places import fingerprint

if TYPE_CHECKING:
    import numpy as np

    from unshutter.frames.frame import RectifiedFrame
    from unshutter.result import Rectified

SHEET_PX = 320  # long side of each picture of a sheet
MOST_PHOTOS = 500  # per sheet
_ACROSS = 3  # photos per row
_GAP = 8  # px; larger for a large single photo
_WHITE, _BLACK = 255, (0, 0, 0)


class Preview:
    """Collects before and after pictures, and writes them as one.

    Args:
        path: file to write; its extension names the format.
        overwrite: whether an existing file may be replaced.
    """

    def __init__(self, path: Path, overwrite: bool):
        self._path, self._overwrite = path, overwrite
        self._pairs: list[tuple[str, tuple[np.ndarray, np.ndarray]]] = []
        self._left_out = 0

    def add(self, job: Job, outcome: Outcome) -> None:
        """Adds a processed photo."""
        if outcome.preview is None:
            return
        verdict = outcome.verdict
        summary = (
            ""
            if verdict is None
            else verdict.described()
            if verdict.changes
            else f"left unchanged ({verdict.sentence})"
        )
        self._add(f"{job.source.name}: {summary}", outcome.preview)

    def add_finished(self, job: Job) -> None:
        """Adds a photo whose result already exists from an earlier run.

        Raises:
            UnshutterError: the photo or its result cannot be read.
        """
        if job.preview_px is None:
            return
        before = open_photo(job.source, job.max_pixels).upright(job.preview_px)
        is_written = fingerprint(job.target) is not None  # an unchanged photo may have no result
        after = open_photo(job.target, job.max_pixels).upright(job.preview_px) if is_written else before
        self._add(f"{job.source.name}: finished already", (before, after))

    def _add(self, caption: str, pair: tuple[np.ndarray, np.ndarray]) -> None:
        if len(self._pairs) == MOST_PHOTOS:
            self._left_out += 1
        else:
            self._pairs.append((caption, pair))

    def save(self) -> str:
        """Writes the picture; returns a line about it.

        Raises:
            UnshutterError: it cannot be written, or is too large for its format.
        """
        if not self._pairs:
            return f"no photo was done: {self._path} was not written"
        Photo.from_array(_sheet(self._pairs)).save(self._path, quality=90, overwrite=self._overwrite)
        more = f" (the first {MOST_PHOTOS} photos; {self._left_out} more are not in it)" if self._left_out else ""
        return f"before and after: {self._path}{more}"


def before_and_after(result: Rectified | RectifiedFrame, longest_px: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the photo and its result, upright, [H, W, 3] uint8 sRGB each.

    Args:
        result: the outcome for the photo.
        longest_px: long side to which both are reduced; 0: full size.

    Raises:
        UnshutterError: the photo is damaged.
    """
    before = result.original.upright(longest_px)
    return before, result.photo.upright(longest_px) if result.changed else before


def _sheet(pairs: list[tuple[str, tuple[np.ndarray, np.ndarray]]]) -> np.ndarray:
    """Arranges all pairs, captioned, in rows; returns uint8 [H, W, 3]."""
    import numpy as np

    tiles = [_tile(caption, *pair) for caption, pair in pairs]
    width = max(tile.shape[1] for tile in tiles)
    rows = []
    for first in range(0, len(tiles), _ACROSS):
        row = tiles[first : first + _ACROSS]
        height = max(tile.shape[0] for tile in row)
        across = min(_ACROSS, len(tiles))
        whole = np.full((height + _GAP, across * (width + 2 * _GAP), 3), _WHITE, np.uint8)
        for k, tile in enumerate(row):
            left = k * (width + 2 * _GAP) + _GAP
            whole[: tile.shape[0], left : left + tile.shape[1]] = tile
        rows.append(whole)
    return np.concatenate(rows)


def _tile(caption: str, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Places both pictures side by side, vertically centred, under their caption."""
    import numpy as np

    gap = max(_GAP, before.shape[1] // 100)
    height, width = max(before.shape[0], after.shape[0]), before.shape[1] + gap + after.shape[1]
    title = _title(caption, width)
    tile = np.full((len(title) + height, width, 3), _WHITE, np.uint8)
    tile[: len(title)] = title
    for picture, left in ((before, 0), (after, before.shape[1] + gap)):
        top = len(title) + (height - picture.shape[0]) // 2
        tile[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return tile


def _title(caption: str, width: int) -> np.ndarray:
    """Draws a line of text, [H, width, 3]; OpenCV's font is ASCII only."""
    import cv2
    import numpy as np

    text = caption.encode("ascii", "replace").decode()
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, max(0.4, width / 2500)
    thick = max(1, round(1.5 * scale))
    (wide, high), _ = cv2.getTextSize(text, font, scale, thick)
    scale *= min(1.0, (width - _GAP) / max(wide, 1))
    title = np.full((2 * high + _GAP, width, 3), _WHITE, np.uint8)
    return np.asarray(cv2.putText(title, text, (2, high + high // 2), font, scale, _BLACK, thick, cv2.LINE_AA))
