"""The interface of all protocols' cases: running an estimator, applying its answer and scoring it.

Also degradations of photos (compression, noise, blur, night), and the attitude of an undistorted photo's camera, to be
given to estimators as if from an accelerometer. No data set states it, but without rolling shutter right angles reveal
it well: the camera is fitted to the photo's line segments, with its motion fixed at zero.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion
from unshutter.motion.finding import Finding
from unshutter.motion.verdict import judge
from unshutter.motion.warp import straighten, validity_mask
from unshutter.options import Reference, Undo
from unshutter.photo import Photo
from unshutter.single.candidates import LEAST_GAIN
from unshutter.single.estimator import Estimator, View
from unshutter.single.likelihood import likelihood_of, segments_of
from unshutter.single.methods import find_candidates
from unshutter.single.prior import CAMERA, LOG_FOCAL, ROLL, TILT, UNKNOWNS, YAW
from unshutter.single.search import descend
from unshutter_lab.evaluation.metrics import psnr, ssim

# One line of the results, text and numbers only: "suite", "group", "photo", "draw" and "estimator", then figures.
Record = dict[str, Any]
Loaded = Callable[[str], Estimator]  # name -> estimator, built once per process
NOTHING = "none"  # the estimator that leaves the input unchanged


class Trial(ABC):
    """One picture to measure on. It is selected in one process and measured in another."""

    @property
    @abstractmethod
    def key(self) -> str:
        """Unique key of the case within the run."""

    @property
    def oracles(self) -> tuple[str, ...]:
        """Names judged along with the estimators that know the truth or see more than one photo."""
        return ()

    @abstractmethod
    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns the records of the estimators and oracles with these names."""


class Case(Trial):
    """One picture on which estimators are judged, and which can be shown."""

    @property
    @abstractmethod
    def place(self) -> Record:
        """The case in the tables: ``suite``, ``group``, ``photo`` and ``draw``."""

    @property
    def file(self) -> Path:
        """The name of its picture, where pictures are written and where answers to them are looked up."""
        return Path(re.sub(r"[^\w.=-]+", "_", self.key) + ".png")

    def view(self) -> View:
        """Returns what methods that see one photo are given."""
        raise UsageError("the pictures of this protocol are not made here: answer those in its folders")

    @abstractmethod
    def show(self, names: list[str], loaded: Loaded) -> Example | None:
        """Returns the pictures and curves behind the records; None if pictures would not show them."""


@dataclass(frozen=True)
class Example:
    """One case to show."""

    title: str  # title naming the picture
    # (caption, uint8 [H, W, 3]), all of one size: the input, each estimator's result, the truth
    pictures: list[tuple[str, np.ndarray]]
    curves: dict[str, Motion]  # name -> motion, including "truth" if known


@dataclass(frozen=True)
class Answer:
    """An estimator's answer."""

    found: Finding  # with the first row as the reference; zero if the estimator failed
    others: tuple[Motion, ...] = ()  # the other candidates
    declined: str = ""  # why the estimator could say nothing, in its own words; otherwise empty
    failed: str = ""  # the error that it raised; otherwise empty

    @property
    def motion(self) -> Motion:
        """The motion."""
        return self.found.motion

    def figures(self) -> Record:
        """Returns the figures common to the records of all protocols.

        ``confidence`` is None if the estimator states none or declined. ``left_alone`` is why ``unshutter rectify``
        with default options would leave the photo unchanged, or empty. ``kind`` is the likeliest kind of motion, or
        empty if the estimator does not report kinds.
        """
        scale = 256 / self.motion.height
        farthest = self.motion.largest_px * scale
        kinds = dict(self.found.kind_shares)
        return {
            "declined": self.declined,
            "failed": self.failed,
            "confidence": self.found.confidence,
            "farthest": farthest if np.isfinite(farthest) else None,
            "left_alone": judge(self.found, Undo()).cause or "",
            "kind": max(kinds, key=kinds.__getitem__, default=""),
            "most_tx": float(np.abs(self.motion.tx_px).max()) * scale,
            "most_rz": float(np.degrees(np.abs(self.motion.rz_rad).max())),
        }


def ask(estimator: Estimator, view: View) -> Answer:
    """Runs an estimator on a photo. An exception becomes part of the answer."""
    try:
        found, *others = (each.finding.rereferenced("first") for each in find_candidates(estimator, view))
    except Exception as error:  # whatever it is, the other estimators must still be judged
        message = " ".join(f"{type(error).__name__}: {error}".split())
        return Answer(view.no_motion(estimator.name, "failed"), failed=message)
    declined = str(found.reason or "") if found.confidence is None else ""
    return Answer(found, tuple(other.motion for other in others), declined)


