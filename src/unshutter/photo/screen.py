"""Copies of pictures for screens: small, 8 bits, sRGB."""

from __future__ import annotations

from typing import TYPE_CHECKING

from unshutter.photo.libvips import libvips, refusing, set_blob, standard, to_8_bits

if TYPE_CHECKING:
    import numpy as np  # not imported above: reading a file, which starts first, can do without
    import pyvips

_BEHIND = 128  # grey level behind transparent places


def screen_pixels(image: pyvips.Image, height: int, width: int, profile: bytes | None) -> np.ndarray:
    """[height, width, 3] uint8 sRGB of an image, scaled to that size.

    Args:
        image: of 1 to 4 bands, 8 or 16 bits.
        height, width: [px], not larger than the image.
        profile: ICC profile of its colours; None, or one that does not fit them: sRGB.

    Raises:
        UnshutterError: libvips refuses.
    """
    import numpy as np

    with refusing("cannot compute the copy for the screen"):
        if image.hasalpha():
            image = image.flatten(background=[_BEHIND * (257 if image.format == "ushort" else 1)])
        if (image.height, image.width) != (height, width):
            image = image.resize(width / image.width, vscale=height / image.height, kernel="mitchell")
        image = _in_srgb(image, profile)
        if image.bands == 1:
            image = image.bandjoin([image, image])
        pixels = image.numpy()
    missing = height - pixels.shape[0], width - pixels.shape[1]  # at most a row or column, by rounding
    if any(missing):
        pixels = np.pad(pixels, ((0, max(missing[0], 0)), (0, max(missing[1], 0)), (0, 0)), mode="edge")
    return np.ascontiguousarray(pixels[:height, :width])


def _in_srgb(image: pyvips.Image, profile: bytes | None) -> pyvips.Image:
    """The image in 8-bit sRGB, or grey where it has no profile of its own."""
    if profile is not None:
        image = standard(image).copy()
        set_blob(image, "icc-profile-data", profile)
        try:
            return _computed(image.icc_transform("srgb", embedded=True, depth=8))
        except libvips().Error:  # damaged, or for other colours: programs then take them for sRGB
            libvips().vips_lib.vips_error_clear()
            image.remove("icc-profile-data")
    return to_8_bits(image)


def _computed(image: pyvips.Image) -> pyvips.Image:
    """The image with all pixels there: only then it is known whether they could be computed."""
    return libvips().Image.new_from_memory(image.write_to_memory(), image.width, image.height, image.bands, "uchar")
