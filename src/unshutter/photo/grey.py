"""Grey copies of pictures, for those who look for motion in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from unshutter.photo.libvips import refusing, standard

if TYPE_CHECKING:
    import numpy as np  # not imported above: reading a file, which starts first, can do without
    import pyvips


def grey_size(height: int, width: int, short_side: int | None) -> tuple[int, int]:
    """Height and width of the grey copy of a picture."""
    scale = 1.0 if short_side is None else min(short_side / min(height, width), 1.0)
    return max(round(height * scale), 1), max(round(width * scale), 1)


def grey_copy(
    image: pyvips.Image, height: int, width: int, vscale: float | None = None, hscale: float | None = None
) -> np.ndarray:
    """[height, width] uint8 luminance of an image scaled by the factors; by default those that give that size."""
    import numpy as np

    vscale, hscale = vscale or height / image.height, hscale or width / image.width
    with refusing("cannot compute the grey copy"):
        if image.hasalpha():
            image = image.flatten(background=[32896 if image.format == "ushort" else 128])
        if image.format == "ushort":
            image = standard(image.cast("uchar", shift=True))  # first: the rest takes a third of the time
        if (hscale, vscale) != (1.0, 1.0):
            image = image.embed(*(0, 0, _aligned(image.width, hscale), _aligned(image.height, vscale)), extend="copy")
            image = image.resize(hscale, vscale=vscale, kernel="mitchell")  # hardly rings: no ghosts next to edges
        pixels = image.numpy()[:height, :width]
    if pixels.ndim == 3:
        import cv2

        pixels = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    missing = (height - pixels.shape[0], width - pixels.shape[1])
    return np.ascontiguousarray(np.pad(pixels, ((0, missing[0]), (0, missing[1])), mode="edge"))


def _aligned(size: int, scale: float) -> int:
    """A size, a little larger, that scales to whole pixels: what is missing to them, libvips shifts to both sides."""
    return min(range(size, size + 16), key=lambda padded: abs(padded * scale - round(padded * scale)))
