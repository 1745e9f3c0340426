"""From a Motion to pixels: the sampling map, the warp in both directions, and the picture's edges.

Nothing is computed before the result is written or looked at: libvips then works tile by tile, so that
memory does not grow with the picture.

Convention: everything here takes and gives **stored** pixels (readout.py); positions are (col, row),
pixel centres at whole numbers. A position lies *inside* a picture of W columns and H rows when
0 <= col <= W - 1 and 0 <= row <= H - 1 (within the 0.01 px to which the map is exact).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion
from unshutter.sampling_map import SamplingGrid, gs_to_rs_map, rs_to_gs_map

if TYPE_CHECKING:
    import pyvips

Edges = Literal["keep", "crop", "fill"]
EDGES = get_args(Edges)
_LEAST_CROP = 0.1  # of the photo's area
_CROP_SEARCH_CELLS = 1_000_000


def rectify_image(image: pyvips.Image, motion: Motion, edges: Edges = "keep") -> pyvips.Image:
    """The global-shutter picture of a rolling-shutter photo, bicubic (Catmull-Rom), lazily.

    Args:
        image: stored pixels, any bands and bit depth, opened for random access; with alpha, colours are
            interpolated premultiplied. Metadata is carried over.
        motion: the photo's motion, for exactly its size.
        edges: for pixels whose RS position lies outside the photo: ``keep`` makes them black (and alpha
            0), ``crop`` cuts the largest upright rectangle of the photo's aspect without them, ``fill``
            repeats the nearest border pixel.

    Returns:
        An image of the same size (smaller for ``crop``), format, bands and interpretation; ``image``
        itself when the motion is zero.

    Raises:
        UnshutterError: the motion is of another size, turns faster than rows are read, or ``crop`` would
            leave less than a tenth of the photo.
        UsageError: unknown ``edges``.
    """
    if edges not in EDGES:
        raise UsageError(f"unknown edges '{edges}': choose keep, crop or fill")
    _check_size(image, motion)
    if motion.is_zero:
        return image
    grid = SamplingGrid.of(gs_to_rs_map(motion), image.height, image.width)
    if edges == "keep":
        return grid.inside.ifthenelse(_sample(image, grid.index, "bicubic"), 0)
    if edges == "fill":
        cols, rows = grid.reach_beyond()
        wide = image.embed(cols, rows, image.width + 2 * cols, image.height + 2 * rows, extend="copy")
        return _sample(wide, grid.moved(cols, rows).index, "bicubic")
    left, top, width, height = largest_valid_rectangle(_mask(grid))
    if width * height < _LEAST_CROP * image.width * image.height:
        raise UnshutterError(
            f"cropping would leave {100 * width * height / (image.width * image.height):.0f} % of the photo: "
            "use other edges, keep or fill"
        )
    return _sample(image, grid.index, "bicubic").crop(left, top, width, height)


def distort_image(image: pyvips.Image, motion: Motion) -> pyvips.Image:
    """The rolling-shutter picture of a global-shutter one, bilinear, lazily: the synthesis of training pairs.

    Each RS pixel shows the GS picture at its GS position (closed form); outside it is black, alpha 0.

    Args:
        image: stored pixels, any bands and bit depth.
        motion: for exactly the image's size.

    Raises:
        UnshutterError: the motion is of another size or turns faster than rows are read.
    """
    _check_size(image, motion)
    if motion.is_zero:
        return image
    grid = SamplingGrid.of(rs_to_gs_map(motion), image.height, image.width)
    return grid.inside.ifthenelse(_sample(image, grid.index, "bilinear"), 0)


def backward_map(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """RS position of every GS pixel, as ``cv2.remap`` takes it.

    Returns:
        (col, row), each float32 [H, W] in stored orientation [px], exact to 0.01 px inside the photo.
    """
    size = motion.readout.frame_size(motion.height, motion.width)
    index = SamplingGrid.of(gs_to_rs_map(motion), *size).index.numpy().reshape(*size, 2)
    return np.ascontiguousarray(index[..., 0]), np.ascontiguousarray(index[..., 1])


def validity_mask(motion: Motion) -> np.ndarray:
    """Which pixels of the rectified picture exist in the photo.

    Returns:
        bool [H, W] in stored orientation: True where the RS position lies inside the photo.
    """
    size = motion.readout.frame_size(motion.height, motion.width)
    return _mask(SamplingGrid.of(gs_to_rs_map(motion), *size))


def largest_valid_rectangle(mask: np.ndarray) -> tuple[int, int, int, int]:
    """The largest upright rectangle of True pixels with the mask's aspect, the nearest to the centre.

    Exact up to a million pixels; above, the mask is searched in blocks all of whose pixels are True,
    which loses a few pixels (at 12 megapixels up to 8 of 4000).

    Args:
        mask: bool [H, W].

    Returns:
        (left, top, width, height) [px]; width and height 0 where nothing is True.
    """
    height, width = mask.shape
    block = int(np.ceil(np.sqrt(height * width / _CROP_SEARCH_CELLS)))
    rows, cols = height // block, width // block
    whole = mask[: rows * block, : cols * block].reshape(rows, block, cols, block).all(axis=(1, 3))
    filled = np.pad(whole.astype(np.int64).cumsum(0).cumsum(1), ((1, 0), (1, 0)))

    def size_at(blocks_long: int) -> tuple[int, int]:  # px
        if width >= height:
            w = min(blocks_long * block, width)
            return w, max(round(w * height / width), 1)
        h = min(blocks_long * block, height)
        return max(round(h * width / height), 1), h

    def places_at(blocks_long: int) -> np.ndarray:  # [N, 2] top and left block of the rectangles that fit
        w, h = (-(-side // block) for side in size_at(blocks_long))
        count = filled[h:, w:] - filled[:-h, w:] - filled[h:, :-w] + filled[:-h, :-w]
        return np.argwhere(count == h * w)

    fits, too_long = 0, max(rows, cols) + 1  # a rectangle that fits contains every smaller one
    while too_long - fits > 1:
        middle = (fits + too_long) // 2
        fits, too_long = (middle, too_long) if len(places_at(middle)) else (fits, middle)
    if fits == 0:
        return 0, 0, 0, 0
    (w, h), places = size_at(fits), places_at(fits) * block
    top, left = min(places.tolist(), key=lambda p: (p[0] + h / 2 - height / 2) ** 2 + (p[1] + w / 2 - width / 2) ** 2)
    return left, top, w, h


def _check_size(image: pyvips.Image, motion: Motion) -> None:
    height, width = motion.readout.frame_size(motion.height, motion.width)
    if (image.height, image.width) != (height, width):
        raise UnshutterError(
            f"the motion is for a picture of {width}x{height} px but this one has {image.width}x{image.height} px: "
            "resize the motion, or choose the readout direction it was found with"
        )


def _mask(grid: SamplingGrid) -> np.ndarray:
    return grid.inside.numpy().reshape(grid.height, grid.width) > 0


def _sample(image: pyvips.Image, index: pyvips.Image, interpolation: str) -> pyvips.Image:
    """The picture at the positions of a map; both directions of the warp end here."""
    import pyvips

    alpha = bool(image.hasalpha())
    # Not left to mapim: it takes the alpha of 16-bit pixels that are not marked so for 8-bit, and truncates.
    top = {"max_alpha": 65535} if image.format == "ushort" else {}
    source = image.premultiply(**top) if alpha else image
    # extend="copy": the border's pixels take no black into their interpolation
    out = source.mapim(index, interpolate=pyvips.Interpolate.new(interpolation), extend="copy", premultiplied=alpha)
    if alpha:
        out = out.unpremultiply(**top)
        out = out if image.format in ("float", "double") else out.rint()
        out = out.cast(image.format).copy(interpretation=image.interpretation)
    return out
