"""The preview of a run: photos before and after, side by side, in one picture."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pyvips

from unshutter.errors import UnshutterError
from unshutter.photo import Photo
from unshutter.photo.libvips import as_image, libvips
from unshutter.photo.photo import PREVIEW
from unshutter.run.ahead import open_input
from unshutter.run.job import Job, Outcome
from unshutter.storage.files import fingerprint
from unshutter.storage.locations import absolute

MOST_PHOTOS = 500  # per sheet
_ACROSS = 3  # photos per row
_GAP = 8  # px; larger for a large single photo
_WHITE = [255.0]


class Preview:
    """Collects before and after pictures, and writes them as one."""

    def __init__(self, path: Path, overwrite: bool, photos: Iterable[Path]):
        self._path = path
        self._overwrite = overwrite
        self._order = {absolute(photo): number for number, photo in enumerate(photos)}
        self._pairs: dict[Path, tuple[str, tuple[np.ndarray, np.ndarray]]] = {}
        self._left_out = 0

    def add(self, job: Job, outcome: Outcome) -> None:
        """Adds a processed photo."""
        if outcome.preview is None:
            return
        verdict = outcome.verdict
        summary = ""
        if verdict is not None:
            summary = verdict.described() if verdict.changes else f"left unchanged ({verdict.sentence})"
        self._add(job.source, f"{job.source.name}: {summary}", outcome.preview)

    def add_finished(self, job: Job, max_pixels: int, longest_px: int) -> None:
        """Adds a photo whose result exists from an earlier run, unless one of the two can no longer be read."""
        with suppress(UnshutterError):
            before = after = open_input(job.source, max_pixels).upright(longest_px)
            if fingerprint(job.picture) is not None:  # an unchanged photo may have no result
                after = open_input(job.picture, max_pixels).upright(longest_px)
            self._add(job.source, f"{job.source.name}: finished already", (before, after))

    def _add(self, photo: Path, caption: str, pair: tuple[np.ndarray, np.ndarray]) -> None:
        self._pairs[photo] = caption, pair
        if len(self._pairs) > MOST_PHOTOS:
            del self._pairs[max(self._pairs, key=self._turn)]
            self._left_out += 1

    def _turn(self, photo: Path) -> int:
        """The photo's place in the run, whichever worker was faster."""
        return self._order[absolute(photo)]

    def save(self) -> str:
        """Writes the picture; returns a line about it."""
        if not self._pairs:
            return f"no photo was processed: {self._path} was not written"
        sheet = _sheet([self._pairs[photo] for photo in sorted(self._pairs, key=self._turn)])
        Photo.from_array(sheet.numpy(), software=PREVIEW).save(self._path, quality=90, overwrite=self._overwrite)
        more = f" (the first {MOST_PHOTOS} photos; {self._left_out} more are not in it)" if self._left_out else ""
        return f"before and after: {self._path}{more}"


def _sheet(pairs: list[tuple[str, tuple[np.ndarray, np.ndarray]]]) -> pyvips.Image:
    """Arranges all pairs, captioned, in rows."""
    tiles = [_tile(caption, *pair) for caption, pair in pairs]
    width = max(tile.width for tile in tiles) + 2 * _GAP
    sheet, *more = (
        libvips().Image.arrayjoin(tiles[first : first + _ACROSS], hspacing=width, background=_WHITE)
        for first in range(0, len(tiles), _ACROSS)
    )
    for row in more:
        sheet = sheet.join(row, "vertical", expand=True, shim=_GAP, background=_WHITE)
    return sheet.embed(_GAP, 0, sheet.width, sheet.height + _GAP, background=_WHITE, extend="background")


def _tile(caption: str, before: np.ndarray, after: np.ndarray) -> pyvips.Image:
    """Places both pictures side by side, vertically centred, under their caption."""
    how = {"expand": True, "background": _WHITE}
    gap = max(_GAP, before.shape[1] // 100)
    pair = as_image(before).join(as_image(after), "horizontal", shim=gap, align="centre", **how)
    return as_image(_title(caption, pair.width)).join(pair, "vertical", **how)


def _title(caption: str, width: int) -> np.ndarray:
    """Draws a line of text, [H, width, 3]; OpenCV's font is ASCII only."""
    text = caption.encode("ascii", "replace").decode()
    font = cv2.FONT_HERSHEY_SIMPLEX
    scale = max(0.4, width / 2500)
    thick = max(1, round(1.5 * scale))
    (wide, high), _ = cv2.getTextSize(text, font, scale, thick)
    scale *= min(1.0, (width - _GAP) / max(wide, 1))
    title = np.full((2 * high + _GAP, width, 3), 255, np.uint8)
    return np.asarray(cv2.putText(title, text, (2, high + high // 2), font, scale, (0, 0, 0), thick, cv2.LINE_AA))
