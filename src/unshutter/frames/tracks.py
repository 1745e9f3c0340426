"""Tracks corners from one frame to the next, and identifies those that move with the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from unshutter.motion.lens import Lens
from unshutter.motion.robust import weighted_least_squares
from unshutter.motion.shapes import Bool, Float32, Float64, UInt8

TRACKED_SIDE = 360  # px, short side of the copies in which corners are tracked
MIN_TRACKS = 12  # tracks; fewer are inconclusive
GUESSED_RATIO = 0.5  # readout ratio where any will do


@dataclass(frozen=True)
class TrackParams:
    """Parameters of tracking corners and of selecting the background's (docs/research/frames.md)."""

    most_corners: int = 200
    quality: float = 0.005  # of a corner, as a share of the best one's
    apart: float = 1 / 45  # distance of corners, as a share of the diagonal
    window: int = 21  # px, side of the windows that are compared
    halved: int = 240  # px, short side from which on corners are those of a copy of half the size
    levels: int = 4  # of the pyramid of Lucas-Kanade
    levels_back: int = 2  # of that backwards, whose start is where it should end
    returns_px: float = 0.3  # largest forward-backward error
    compared: int = 50  # windows of a pair, at most, that are compared first
    alike: float = 0.5  # mean correlation of windows: above it, two frames show one scene (noise alone: at most 0.3)
    by_chance: float = 5.0  # standard errors by which tracks must be more, or their windows more alike, than by chance
    few_unrelated: int = 3  # fewer corners found in an unrelated picture: none are found by chance
    coarse_side: int = 128  # px, long side of the copies in which the shift of the whole picture is measured
    least_response: float = 0.05  # of the phase correlation; below it, that shift is unknown

    # ---- the background; lengths as shares of the diagonal
    least_of_scene: float = 0.4  # share of corners tracked: unrelated pictures have 0 to 0.02, a street from a car 0.88
    least_tracked: float = 0.15  # share of corners tracked: below it, the shot ends,
    least_agreeing: float = 0.35  # and below this share of tracks that agree
    near_plane: float = 0.004  # largest distance of a background track from the picture's homography
    sharp: float = 0.4  # least share of those tracks within a third of that distance; 0.1 to 0.35 are by chance
    spread: float = 4.0  # times the median distance from the homography: tracks farther away are discarded
    least: float = 0.0005  # distance always tolerated (0.4 px of 640 x 360)
    rival: float = 0.6  # a second plane with so many tracks, as a share of the first one's, may be the background
    same_place: float = 0.002  # corners of a frame that are as close as this are the same one
    still: float = 0.0003  # smaller displacements count as still
    passes: float = 0.003  # larger displacements pass by
    few_pass: float = 0.05  # share of the tracks: fewer may be mistakes
    cells: tuple[int, int] = (6, 8)  # rows and columns of the cells in which tracks are counted
    forward: float = 0.1  # of a unit vector: directions farther from the axis have no place in a straightened picture


_TRACKS = TrackParams()


@dataclass(frozen=True, eq=False)
class Tracks:
    """Corners of one frame tracked to the next one."""

    start: Float64[np.ndarray, "tracks 2"]  # [N, 2] (col, row) in the earlier frame [px of the tracked copy]
    end: Float64[np.ndarray, "tracks 2"]  # [N, 2] (col, row) in the later one
    height: int  # rows of the tracked copies [px]
    width: int  # columns of the tracked copies [px]
    looked_for: int  # number of corners that were to be tracked
    lens: Lens | None = None  # the camera's lens, if it bends straight lines

    def __len__(self) -> int:
        return len(self.start)

    def only(self, selection: Bool[np.ndarray, "tracks"]) -> Tracks:
        """Returns a selection of the tracks."""
        return replace(self, start=self.start[selection], end=self.end[selection])

    def rotated(self) -> Tracks:
        """Returns the tracks of pictures that are turned by 180 degrees."""
        last = np.array([self.width - 1, self.height - 1])
        return replace(self, start=last - self.start, end=last - self.end)


def follow(
    earlier: UInt8[np.ndarray, "rows columns"], later: UInt8[np.ndarray, "rows columns"], lens: Lens | None = None
) -> Tracks:
    """Tracks the corners of a frame to the next, by pyramidal Lucas-Kanade, forward and backward.

    Frames may be shifted by a third of their width: phase correlation of small copies gives the starting point.
    """
    height, width = earlier.shape
    corners = _corners(earlier)
    if corners is None:
        return Tracks(np.zeros((0, 2)), np.zeros((0, 2)), height, width, 0, lens)
    tracks = _found(earlier, later, corners, lens)
    return tracks if _shows_one_scene(tracks, earlier, later, corners) else tracks.only(np.zeros(len(tracks), bool))