def rectified(photo: Photo, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Returns uint8 [H, W, 1 or 3] and a bool mask [H, W] of visible pixels, as ``unshutter rectify`` does.

    A motion that cannot be undone leaves the photo unchanged.
    """
    if not motion.is_zero:
        with suppress(UnshutterError):
            pixels = straighten(photo.pixels, motion, masked=photo.masked)[0]
            return in_8_bits(photo.with_pixels(pixels)), validity_mask(motion)
    return in_8_bits(photo), np.ones((photo.height, photo.width), bool)


def compared(photo: Photo, motions: dict[str, Motion], reference: Reference = "first") -> list[tuple[str, np.ndarray]]:
    """Returns the photo and what each motion makes of it, with captions, for an :class:`Example`."""
    pictures = [("input", in_8_bits(photo))]
    for name, motion in motions.items():
        if name != NOTHING:
            pictures.append((name, rectified(photo, motion.rereferenced(reference))[0]))
    return pictures


def picture_scores(pictures: dict[str, np.ndarray], truth: np.ndarray, mask: np.ndarray) -> Record:
    """Returns PSNR and SSIM of several pictures [H, W, bands] against the truth, where the mask [H, W] is true.

    The pictures are named by the suffix of the record's keys, ``psnr_input`` (the estimator's result by none). Scores
    without a finite value (equal pictures, an empty mask) are None.
    """
    scores: Record = {"seen": float(mask.mean())}
    for name, picture in pictures.items():
        ending = f"_{name}" if name else ""
        values = {f"psnr{ending}": psnr(picture, truth, mask), f"ssim{ending}": ssim(picture, truth, mask)}
        scores |= {key: value if np.isfinite(value) else None for key, value in values.items()}
    return scores


def in_8_bits(photo: Photo) -> np.ndarray:
    """Returns the stored pixels without alpha, uint8 [H, W, 1 or 3], for comparing pictures."""
    pixels = photo.to_array().reshape(photo.height, photo.width, -1)
    pixels = pixels[..., : 3 if pixels.shape[-1] >= 3 else 1]
    return (pixels >> 8).astype(np.uint8) if pixels.dtype == np.uint16 else pixels


Disturbance = Literal["jpeg", "noise", "blur", "night"]
JPEG_QUALITY = 30
NOISE_SIGMA = 10.0  # of 255
BLUR_SIGMA = 1.5  # px
NIGHT_GAMMA, NIGHT_BRIGHTNESS, NIGHT_NOISE = 2.0, 0.5, 6.0


def disturbed(picture: np.ndarray, how: Disturbance, rng: np.random.Generator) -> np.ndarray:
    """Returns a picture [H, W, 3] as JPEG with chroma subsampling, with normal noise, blurred, or dark and noisy."""
    if how == "jpeg":
        jpeg = Photo.from_array(picture).to_bytes("jpeg", JPEG_QUALITY)
        return Photo.from_bytes(jpeg).to_array().reshape(picture.shape)
    if how == "blur":
        return cv2.GaussianBlur(picture, (0, 0), BLUR_SIGMA).reshape(picture.shape)
    sigma = NOISE_SIGMA
    if how == "night":
        picture, sigma = NIGHT_BRIGHTNESS * 255 * (picture / 255.0) ** NIGHT_GAMMA, NIGHT_NOISE
    return np.clip(np.round(picture + rng.normal(0, sigma, picture.shape)), 0, 255).astype(np.uint8)


_MIN_SEGMENTS = 20
_YAWS = np.arange(6) * (math.pi / 2 / 6)
_TILTS = np.radians([-10, 0, 10, 25])


def true_attitude(view: View) -> tuple[float, float] | None:
    """Returns roll and tilt [degrees] of an undistorted photo's camera, or None if there are no right angles."""
    segments, size = segments_of(view)
    if len(segments) < _MIN_SEGMENTS:
        return None
    likelihood = likelihood_of(view, segments, size)
    yaw, tilt = (a.ravel() for a in np.meshgrid(_YAWS, _TILTS))
    begin = np.zeros((len(yaw), UNKNOWNS))
    begin[:, YAW], begin[:, TILT] = yaw, tilt
    begin[:, LOG_FOCAL] = likelihood.prior.mean[LOG_FOCAL]
    candidates, energy, _ = descend(likelihood, begin, CAMERA)
    best = candidates[np.argmin(energy)]
    if float(likelihood.lines_gain(best[None])[0]) < LEAST_GAIN:
        return None
    # a camera rotated clockwise sees the scene rotated counter-clockwise
    return -math.degrees(best[ROLL]), math.degrees(best[TILT])
