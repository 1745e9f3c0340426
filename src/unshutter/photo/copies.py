"""Reduced copies of a picture: grey ones for finding motion, 8-bit sRGB ones for screens."""

from __future__ import annotations

from typing import TYPE_CHECKING

from unshutter.photo.libvips import computed, in_srgb, libvips, refusing, standard, to_8_bits

if TYPE_CHECKING:
    import numpy as np
    import pyvips

    from unshutter.geometry.readout import Orientation

_BEHIND = 128  # grey level under transparent areas of small copies


def upright(image: pyvips.Image, icc: bytes | None, orientation: Orientation, longest_px: int = 0) -> np.ndarray:
    """Renders a picture as shown by a viewer.

    Args:
        image: stored pixels, 1 to 4 bands; transparent areas are shown on white.
        icc: its colour profile; None: sRGB.
        orientation: orientation of the stored pixels.
        longest_px: long side to which the picture is reduced; 0: full size.

    Returns:
        [H, W, 3] uint8 RGB, read-only.

    Raises:
        UnshutterError: libvips fails.
    """
    import numpy as np

    with refusing("cannot show the picture"):
        scale = longest_px / max(image.width, image.height) if longest_px else 1.0
        if scale < 1:
            image = image.resize(scale)
        if image.hasalpha():
            image = image.flatten(background=[65535 if image.format == "ushort" else 255])
        if icc is not None:
            image = in_srgb(image, icc)
        image = to_8_bits(standard(image))
        colour = image if image.bands == 3 else image[0].bandjoin([image[0], image[0]])
        return np.ascontiguousarray(orientation.upright(computed(standard(colour))))


def screen_pixels(image: pyvips.Image, height: int, width: int, profile: bytes | None) -> np.ndarray:
    """Returns [height, width, 3] uint8 sRGB of the stored pixels of an image, scaled to that size.

    Args:
        image: image of 1 to 4 bands, 8 or 16 bits.
        height, width: size [px], not larger than the image; transparent areas become grey.
        profile: its ICC profile; without one, or with one that does not fit, the colours count as sRGB.

    Raises:
        UnshutterError: libvips fails.
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
    missing = height - pixels.shape[0], width - pixels.shape[1]  # at most a row or column, due to rounding
    if any(missing):
        pixels = np.pad(pixels, ((0, max(missing[0], 0)), (0, max(missing[1], 0)), (0, 0)), mode="edge")
    return np.ascontiguousarray(pixels[:height, :width])


def _in_srgb(image: pyvips.Image, profile: bytes | None) -> pyvips.Image:
    """Converts the image to 8-bit sRGB; grey stays grey if it has no usable profile."""
    if profile is not None:
        try:
            return _computed(in_srgb(standard(image), profile, bits=8))
        except libvips().Error:  # damaged, or for other colours: programs then assume sRGB
            libvips().vips_lib.vips_error_clear()
    return to_8_bits(image)


def _computed(image: pyvips.Image) -> pyvips.Image:
    """Computes the image's pixels now, so that failures occur here."""
    return libvips().Image.new_from_memory(image.write_to_memory(), image.width, image.height, image.bands, "uchar")


def grey_size(height: int, width: int, short_side: int | None) -> tuple[int, int]:
    """Returns height and width of the grey copy of a picture."""
    scale = 1.0 if short_side is None else min(short_side / min(height, width), 1.0)
    return max(round(height * scale), 1), max(round(width * scale), 1)


def grey_copy(
    image: pyvips.Image, height: int, width: int, vscale: float | None = None, hscale: float | None = None
) -> np.ndarray:
    """Returns the luminance [height, width] uint8 of an image, scaled by the factors or, by default, to that size."""
    import numpy as np

    vscale, hscale = vscale or height / image.height, hscale or width / image.width
    with refusing("cannot compute the grey copy"):
        if image.hasalpha():
            image = image.flatten(background=[32896 if image.format == "ushort" else 128])
        if image.format == "ushort":
            image = standard(image.cast("uchar", shift=True))  # first, because the rest then takes a third of the time
        if (hscale, vscale) != (1.0, 1.0):
            image = image.embed(*(0, 0, _aligned(image.width, hscale), _aligned(image.height, vscale)), extend="copy")
            image = image.resize(hscale, vscale=vscale, kernel="mitchell")  # little ringing: no ghosts next to edges
        pixels = image.numpy()[:height, :width]
    if pixels.ndim == 3:
        import cv2

        pixels = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    missing = (height - pixels.shape[0], width - pixels.shape[1])
    return np.ascontiguousarray(np.pad(pixels, ((0, missing[0]), (0, missing[1])), mode="edge"))


def _aligned(size: int, scale: float) -> int:
    """Enlarges a size slightly so that it scales to whole pixels: libvips shifts any difference to both sides."""
    return min(range(size, size + 16), key=lambda padded: abs(padded * scale - round(padded * scale)))
