"""Pictures to be looked at: upright, in sRGB, 8 bits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from unshutter.photo.libvips import computed, refusing, set_blob, standard, to_8_bits

if TYPE_CHECKING:
    import numpy as np
    import pyvips

    from unshutter.geometry.orientation import Orientation


def upright(image: pyvips.Image, icc: bytes | None, orientation: Orientation, longest_px: int = 0) -> np.ndarray:
    """A picture as a viewer shows it.

    Args:
        image: stored pixels, of 1 to 4 bands; transparent places are shown on white.
        icc: profile of its colours; None: sRGB.
        orientation: of the stored pixels.
        longest_px: long side that it is made smaller to; 0: its own.

    Returns:
        [H, W, 3] uint8 RGB, not to be written to.

    Raises:
        UnshutterError: libvips refuses.
    """
    import numpy as np

    with refusing("cannot show the picture"):
        scale = longest_px / max(image.width, image.height) if longest_px else 1.0
        if scale < 1:
            image = image.resize(scale)
        if image.hasalpha():
            image = image.flatten(background=[65535 if image.format == "ushort" else 255])
        if icc is not None:
            image = image.copy()
            set_blob(image, "icc-profile-data", icc)
            image = image.icc_transform("srgb", embedded=True, depth=16 if image.format == "ushort" else 8)
        image = to_8_bits(standard(image))
        colour = image if image.bands == 3 else image[0].bandjoin([image[0], image[0]])
        return np.ascontiguousarray(orientation.upright(computed(standard(colour))))