def _corners(picture: np.ndarray) -> np.ndarray | None:
    """[N, 1, 2] corners of a picture (col, row), or None; those of a copy of half the size, found in a sixth of the
    time, are followed as well.
    """
    apart = _TRACKS.apart * float(np.hypot(*picture.shape))
    if min(picture.shape) < _TRACKS.halved:
        return cv2.goodFeaturesToTrack(picture, _TRACKS.most_corners, _TRACKS.quality, max(3.0, apart))
    small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    corners = cv2.goodFeaturesToTrack(small, _TRACKS.most_corners, _TRACKS.quality, apart / 2)
    return None if corners is None else 2 * corners + 0.5


def _found(earlier: np.ndarray, later: np.ndarray, corners: np.ndarray, lens: Lens | None = None) -> Tracks:
    """Tracks corners [N, 1, 2]; returns those that are found in both directions."""
    height, width = earlier.shape
    scale = max(1.0, max(earlier.shape) / _TRACKS.coarse_side)
    size = tuple(max(round(side / scale), 2) for side in earlier.shape[::-1])
    small = [cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (earlier, later)]
    shift, response = picture_shift(*small)
    shift = shift * (width, height) / size if response > _TRACKS.least_response else np.zeros(2)
    there, seen = lucas_kanade(earlier, later, corners, corners + shift.astype(np.float32), _TRACKS.window)
    back, seen_back = lucas_kanade(later, earlier, there, corners, _TRACKS.window, _TRACKS.levels_back)
    start, end = (each[:, 0].astype(np.float64) for each in (corners, there))
    good = seen & seen_back & (np.hypot(*(back - corners)[:, 0].T) < _TRACKS.returns_px)
    good &= (end >= 0).all(axis=1) & (end <= [width - 1, height - 1]).all(axis=1)
    return Tracks(start[good], end[good], height, width, len(corners), lens)


def picture_shift(
    first: UInt8[np.ndarray, "rows columns"], second: UInt8[np.ndarray, "rows columns"]
) -> tuple[Float64[np.ndarray, "2"], float]:
    """Returns (columns, rows) by which a whole picture moved, by phase correlation, and how clear that is (0 to 1)."""
    window = cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F)
    shift, response = cv2.phaseCorrelate(first.astype(np.float32), second.astype(np.float32), window)
    return np.array(shift), response


