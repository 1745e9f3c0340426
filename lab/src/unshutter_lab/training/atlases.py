"""Stores places side by side in one tensor, so that a batch of cameras can see them at once, also on a GPU."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from unshutter.motion.shapes import UInt8
from unshutter_lab.synthesis.panorama import LEAST_FINE, Place, face_positions


class Atlases:
    """The faces of some places, at each of their sizes."""

    def __init__(self, places: list[Place], device: torch.device):
        self._pixels = torch.cat([_flat(atlas) for place in places for _, atlas in place.levels()]).to(device)
        most = max(len(place.levels()) for place in places)
        first = []
        sides = []
        start = 0
        for place in places:
            starts = []
            own = []
            for side, atlas in place.levels():
                starts.append(start)
                own.append(side)
                start += len(_flat(atlas))
            missing = most - len(own)  # filled with the smallest
            first.append(starts + starts[-1:] * missing)
            sides.append(own + own[-1:] * missing)
        self._first = torch.tensor(first, device=device)  # [places, sizes] of the atlas in the tensor
        self._sides = torch.tensor(sides, device=device)  # the largest first

    def replace(self, number: int, place: Place) -> None:
        """Puts a place where another of the same size was."""
        for (_, atlas), start in zip(place.levels(), self._first[number].tolist(), strict=False):  # padded
            pixels = _flat(atlas)
            self._pixels[start : start + len(pixels)] = pixels.to(self._pixels.device)

    def seen(self, which: Tensor, directions: tuple[Tensor, Tensor, Tensor], focal_px: Tensor) -> Tensor:
        """Returns what cameras see.

        Args:
            which: [B] numbers of the places.
            directions: x, y, z [B, h, w] of the directions in which pixels look, of any length.
            focal_px: [B] focal lengths, which choose the size of the faces, as in panorama.py.

        Returns:
            [B, 3, h, w] in 0 ... 1.
        """
        fine = self._sides[which] / 2 >= LEAST_FINE * focal_px[:, None]
        chosen = (fine.sum(1) - 1).clamp(min=0)[:, None]
        side = self._sides[which].gather(1, chosen)[..., None]  # [B, 1, 1]
        first = self._first[which].gather(1, chosen)[..., None]
        col, row = face_positions(*directions, side)
        left = col.floor()
        top = row.floor()
        wide = side + 2  # with its borders
        at = first + top.long() * wide + left.long()
        across = (col - left)[..., None]
        upper = torch.lerp(self._pixels[at].float(), self._pixels[at + 1].float(), across)
        lower = torch.lerp(self._pixels[at + wide].float(), self._pixels[at + wide + 1].float(), across)
        seen = torch.lerp(upper, lower, (row - top)[..., None])
        return seen.permute(0, 3, 1, 2).contiguous().div_(255)


def _flat(atlas: UInt8[np.ndarray, "h w 3"]) -> Tensor:
    return torch.from_numpy(atlas).reshape(-1, 3)
