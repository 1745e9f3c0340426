"""Where a photo lies in a frame of its film: at which scale, turned how, and which of its places are found where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from unshutter.frames.tracks import follow

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64, UInt8

_FEATURES, _CONTRAST = 1200, 0.015  # of each picture; below SIFT's usual 0.04, for scenes that show little
_RATIO = 0.75  # how much nearer the best partner is than the second
_NEAR, _FEWEST = 4.0, 25  # px, and features within them, that make a match
_LEAST_SHARE = 0.3  # of the partners that have to agree
_SCALES = (0.25, 4.0)  # of the photo's copy in the film
_SKEW = 6.0  # degrees off a quarter turn: no film is turned so against its photo
_MATCHES = 40  # corners without which a frame says nothing


@dataclass(frozen=True)
class Placement:
    """Where a photo lies in a frame of its film, roughly.

    Attributes:
        quarter_turns: counter-clockwise, that the stored photo has to be given to lie as the film's frames do.
        scale: px of the film per px of the photo's copy.
    """

    quarter_turns: int
    scale: float


@dataclass(frozen=True, eq=False)
class Matches:
    """Places of a photo that are found in a frame.

    Attributes:
        photo: [N, 2] (col, row) about the photo's middle, turned like the film, at the film's scale [px of the frame].
        frame: [N, 2] (col, row) about the frame's middle [px of the frame].
    """

    photo: Float64[np.ndarray, "matches 2"]
    frame: Float64[np.ndarray, "matches 2"]

    def __len__(self) -> int:
        return len(self.photo)


def placement(photo: UInt8[np.ndarray, "rows columns"], frame: UInt8[np.ndarray, "height width"]) -> Placement | None:
    """Where a photo lies in a frame; None where they do not show the same.

    Args:
        photo: grey copy of the stored photo.
        frame: grey copy of a frame.
    """
    sift: Any = cv2.SIFT.create(_FEATURES, contrastThreshold=_CONTRAST)
    in_photo, of_photo = sift.detectAndCompute(photo, None)
    in_frame, of_frame = sift.detectAndCompute(frame, None)
    if of_photo is None or of_frame is None or min(len(of_photo), len(of_frame)) < _FEWEST:
        return None
    pairs = cv2.BFMatcher().knnMatch(of_photo, of_frame, k=2)
    clear = [best for best, second in pairs if best.distance < _RATIO * second.distance]
    if len(clear) < _FEWEST:
        return None
    start = np.array([in_photo[each.queryIdx].pt for each in clear])
    end = np.array([in_frame[each.trainIdx].pt for each in clear])
    cv2.setRNGSeed(0)
    similarity, agreeing = cv2.estimateAffinePartial2D(start, end, ransacReprojThreshold=_NEAR)
    if similarity is None or agreeing.sum() < max(_FEWEST, _LEAST_SHARE * len(clear)):
        return None
    scale = float(np.hypot(similarity[0, 0], similarity[1, 0]))
    turned = float(np.degrees(np.arctan2(-similarity[1, 0], similarity[0, 0])))  # counter-clockwise: rows run down
    quarters = round(turned / 90)
    if abs(turned - 90 * quarters) > _SKEW or not _SCALES[0] <= scale <= _SCALES[1]:
        return None
    return Placement(quarters % 4, scale)


def matches(
    photo: UInt8[np.ndarray, "rows columns"],
    frame: UInt8[np.ndarray, "height width"],
    scale: float,
    guess: Float64[np.ndarray, "3"],
) -> Matches | None:
    """Places of a photo that are found in a frame, to a tenth of a pixel; None where they are too few.

    Args:
        photo: grey copy of the photo, turned like the film.
        frame: grey copy of a frame.
        scale: see :class:`Placement`.
        guess: columns and rows [px of the frame] and angle [rad] by which the frame's middle is off the photo's.
    """
    height, width = frame.shape
    cos, sin = np.cos(guess[2]), np.sin(guess[2])
    turn = np.array([[cos, -sin], [sin, cos]])
    middle, photo_middle = (np.array([size[1] - 1, size[0] - 1]) / 2 for size in (frame.shape, photo.shape))
    linear = scale * turn
    matrix = np.column_stack([linear, middle + guess[:2] - linear @ photo_middle])
    if scale < 1:  # so that details do not alias
        photo = cv2.GaussianBlur(photo, (0, 0), 0.4 / scale)
    placed = cv2.warpAffine(photo, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    seen = cv2.warpAffine(np.full(photo.shape, 255, np.uint8), matrix, (width, height)) == 255
    tracks = follow(_like(placed, frame, seen), frame)
    at = np.clip(np.rint(tracks.start).astype(int), 0, [width - 1, height - 1])
    inside = cv2.erode(seen.astype(np.uint8), np.ones((15, 15), np.uint8), borderValue=(0,))[at[:, 1], at[:, 0]] > 0
    if inside.sum() < _MATCHES:
        return None
    start = (tracks.start[inside] - middle - guess[:2]) @ turn  # back by the angle
    return Matches(start, tracks.end[inside] - middle)


def _like(picture: np.ndarray, other: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """A picture with the brightnesses of another one, by their histograms."""
    if not seen.any():
        return picture
    levels = np.arange(256)
    ranks = np.cumsum(np.bincount(picture[seen], minlength=256)) / seen.sum()
    others = np.cumsum(np.bincount(other[seen], minlength=256)) / seen.sum()
    return np.interp(ranks, others, levels)[picture].astype(np.uint8)
