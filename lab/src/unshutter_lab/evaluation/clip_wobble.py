"""Measures the wobble of a clip, by tracks that ``unshutter video`` does not use, and its sharpness.

Tracks are corners of copies of at most 960 px, followed forwards and back, of which most agree with an affine motion.
From them follow the readout ratio, by regression (``unshutter.video.calibrate.readout_regression``), and the wobble:
skew and stretch from frame to frame at the first and last rows, apart from what depth adds, which is a constant and a
share of the speed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.pyav import open_to_read
from unshutter.frames.tracks import Tracks
from unshutter.motion.shapes import Float64, UInt8
from unshutter.video.calibrate.readout_regression import PairMotion, Regression, Run, regression

_LONG_SIDE = 960  # px, of the copies
_CORNERS, _MIN_TRACKS = 700, 40
_RETURNS_PX = 0.25  # from where it began, of a corner that is followed back
_BORDER = 8  # px
_RANSAC_PX, _AGREEING = 2.5, 0.3
_COPY_LEVELS, _COPY_SHARE = 2, 0.002  # a frame is a copy where fewer pixels than this share differ by more than this
_SHARP_EVERY = 15  # frames
_SHORTEST_RUN = 7  # pairs in a row, below which they have no path
_ROUNDS = 8  # of reweighting
_OUTER = (0.5, 99.5)  # percentiles to which values are limited before their root mean square is taken
_LARGE = 95  # percentile of the steps
_FOLLOWING = {"winSize": (17, 17), "maxLevel": 4, "criteria": (3, 30, 0.003), "minEigThreshold": 1e-3}


@dataclass(frozen=True)
class ClipWobble:
    """Wobble and sharpness of a clip, in its own pixels."""

    rms: float  # root mean square of skew and stretch from frame to frame, at the top and bottom rows
    usual: float  # 95th percentile of both together
    largest: float  # largest of both together
    regression: Regression | None  # readout ratio; None if too few pairs of frames are known
    explained: float  # root mean square of what the readout ratio explains of the steps
    sharpness: float  # variance of the Laplacian, median of the frames

    @classmethod
    def of(cls, path: Path, end_s: float) -> ClipWobble:
        """Measures a clip up to a time.

        Raises:
            UnshutterError: it cannot be read, or its frames cannot be followed.
        """
        pairs: list[PairMotion | None] = []
        times: list[float] = []
        sharpness: list[float] = []
        last: np.ndarray | None = None
        scale = 1.0
        aspect = 1.0
        for time_s, grey in grey_frames(path, end_s):
            shrink = min(1.0, _LONG_SIDE / max(grey.shape))
            scale = 1 / shrink
            aspect = grey.shape[0] / grey.shape[1]
            small = cv2.resize(grey, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA) if shrink < 1 else grey
            small = np.ascontiguousarray(small)
            if last is not None:
                if np.mean(cv2.absdiff(small, last) > _COPY_LEVELS) < _COPY_SHARE:
                    continue
                tracks = followed_corners(last, small)
                pairs.append(None if tracks is None else PairMotion.of([tracks])[0])
            if len(times) % _SHARP_EVERY == 0:
                inner = grey[_BORDER:-_BORDER, _BORDER:-_BORDER].astype(np.float32)
                sharpness.append(float(cv2.Laplacian(inner, cv2.CV_32F).var()))
            times.append(time_s)
            last = small
        gaps = np.diff(times)
        gaps = gaps / np.median(gaps) if len(gaps) and (gaps > 0).all() else np.ones(len(pairs))
        runs = _runs(pairs, gaps, aspect)
        if not any(run.used.any() for run in runs):
            raise UnshutterError(f"{path}: its frames cannot be followed: too few, or without detail")
        left = np.concatenate([_without_depth(runs, kind) for kind in range(2)]).reshape(2, -1) * scale
        sizes = np.hypot(*left)
        rms = float(np.sqrt(2 * np.mean(np.clip(left, *np.percentile(left, _OUTER)) ** 2)))
        shown = regression(runs)
        explained = 0.0 if shown is None else shown.wobble_px * scale
        usual = float(np.percentile(sizes, _LARGE))
        return cls(rms, usual, float(sizes.max()), shown, explained, float(np.median(sharpness)))


def _runs(pairs: list[PairMotion | None], gaps: Float64[np.ndarray, "pairs"], aspect: float) -> list[Run]:
    """Returns the runs of pairs whose motions are known; gaps are times between frames [usual frame intervals].

    Pairs that hardly move count, too, unlike in ``runs_of``: without them, a camera at rest seems to wobble more.
    """
    runs: list[Run] = []
    known: list[PairMotion] = []
    for end, pair in enumerate([*pairs, None]):
        if pair is not None:
            known.append(pair)
            continue
        if len(known) >= _SHORTEST_RUN:
            runs.append(Run.of(known, gaps[end - len(known) : end].tolist(), aspect))
        known = []
    return runs


def _without_depth(runs: list[Run], kind: int) -> Float64[np.ndarray, "pairs"]:
    """Returns the skew (0) or stretch (1) of the pairs that count, without a constant and what follows the speed.

    Both are fitted together with the change of the speed, which a rolling shutter makes them follow, robustly.
    """
    values = np.concatenate([run.shapes[run.used, kind] for run in runs])
    change = np.concatenate([run.changes[run.used, kind] for run in runs])
    speeds = np.concatenate([run.shifts[run.used] for run in runs])
    rows = np.stack([change, np.ones(len(values)), *speeds.T], axis=1)
    weights = np.ones(len(values))
    unknowns = np.zeros(rows.shape[1])
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)
        unknowns = np.linalg.lstsq(rows * root[:, None], values * root, rcond=None)[0]
        left = values - rows @ unknowns
        scale = max(1.4826 * float(np.median(np.abs(left))), 1e-9)
        weights = 1 / (1 + (left / (2.5 * scale)) ** 2)
    return values - rows[:, 1:] @ unknowns[1:]


def grey_frames(path: Path, end_s: float = np.inf) -> Iterator[tuple[float, UInt8[np.ndarray, "height width"]]]:
    """Yields the time [s] of each frame up to a time, and the frame in grey.

    Raises:
        UnshutterError: the clip cannot be read.
    """
    try:
        with open_to_read(str(path)) as video:
            stream = video.streams.video[0]
            rate = float(stream.average_rate or 30)
            for number, frame in enumerate(video.decode(stream)):
                if number >= end_s * rate:
                    return
                yield frame.time if frame.time is not None else number / rate, frame.to_ndarray(format="gray")
    except (OSError, IndexError, ValueError) as error:
        raise UnshutterError(f"{path}: cannot be read as a clip ({error})") from None


def followed_corners(
    before: UInt8[np.ndarray, "height width"], after: UInt8[np.ndarray, "height width"]
) -> Tracks | None:
    """Tracks corners from a frame to the next and back; returns those that agree with most of the others."""
    corners = cv2.goodFeaturesToTrack(before, _CORNERS, 0.005, 9, blockSize=5)
    if corners is None:
        return None
    there, good, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, corners.copy(), **_FOLLOWING)
    back, good_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, there.copy(), **_FOLLOWING)
    height, width = before.shape
    end = there[:, 0].astype(np.float64)
    kept = (good[:, 0] > 0) & (good_back[:, 0] > 0) & (np.hypot(*(back - corners)[:, 0].T) < _RETURNS_PX)
    kept &= (end > _BORDER).all(axis=1) & (end < [width - _BORDER - 1, height - _BORDER - 1]).all(axis=1)
    start = corners[kept, 0].astype(np.float64)
    end = end[kept]
    if len(start) < _MIN_TRACKS:
        return None
    agreeing = cv2.estimateAffine2D(start, end, ransacReprojThreshold=_RANSAC_PX, maxIters=500)[1]
    chosen = agreeing[:, 0] > 0
    if chosen.sum() < max(_MIN_TRACKS, _AGREEING * len(start)):
        return None
    return Tracks(start[chosen], end[chosen], height, width, len(corners))
