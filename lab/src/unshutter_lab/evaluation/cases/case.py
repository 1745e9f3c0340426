"""The interface of all protocols' cases: running an estimator, applying its answer and scoring it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.estimators.base import Estimator, View
from unshutter.estimators.find import find_motion
from unshutter.motion import Motion
from unshutter.motion.verdict import Verdict
from unshutter.options import Undo
from unshutter.photo import Photo
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
    @abstractmethod
    def oracles(self) -> tuple[str, ...]:
        """Names judged along with the estimators that know the truth or see more than one photo."""

    @abstractmethod
    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns the records of the estimators and oracles with these names.

        Raises:
            UnshutterError: the picture cannot be read or used.
        """


class Case(Trial):
    """One picture on which estimators are judged, and which can be shown."""

    @abstractmethod
    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures and curves behind the records."""


@dataclass(frozen=True)
class Example:
    """One case to show.

    Attributes:
        title: title naming the picture.
        pictures: (caption, uint8 [H, W, 3]), all of one size: the input, each estimator's result, the truth.
        curves: name -> motion, including "truth" if known.
    """

    title: str
    pictures: list[tuple[str, np.ndarray]]
    curves: dict[str, Motion]


@dataclass(frozen=True)
class Answer:
    """An estimator's answer.

    Attributes:
        motion: with the first row as the reference; zero if the estimator failed.
        declined: why the estimator returned no motion, in its own words; otherwise empty.
        failed: the error that it raised; otherwise empty.
    """

    motion: Motion
    declined: str = ""
    failed: str = ""

    def figures(self) -> Record:
        """Returns the figures common to the records of all protocols.

        ``confidence`` is the motion's, or None if the estimator states none or declined. ``left_alone`` is why
        ``unshutter rectify`` with default options would leave the photo unchanged, or empty if it would change it.
        ``kind`` is the likeliest kind of motion, or empty if the estimator does not report kinds.
        """
        scale = 256 / self.motion.height
        farthest = self.motion.largest_px * scale
        kinds = dict(self.motion.kind_shares)
        return {
            "declined": self.declined,
            "failed": self.failed,
            "confidence": self.motion.confidence,
            "farthest": farthest if np.isfinite(farthest) else None,
            "left_alone": Verdict.of(self.motion, Undo()).cause or "",
            "kind": max(kinds, key=kinds.__getitem__, default=""),
            "most_tx": float(np.abs(self.motion.tx_px).max()) * scale,
            "most_rz": float(np.degrees(np.abs(self.motion.rz_rad).max())),
        }


def ask(estimator: Estimator, view: View) -> Answer:
    """Runs an estimator on a photo. An exception becomes part of the answer."""
    try:
        motion = find_motion(estimator, view).rereferenced("first")
    except Exception as error:  # whatever it is, the other estimators must still be judged
        message = " ".join(f"{type(error).__name__}: {error}".split())
        return Answer(view.no_motion(estimator.name, "failed"), failed=message)
    return Answer(motion, declined=str(motion.reason or ""))


def rectified(photo: Photo, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Returns uint8 [H, W, 1 or 3] and a bool mask [H, W] of visible pixels, as ``unshutter rectify`` does.

    A motion that cannot be undone leaves the photo unchanged.
    """
    from unshutter.warp.pixels import rectify_pixels, validity_mask

    whole = np.ones((photo.height, photo.width), bool)
    if motion.is_zero:
        return in_8_bits(photo), whole
    try:
        pixels = rectify_pixels(photo.pixels, motion, masked=photo.masked)
        return in_8_bits(photo.with_pixels(pixels)), validity_mask(motion)
    except UnshutterError:
        return in_8_bits(photo), whole


def picture_scores(pictures: dict[str, np.ndarray], truth: np.ndarray, mask: np.ndarray) -> Record:
    """Returns PSNR and SSIM of several pictures against the truth, on the same pixels: ``psnr``, ``psnr_input`` ...

    Scores without a finite value (equal pictures, an empty mask) are None.

    Args:
        pictures: suffix of the record's keys ("" for the estimator's result) -> uint8 [H, W, bands].
        truth: the global-shutter picture.
        mask: bool [H, W], where all of them show something.
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