def lucas_kanade(
    first: UInt8[np.ndarray, "rows columns"],
    second: UInt8[np.ndarray, "rows columns"],
    points: Float32[np.ndarray, "points 1 2"],
    guess: Float32[np.ndarray, "points 1 2"],
    window: int,
    levels: int = _TRACKS.levels,
) -> tuple[Float32[np.ndarray, "points 1 2"], Bool[np.ndarray, "points"]]:
    """Searches for points in another picture by pyramidal Lucas-Kanade; returns positions, and which were found.

    Args:
        guess: positions from which the search starts.
        window: side of the windows that are compared [px].
        levels: of the pyramid, besides the pictures themselves.
    """
    settings = {"winSize": (window, window), "maxLevel": levels, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    found, status, _ = cv2.calcOpticalFlowPyrLK(first, second, points, guess.copy(), **settings)
    return found, status[:, 0] > 0


def _shows_one_scene(tracks: Tracks, earlier: np.ndarray, later: np.ndarray, corners: np.ndarray) -> bool:
    """Whether there are more tracks than in unrelated pictures, or windows around them are more alike.

    Lucas-Kanade finds a third of the corners of pure noise again, forward and backward, and now and then enough of them
    agree on a motion. The later frame turned by 180 degrees has the same noise and is unrelated: it shows how many
    corners are found by chance, and how alike their windows are.
    """
    if not len(tracks):
        return True
    some = tracks.only(np.arange(len(tracks)) % -(-len(tracks) // _TRACKS.compared) == 0)
    if _correlations(some, earlier, later).mean() > _TRACKS.alike:
        return True
    alike = _correlations(tracks, earlier, later)
    rotated = np.ascontiguousarray(later[::-1, ::-1])
    unrelated = _found(earlier, rotated, corners)
    more = len(tracks) - len(unrelated)
    if len(unrelated) < _TRACKS.few_unrelated or more > _TRACKS.by_chance * np.sqrt(len(tracks) + len(unrelated)):
        return True
    by_chance = _correlations(unrelated, earlier, rotated)
    error = by_chance.std(ddof=1) * np.sqrt(1 / len(alike) + 1 / len(by_chance))
    return alike.mean() > by_chance.mean() + _TRACKS.by_chance * error


def _correlations(tracks: Tracks, earlier: np.ndarray, later: np.ndarray) -> Float64[np.ndarray, "tracks"]:
    """Returns the normalised correlation of the windows around the start and the end of each track, -1 ... 1."""
    first, second = (_windows(*each) for each in ((earlier, tracks.start), (later, tracks.end)))
    lengths = np.sqrt((first**2).sum(axis=1) * (second**2).sum(axis=1))
    return (first * second).sum(axis=1) / np.maximum(lengths, 1e-9)


def _windows(picture: np.ndarray, points: np.ndarray) -> Float64[np.ndarray, "points window"]:
    """Returns the pixels of the windows around points (col, row), less the mean of each window."""
    aside = np.arange(_TRACKS.window) - _TRACKS.window // 2
    column = np.repeat(points[:, 0, None] + aside, _TRACKS.window, axis=0).astype(np.float32)
    row = np.repeat((points[:, 1, None] + aside).reshape(-1, 1), _TRACKS.window, axis=1).astype(np.float32)
    seen = cv2.remap(picture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = seen.reshape(len(points), -1).astype(np.float64)
    return seen - seen.mean(axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Background:
    """The tracks of two frames that move with the camera."""

    tracks: Tracks  # those of the background
    joined: bool  # whether one motion of the camera explains both frames; otherwise a new shot begins
    cut: bool = False  # whether hardly any corner of one frame is found in the other: they show different scenes
    still: bool = False  # whether the camera stood still, whatever moved in front of it
    passing: bool = False  # whether something moved in front of the camera while it stood still


def background(tracks: Tracks, readout_ratio: float | None = None, before: Background | None = None) -> Background:
    """Returns the tracks that one homography explains at a single moment; near and moving objects are discarded.

    Rows are exposed at different times, so tracks of one plane do not agree with a homography as they are. Each is
    first moved to the time of the middle row at its own speed.

    A camera that stands still leaves part of the picture exactly in place. If that part is spread over the picture,
    the rest may be arbitrarily large: people walking by do not make a camera motion.

    Args:
        readout_ratio: of the camera; None: half a frame interval, which is close enough for this.
        before: background of the two frames before, whose second one is the first one here. Of two planes that are
            about as large, the one that was the background before still is.
    """
    if len(tracks) < max(MIN_TRACKS, _TRACKS.least_tracked * tracks.looked_for):
        cut = len(tracks) < _TRACKS.least_of_scene * tracks.looked_for
        return Background(tracks.only(np.zeros(len(tracks), bool)), joined=False, cut=cut)
    diagonal = float(np.hypot(tracks.height, tracks.width))
    moved = tracks.end - tracks.start
    still = np.hypot(*moved.T) < _TRACKS.still * diagonal
    plane = _largest_plane(tracks, GUESSED_RATIO if readout_ratio is None else readout_ratio, before)
    elsewhere = (plane & still).sum() < still.sum() / 2
    if elsewhere and _spread(tracks.start[still], tracks):
        return Background(tracks.only(still), joined=True, still=True, passing=True)
    joined = plane.sum() >= max(MIN_TRACKS, _TRACKS.least_agreeing * len(tracks))
    passing = np.hypot(*moved.T) > _TRACKS.passes * diagonal
    cut = not joined and len(tracks) < _TRACKS.least_of_scene * tracks.looked_for
    return Background(tracks.only(plane), bool(joined), cut, passing=passing.sum() > _TRACKS.few_pass * len(tracks))


def _largest_plane(tracks: Tracks, ratio: float, before: Background | None) -> Bool[np.ndarray, "tracks"]:
    """Returns which tracks move with the largest plane, or with the one that was the background before."""
    fewest = max(MIN_TRACKS, _TRACKS.least_agreeing * len(tracks))
    plane = np.zeros(len(tracks), bool)
    for guess in dict.fromkeys((ratio, GUESSED_RATIO)):  # the speed of a camera that shakes is not that within a frame
        plane = _of_one_plane(*_at_once(tracks, guess), tracks)
        if plane.sum() >= fewest:
            break
    goes_on = _share_known(tracks.start[plane], tracks, before)
    if np.isnan(goes_on) or goes_on > 0.5:
        return plane
    others = np.flatnonzero(~plane)
    if len(others) < _TRACKS.rival * plane.sum():
        return plane
    rest = tracks.only(~plane)
    rival = np.zeros(len(tracks), bool)
    rival[others] = _of_one_plane(*_at_once(rest, guess), rest)
    is_rival = rival.sum() >= max(MIN_TRACKS, _TRACKS.rival * plane.sum())
    return rival if is_rival and _share_known(tracks.start[rival], tracks, before) > 2 * goes_on else plane


def _share_known(points: np.ndarray, tracks: Tracks, before: Background | None) -> float:
    """Returns the share of corners that were followed into this frame with the background before; NaN if unknown."""
    if before is None or not len(before.tracks) or not len(points):
        return np.nan
    across, down = (points[:, k, None] - before.tracks.end[:, k] for k in (0, 1))
    apart = np.sqrt((across**2 + down**2).min(axis=1))
    return float(np.mean(apart < _TRACKS.same_place * float(np.hypot(tracks.height, tracks.width))))


def _at_once(tracks: Tracks, ratio: float) -> tuple[Float64[np.ndarray, "tracks 2"], Float64[np.ndarray, "tracks 2"]]:
    """Returns starts and ends as seen when the middle rows are exposed, if each moves evenly."""
    moved = tracks.end - tracks.start
    speed = moved / (1 + ratio * moved[:, 1:] / tracks.height)
    start = tracks.start - speed * ratio * (tracks.start[:, 1:] / tracks.height - 0.5)
    return start, start + speed


def _of_one_plane(start: np.ndarray, end: np.ndarray, tracks: Tracks) -> np.ndarray:
    """[N] bool: the points that fit the homography of the majority from start to end.

    If the speed changes within a frame, rows deviate from it smoothly; that is allowed for. The first look is narrow:
    a wide one takes objects that move slowly for a part of the plane.
    """
    near = _TRACKS.near_plane * float(np.hypot(tracks.height, tracks.width))
    sharply = _close_to_plane(start, end, tracks, near / 2, near / 2)
    enough = sharply.sum() >= max(MIN_TRACKS, _TRACKS.least_agreeing * len(start))
    return sharply if enough else _close_to_plane(start, end, tracks, near, 2 * near)


def _close_to_plane(start: np.ndarray, end: np.ndarray, tracks: Tracks, near: float, at_first: float) -> np.ndarray:
    """[N] bool: the points that fit a homography, at first and then with smooth deviations [px]."""
    before, after = (straightened(points, tracks) for points in (start, end))
    homography, agreeing = cv2.findHomography(before, after, cv2.USAC_ACCURATE, at_first)
    if homography is None or agreeing.sum() < MIN_TRACKS:
        return np.zeros(len(start), bool)
    off = end - bent(cv2.perspectiveTransform(before[None], homography)[0], tracks)
    chosen = agreeing[:, 0] > 0
    powers = (start[:, 1:] / tracks.height - 0.5) ** np.arange(4)
    for _ in range(3):
        by_row = weighted_least_squares(powers, off.T, chosen)
        away = np.hypot(*(off.T - by_row @ powers.T))
        if np.count_nonzero(away < near) < MIN_TRACKS:
            return np.zeros(len(start), bool)
        chosen = away < near
    if np.count_nonzero(away < near / 3) < _TRACKS.sharp * np.count_nonzero(chosen):  # no closer than by chance: noise
        return np.zeros(len(start), bool)
    return away < np.clip(
        _TRACKS.spread * np.median(away[chosen]), _TRACKS.least * float(np.hypot(tracks.height, tracks.width)), near
    )


def straightened(points: Float64[np.ndarray, "points 2"], tracks: Tracks) -> Float64[np.ndarray, "points 2"]:
    """Undoes the lens distortion of points, if the lens has any."""
    if tracks.lens is None:
        return points
    focal = tracks.lens.focal * tracks.height
    middle = np.array([tracks.width - 1, tracks.height - 1]) / 2
    x, y, z = tracks.lens.direction(*((points - middle) / focal).T)
    return np.stack([x, y], axis=-1) / np.maximum(z, _TRACKS.forward)[:, None] * focal + middle


def bent(points: Float64[np.ndarray, "points 2"], tracks: Tracks) -> Float64[np.ndarray, "points 2"]:
    """Applies the lens distortion to points; the inverse of :func:`straightened`."""
    if tracks.lens is None:
        return points
    focal = tracks.lens.focal * tracks.height
    middle = np.array([tracks.width - 1, tracks.height - 1]) / 2
    points = (points - middle) / focal
    return np.stack(tracks.lens.position(points[:, 0], points[:, 1], 1.0), axis=-1) * focal + middle


def _spread(points: np.ndarray, tracks: Tracks) -> bool:
    """Whether points cover a quarter of the picture's cells, in at least three of its quarters."""
    cell = (points[:, ::-1] / [tracks.height, tracks.width] * _TRACKS.cells).astype(int)
    cells = {(int(row), int(col)) for row, col in cell}
    quarters = {(2 * row // _TRACKS.cells[0], 2 * col // _TRACKS.cells[1]) for row, col in cells}
    return 4 * len(cells) >= _TRACKS.cells[0] * _TRACKS.cells[1] and len(quarters) >= 3
