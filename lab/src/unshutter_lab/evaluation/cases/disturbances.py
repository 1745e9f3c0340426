"""Degradations of photos: compression, noise, blur, night."""

from __future__ import annotations

import numpy as np

from unshutter.photo import Photo

JPEG_QUALITY = 30
NOISE_SIGMA = 10.0  # of 255
BLUR_SIGMA = 1.5  # px
NIGHT_GAMMA, NIGHT_BRIGHTNESS, NIGHT_NOISE = 2.0, 0.5, 6.0


def compressed(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Compresses as JPEG of quality 30 with chroma subsampling; uint8 [H, W, 3]."""
    jpeg = Photo.from_array(picture).to_bytes("jpeg", JPEG_QUALITY)
    return Photo.from_bytes(jpeg).to_array().reshape(picture.shape)


def noisy(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Adds normal noise of standard deviation 10 to every value."""
    return _added(picture, NOISE_SIGMA, rng)


def blurred(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Applies a Gaussian blur of 1.5 px."""
    import cv2

    return cv2.GaussianBlur(picture, (0, 0), BLUR_SIGMA).reshape(picture.shape)


def at_night(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Darkens by a gamma of 2 and to half the brightness, then adds noise of standard deviation 6."""
    dark = NIGHT_BRIGHTNESS * 255 * (picture / 255.0) ** NIGHT_GAMMA
    return _added(dark, NIGHT_NOISE, rng)


DISTURBANCES = {"jpeg": compressed, "noise": noisy, "blur": blurred, "night": at_night}


def _added(picture: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    return np.clip(np.round(picture + rng.normal(0, sigma, picture.shape)), 0, 255).astype(np.uint8)
