"""Registers a photo to the frames of its video, and fits the camera's rotation during the photo's readout.

The video's frames give the camera's rotation T(t) over time (frames/camera.py). A point of the photo at x, in row y
(0 ... 1), and at x' in frame k shows the rotation Q(y) of that row against the video:

    x' - x = J (T(t of its row in frame k) - Q(y)) + g x + (p . x) x + r |x|^2 x

where J is the Jacobian of a rotation, g the remaining scale, p the effect of moving towards a slanted surface, and r
the difference between two lens corrections. Q is modelled as a parabola: q0 + q1 (y - 1/2) + q2 ((y - 1/2)^2 - 1/12).
All unknowns are linear. The change of Q from row to row is the photo's motion; neither the photo's readout time nor
the time at which it was taken is needed.

Both serve as a check, though. If the video was not stabilised, its centre is that of the sensor, so q0 lies on the path
T, and q1 equals the rate of T there times a plausible readout time. A stabilised video follows a path of its own and
fails this check.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from unshutter.frames.camera import ROWS, Fit, rotation_jacobian
from unshutter.frames.flow import NO_ARRAY
from unshutter.frames.tracks import follow
from unshutter.motion.robust import CORRELATED, student_weights
from unshutter.motion.shapes import Float64, UInt8

_TURNS = 9  # unknowns of q0, q1, q2; followed by those of scale, slant and lens


@dataclass(frozen=True)
class VideoParams:
    """Parameters of using a photo's video, measured by ``python lab/benchmarks/motion_photos.py``.

    Lengths in px are those of a picture with ``ROWS`` rows, unless others are named; times are in frame intervals.
    """

    # ---- the photo within the video
    features: int = 1200  # of each picture
    contrast: float = 0.015  # of features; below SIFT's usual 0.04, for scenes with little texture
    best_match: float = 0.75  # Lowe's ratio test: distance of the best match over that of the second best
    near_px: float = 4.0  # px of the video that features may be off,
    min_features: int = 25  # the fewest that are not,
    least_agreeing: float = 0.3  # and their least share
    scales: tuple[float, float] = (0.25, 4.0)  # of the photo's copy in the video
    skew_deg: float = 6.0  # off a quarter turn; no video is rotated further against its photo
    min_matches: int = 40  # in a usable frame
    rounds: int = 6
    finest_px: float = 0.05  # lower limit of the matches' noise
    curvature_px: float = 0.25  # prior standard deviation of q2

    # ---- the video
    most_frames: int = 120  # decoded at most
    about_s: float = 1.2  # before and after the photo's time; frames farther away are ignored
    long_s: float = 10.0  # where a video is not decoded from its start
    most_before: int = 1000  # frames decoded in vain at most
    largest_frame: int = 1 << 24  # px of the frame
    around: int = 30  # frames used on each side of the photo
    min_frames: int = 6  # of a usable video
    matched: int = 2  # frames on each side that the photo is compared with

    # ---- whether it is the photo's motion
    least_ratio: float = 0.12  # frames with a shorter readout were rectified by the phone
    least_px: float = 0.25  # mean over the photo: less counts as no motion
    off_px: float = 1.5  # largest distance of the photo from the path of an unstabilised video
    against_px: float = 0.8  # tolerated difference between its rate and the path's,
    against_share: float = 0.1  # and share of it
    ratios: tuple[float, float] = (0.05, 2.0)  # readout times of photos
    step: float = 0.05
    systematic_px: float = 0.08  # lens corrections and other effects that are not motion


VIDEO = VideoParams()


@dataclass(frozen=True, eq=False)
class Matches:
    """Points of a photo matched in a frame."""

    # [N, 2] (col, row) from the photo's centre, rotated like the video, at the video's scale [px of the frame]
    photo: Float64[np.ndarray, "matches 2"]
    frame: Float64[np.ndarray, "matches 2"]  # [N, 2] (col, row) from the frame's centre [px of the frame]


def placement(
    photo: UInt8[np.ndarray, "rows columns"], frame: UInt8[np.ndarray, "height width"]
) -> tuple[int, float] | None:
    """Locates a photo in a frame of its video by SIFT features, approximately.

    Returns:
        Counter-clockwise quarter turns that align the stored photo with the frames, and px of the video per px of the
        photo's copy; None if they do not show the same scene.
    """
    sift = cv2.SIFT.create(VIDEO.features, contrastThreshold=VIDEO.contrast)
    in_photo, of_photo = sift.detectAndCompute(photo, NO_ARRAY)
    in_frame, of_frame = sift.detectAndCompute(frame, NO_ARRAY)
    if of_photo is None or of_frame is None or min(len(of_photo), len(of_frame)) < VIDEO.min_features:
        return None
    pairs = cv2.BFMatcher().knnMatch(of_photo, of_frame, k=2)
    clear = [best for best, second in pairs if best.distance < VIDEO.best_match * second.distance]
    if len(clear) < VIDEO.min_features:
        return None
    start = np.array([in_photo[each.queryIdx].pt for each in clear])
    end = np.array([in_frame[each.trainIdx].pt for each in clear])
    cv2.setRNGSeed(0)
    similarity, agreeing = cv2.estimateAffinePartial2D(start, end, ransacReprojThreshold=VIDEO.near_px)
    if similarity is None or agreeing.sum() < max(VIDEO.min_features, VIDEO.least_agreeing * len(clear)):
        return None
    scale = float(np.hypot(similarity[0, 0], similarity[1, 0]))
    rotated = float(np.degrees(np.arctan2(-similarity[1, 0], similarity[0, 0])))  # counter-clockwise: rows run down
    quarters = round(rotated / 90)
    if abs(rotated - 90 * quarters) > VIDEO.skew_deg or not VIDEO.scales[0] <= scale <= VIDEO.scales[1]:
        return None
    return quarters % 4, scale


def matches(
    photo: UInt8[np.ndarray, "rows columns"],
    frame: UInt8[np.ndarray, "height width"],
    scale: float,
    guess: Float64[np.ndarray, "3"],
) -> Matches | None:
    """Matches points of a photo in a frame to a tenth of a pixel; returns None if there are too few.

    Args:
        guess: displacement (columns, rows) [px of the frame] and angle [rad] of the frame's centre from the photo's.
    """
    height, width = frame.shape
    cos = np.cos(guess[2])
    sin = np.sin(guess[2])
    rotation = np.array([[cos, -sin], [sin, cos]])
    middle, photo_middle = (np.array([size[1] - 1, size[0] - 1]) / 2 for size in (frame.shape, photo.shape))
    linear = scale * rotation
    matrix = np.column_stack([linear, middle + guess[:2] - linear @ photo_middle])
    if scale < 1:  # avoids aliasing
        photo = cv2.GaussianBlur(photo, (0, 0), 0.4 / scale)
    placed = cv2.warpAffine(photo, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT)
    seen = cv2.warpAffine(np.full(photo.shape, 255, np.uint8), matrix, (width, height)) == 255
    tracks = follow(_like(placed, frame, seen), frame)
    at = np.clip(np.rint(tracks.start).astype(int), 0, [width - 1, height - 1])
    inside = cv2.erode(seen.astype(np.uint8), np.ones((15, 15), np.uint8), borderValue=(0,))[at[:, 1], at[:, 0]] > 0
    if inside.sum() < VIDEO.min_matches:
        return None
    start = (tracks.start[inside] - middle - guess[:2]) @ rotation  # undoes the rotation
    return Matches(start, tracks.end[inside] - middle)


def _like(picture: np.ndarray, other: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Matches the brightness of a picture to another one by histogram specification."""
    if not seen.any():
        return picture
    levels = np.arange(256)
    ranks = np.cumsum(np.bincount(picture[seen], minlength=256)) / seen.sum()
    others = np.cumsum(np.bincount(other[seen], minlength=256)) / seen.sum()
    return np.interp(ranks, others, levels)[picture].astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Frames:
    """The camera's rotation as estimated from a video."""

    fit: Fit  # the camera's rotation over time
    times: Float64[np.ndarray, "frames"]  # times of the frames in the fit [frame intervals]
    ratio: float  # readout time of a frame, in frame intervals
    height: int  # rows of the frames' copies
    width: int  # their columns

    def path(self, at: Float64[np.ndarray, "*times"]) -> Float64[np.ndarray, "*times 3"]:
        """Rotation at given times, as shifts in the picture [px of ROWS rows; about z: at the focal length]."""
        return self.fit.rotation(at) * self.fit.focal_px


