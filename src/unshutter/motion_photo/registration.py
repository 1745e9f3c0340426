"""Registers a photo to a frame of its film: scale, orientation, and matching points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from unshutter.frames.tracks import follow

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64, UInt8

_FEATURES, _CONTRAST = 1200, 0.015  # of each picture; below SIFT's usual 0.04, for scenes with little texture
_RATIO = 0.75  # Lowe's ratio test: distance of the best match over that of the second best
_NEAR, _FEWEST = 4.0, 25  # px of tolerance, and fewest features within it
_LEAST_SHARE = 0.3  # least share of matches that agree
_SCALES = (0.25, 4.0)  # of the photo's copy in the film
_SKEW = 6.0  # degrees off a quarter turn; no film is rotated further against its photo
_MATCHES = 40  # fewest matches in a usable frame


@dataclass(frozen=True)
class Placement:
    """Approximate placement of a photo in a frame of its film.

    Attributes:
        quarter_turns: counter-clockwise quarter turns that align the stored photo with the film's frames.
        scale: px of the film per px of the photo's copy.
    """

    quarter_turns: int
    scale: float


@dataclass(frozen=True, eq=False)
class Matches:
    """Points of a photo matched in a frame.

    Attributes:
        photo: [N, 2] (col, row) from the photo's centre, rotated like the film, at the film's scale [px of the frame].
        frame: [N, 2] (col, row) from the frame's centre [px of the frame].
    """

    photo: Float64[np.ndarray, "matches 2"]
    frame: Float64[np.ndarray, "matches 2"]

    def __len__(self) -> int:
        return len(self.photo)


def placement(photo: UInt8[np.ndarray, "rows columns"], frame: UInt8[np.ndarray, "height width"]) -> Placement | None:
    """Locates a photo in a frame by SIFT features; returns None if they do not show the same scene.

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
    """Matches points of a photo in a frame to a tenth of a pixel; returns None if there are too few.

    Args:
        photo: grey copy of the photo, rotated like the film.
        frame: grey copy of a frame.
        scale: see :class:`Placement`.
        guess: displacement (columns, rows) [px of the frame] and angle [rad] of the frame's centre from the photo's.
    """
    height, width = frame.shape
    cos, sin = np.cos(guess[2]), np.sin(guess[2])
    turn = np.array([[cos, -sin], [sin, cos]])
    middle, photo_middle = (np.array([size[1] - 1, size[0] - 1]) / 2 for size in (frame.shape, photo.shape))
    linear = scale * turn
    matrix = np.column_stack([linear, middle + guess[:2] - linear @ photo_middle])
    if scale < 1:  # avoids aliasing
        photo = cv2.GaussianBlur(photo, (0, 0), 0.4 / scale)
    placed = cv2.warpAffine(photo, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    seen = cv2.warpAffine(np.full(photo.shape, 255, np.uint8), matrix, (width, height)) == 255
    tracks = follow(_like(placed, frame, seen), frame)
    at = np.clip(np.rint(tracks.start).astype(int), 0, [width - 1, height - 1])
    inside = cv2.erode(seen.astype(np.uint8), np.ones((15, 15), np.uint8), borderValue=(0,))[at[:, 1], at[:, 0]] > 0
    if inside.sum() < _MATCHES:
        return None
    start = (tracks.start[inside] - middle - guess[:2]) @ turn  # undoes the rotation
    return Matches(start, tracks.end[inside] - middle)


def _like(picture: np.ndarray, other: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Matches the brightness of a picture to another one by histogram specification."""
    if not seen.any():
        return picture
    levels = np.arange(256)
    ranks = np.cumsum(np.bincount(picture[seen], minlength=256)) / seen.sum()
    others = np.cumsum(np.bincount(other[seen], minlength=256)) / seen.sum()
    return np.interp(ranks, others, levels)[picture].astype(np.uint8)
