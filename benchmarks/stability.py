"""Shake that is left in clips: ``python benchmarks/stability.py CLIP...``, a line for each.

Corners are followed from frame to frame and a similarity is fitted to them (OpenCV, RANSAC), without unshutter. What
counts is by how much the picture moves from one frame to the next, less its average over half a second: the root mean
square of this in px, for the middle of the picture (shake) and for what a turn does at half the height (turn).
"jelly" is the median distance of corners from the similarity, "PSNR" the mean over pairs of consecutive frames.
"""

from __future__ import annotations

import sys

import av
import cv2
import numpy as np

_WINDOW_S = 0.5
_MOST, _APART = 400, 12


def measured(path: str) -> tuple[float, float, float, float]:
    """Shake [px], turn [px], jelly [px] and PSNR [dB] of a clip."""
    moves, off, likeness, before = [], [], [], None
    with av.open(path) as clip:
        video = clip.streams.video[0]
        rate = float(video.average_rate or 30)
        for frame in clip.decode(video):
            grey = frame.to_ndarray(format="gray")
            if before is not None:
                move = _similarity(before, grey)
                if move is not None:
                    moves.append(move[0])
                    off.append(move[1])
                difference = before.astype(np.float32) - grey
                likeness.append(10 * np.log10(255**2 / max(float((difference**2).mean()), 1e-3)))
            before = grey
    motion = np.array(moves)
    reach = max(round(_WINDOW_S * rate / 2), 1)
    kernel = np.ones(2 * reach + 1)
    count = np.convolve(np.ones(len(motion)), kernel)[reach:-reach]
    mean = np.stack([np.convolve(axis, kernel)[reach:-reach] / count for axis in motion.T], axis=-1)
    rest = motion - mean
    shake = float(np.sqrt((rest[:, :2] ** 2).sum(axis=1).mean()))
    return shake, float(np.sqrt((rest[:, 2] ** 2).mean())), float(np.median(off)), float(np.mean(likeness))


def _similarity(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Shift of the middle (col, row) and turn at half the height [px]; median distance of corners from it [px]."""
    corners = cv2.goodFeaturesToTrack(before, _MOST, 0.005, _APART)
    if corners is None:
        return None
    there, status, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None, winSize=(21, 21), maxLevel=4)
    good = status[:, 0] > 0
    if good.sum() < 12:
        return None
    one, other = corners[good, 0], there[good, 0]
    matrix, inside = cv2.estimateAffinePartial2D(one, other, ransacReprojThreshold=2.0)
    if matrix is None:
        return None
    height, width = before.shape
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    shift = matrix[:, :2] @ middle + matrix[:, 2] - middle
    turn = np.arctan2(matrix[1, 0], matrix[0, 0]) * height / 2
    off = np.hypot(*(one @ matrix[:, :2].T + matrix[:, 2] - other)[inside[:, 0] > 0].T)
    return np.array([*shift, turn]), float(np.median(off))


if __name__ == "__main__":
    for path in sys.argv[1:]:
        print("{}: shake {:.3f} px, turn {:.3f} px, jelly {:.3f} px, PSNR {:.2f} dB".format(path, *measured(path)))
