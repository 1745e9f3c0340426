"""Variation of light and camera in training pictures: exposure, gamma, white balance, grey, blur, noise, JPEG.

Light falls on the scene, so it is the same for the distorted and the undistorted picture. Blur, noise and compression
are the camera's: they affect only the distorted picture, which the network sees. Works on whole batches, on the
pictures' device.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from unshutter.errors import UsageError
from unshutter_lab.training.data.dice import Dice

_BLOCK = 8  # of JPEG [px]
_LUMA = torch.tensor([0.299, 0.587, 0.114])


@dataclass(frozen=True)
class LightConfig:
    """Variation of light and cameras. A spread is a standard deviation of the logarithm.

    Raises:
        UsageError: a share is outside 0 ... 1.
    """

    share: float = 0.0  # share of the pictures that are varied
    exposure: float = 0.2  # spread
    gamma: float = 0.2  # spread
    balance: float = 0.06  # spread of each channel
    grey: float = 0.1  # share without colour
    blurred: float = 0.3  # share
    blur_px: float = 1.2  # largest standard deviation of the blur
    noisy: float = 0.3  # share
    noise: float = 0.04  # largest standard deviation of the noise, of white = 1
    compressed: float = 0.25  # share with JPEG artefacts
    quantum: float = 0.25  # largest step of JPEG's coefficients, of white = 1

    def __post_init__(self) -> None:
        if not all(0 <= s <= 1 for s in (self.share, self.grey, self.blurred, self.noisy, self.compressed)):
            raise UsageError("[data.light]: shares must lie between 0 and 1")


class Light:
    """The light and the camera of one batch.

    Args:
        config: their variation.
        generator: random number generator.
        batch: number of pictures.
    """

    def __init__(self, config: LightConfig, generator: torch.Generator, batch: int):
        dice = Dice(generator, batch)
        self._dice, changed = dice, dice.happens(config.share)
        spread = changed.float()[:, None]
        gain = config.exposure * dice.normal(1) + config.balance * dice.normal(3)
        self._gain = torch.exp(spread * gain)[..., None, None]  # [B, 3, 1, 1]
        self._gamma = torch.exp(spread * config.gamma * dice.normal(1))[..., None, None]
        self._grey = changed & dice.happens(config.grey)
        blurred, noisy, compressed = (
            changed & dice.happens(share) for share in (config.blurred, config.noisy, config.compressed)
        )
        self._blur = torch.where(blurred, config.blur_px * dice.each(), 0.0)
        self._noise = torch.where(noisy, config.noise * dice.each(), 0.0)
        self._quantum = torch.where(compressed, config.quantum * dice.each(), 0.0)

    def on_scene(self, pictures: Tensor) -> Tensor:
        """Returns [B, 3, h, w] in 0 ... 1 under the varied light. Black remains black."""
        pictures = (pictures * self._gain).clamp_(0, 1)
        pictures = torch.pow(pictures, self._gamma)
        some = self._grey.nonzero()[:, 0]
        if len(some):
            luma = (pictures[some] * _LUMA.to(pictures)[:, None, None]).sum(1, keepdim=True)
            pictures[some] = luma.expand(-1, 3, -1, -1)
        return pictures

    def through_camera(self, pictures: Tensor) -> Tensor:
        """Returns [B, 3, h, w] as recorded by the camera: blurred, noisy, compressed."""
        pictures = _of_some(pictures, self._blur, blur)
        some = self._noise.nonzero()[:, 0]
        if len(some):
            noise = torch.randn(len(some), *pictures.shape[1:], generator=self._dice.generator, device=pictures.device)
            pictures = pictures.index_add(0, some, noise * self._noise[some, None, None, None])
        return _of_some(pictures, self._quantum, compress).clamp_(0, 1)


def blur(pictures: Tensor, deviation: Tensor) -> Tensor:
    """Blurs [B, C, h, w] by Gaussians with standard deviations [B] px."""
    places = torch.arange(-3, 4, dtype=pictures.dtype, device=pictures.device)
    weights = torch.exp(-0.5 * (places / deviation.clamp(min=1e-3)[:, None]).square())
    weights = (weights / weights.sum(1, keepdim=True))[..., None, None, None]  # [B, 7, 1, 1, 1]
    height, width = pictures.shape[-2:]
    for padding, axis, length in (((0, 0, 3, 3), 2, height), ((3, 3, 0, 0), 3, width)):
        padded = F.pad(pictures, padding, mode="replicate")
        pictures = sum((weights[:, k] * padded.narrow(axis, k, length) for k in range(7)), torch.zeros(()))
    return pictures


def compress(pictures: Tensor, quantum: Tensor) -> Tensor:
    """Adds JPEG artefacts to [B, C, h, w]: rounds the cosine coefficients of blocks of 8 px.

    Args:
        pictures: their sides must be multiples of 8.
        quantum: [B] step of the highest frequencies; that of the lowest is a sixth.
    """
    frequency = torch.arange(_BLOCK, dtype=pictures.dtype, device=pictures.device)
    cosines = torch.cos(math.pi / _BLOCK * frequency[:, None] * (frequency + 0.5)) * math.sqrt(2 / _BLOCK)
    cosines[0] *= math.sqrt(0.5)
    height, width = pictures.shape[-2:]
    blocks = pictures.unflatten(3, (width // _BLOCK, _BLOCK)).unflatten(2, (height // _BLOCK, _BLOCK))
    blocks = blocks.transpose(3, 4)  # [B, C, h / 8, w / 8, 8, 8]
    steps = (1 + 5 * (frequency[:, None] + frequency) / (2 * _BLOCK - 2)) / 6
    steps = quantum[:, None, None, None, None, None] * steps
    coefficients = torch.round(cosines @ blocks @ cosines.T / steps) * steps
    return (cosines.T @ coefficients @ cosines).transpose(3, 4).reshape(pictures.shape)


def _of_some(pictures: Tensor, amount: Tensor, change) -> Tensor:
    """Applies a change to the pictures whose amount [B] is not zero."""
    some = amount.nonzero()[:, 0]
    if len(some):
        pictures = pictures.index_copy(0, some, change(pictures[some], amount[some]))
    return pictures