@dataclass(frozen=True, eq=False)
class StillFit:
    """The fitted rotation of a photo's rows."""

    coefficients: Float64[np.ndarray, "3 3"]  # [3, 3] q0, q1, q2 about three axes [px of ROWS rows of the video]
    error: Float64[np.ndarray, "3 3"]  # [3, 3] their standard deviations

    def rotation(self, row: Float64[np.ndarray, "rows"]) -> Float64[np.ndarray, "rows 3"]:
        """Returns the rotation of rows, 0 ... 1, relative to the first [px of ROWS rows of the video]."""
        centred = row - 0.5
        moved = centred[:, None] * self.coefficients[1] + (centred**2)[:, None] * self.coefficients[2]
        first = -0.5 * self.coefficients[1] + 0.25 * self.coefficients[2]
        return moved - first


def fit_still(frames: Frames, found: Mapping[int, Matches], height: float) -> StillFit:
    """Fits the rotation of a photo's rows.

    Args:
        found: frame -> points of the photo matched in it.
        height: rows of the photo [px of the video's copies, at its scale].
    """
    unit = ROWS / frames.height
    parts = [_equations(frames, k, each, height, unit) for k, each in found.items()]
    design, moved = zip(*parts, strict=True)
    A = np.concatenate(design)
    b = np.concatenate(moved)
    prior = np.zeros(A.shape[-1])
    prior[6:9] = VIDEO.curvature_px**-2.0
    every = np.ones(len(b), bool)
    weights = np.ones(len(b))
    noise = np.nan
    unknowns = np.zeros(A.shape[-1])
    covariance = np.eye(A.shape[-1])
    for _ in range(VIDEO.rounds):
        normal = np.einsum("n,nik,nil->kl", weights, A, A) + np.diag(prior) * (noise**2 if np.isfinite(noise) else 1e-3)
        unknowns = np.linalg.solve(normal, np.einsum("n,nik,ni->k", weights, A, b))
        squared = ((b - A @ unknowns) ** 2).sum(axis=1)
        weights, noise = student_weights(squared, every, noise, VIDEO.finest_px, rounds=1)
        weights *= noise**2
        covariance = np.linalg.inv(normal) * noise**2 * CORRELATED
    error = np.sqrt(np.diag(covariance)[:_TURNS]).reshape(3, 3)
    return StillFit(unknowns[:_TURNS].reshape(3, 3), error)


def _equations(frames: Frames, frame: int, found: Matches, height: float, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """[N, 2, unknowns] and [N, 2]: linear equations for the matches in a frame [px of ROWS rows]."""
    start = found.photo * unit
    end = found.frame * unit
    focal = frames.fit.focal_px
    middle = np.array([frames.width * unit, ROWS]) / 2
    J = rotation_jacobian((start + end) / 2 + middle, frames.width * unit, focal)
    row = np.clip(0.5 + end[:, 1] / ROWS, 0, 1)
    seen = frames.path(frames.times[frame] + frames.ratio * row)
    moved = end - start - np.einsum("nij,nj->ni", J[..., :3], seen)
    centred = found.photo[:, 1] / height  # y - 1/2
    shape = np.stack([np.ones_like(centred), centred, centred**2 - 1 / 12], axis=-1)  # [N, 3]
    rotations = -(shape[:, None, :, None] * J[:, :, None, :3]).reshape(len(start), 2, _TURNS)
    at = start / (ROWS / 2)
    others = [at, at * at[:, :1], at * at[:, 1:], at * (at**2).sum(axis=1, keepdims=True)]
    return np.concatenate([rotations, np.stack(others, axis=-1)], axis=-1), moved
