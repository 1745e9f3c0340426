"""The square in the middle of a photo, and the photo's motion from the square's."""

import numpy as np
import pytest

from unshutter import View
from unshutter.options import Camera
from unshutter.photo import Photo
from unshutter_lab.methods.networks import SIZE, corner_of, motion_of_square, side_of, square_of


def test_the_square_is_the_middle_of_the_readout_frame() -> None:
    pixels = np.zeros((SIZE, 400, 3), np.uint8)
    pixels[:, 72 : 72 + SIZE] = np.arange(SIZE, dtype=np.uint8)[:, None, None]  # brighter from row to row
    view = View(Photo.from_array(pixels))
    assert (side_of(view), corner_of(view)) == (SIZE, (72, 0))
    square = square_of(view)
    assert (square.shape, square.dtype) == ((1, 3, SIZE, SIZE), np.float32)
    np.testing.assert_allclose(square[0, 1], np.broadcast_to(np.arange(SIZE)[:, None] / 255, (SIZE, SIZE)))
    turned = square_of(View(Photo.from_array(pixels), Camera("bottom-to-top")))
    np.testing.assert_array_equal(turned, square[..., ::-1, ::-1])


@pytest.mark.parametrize(("shape", "grey"), [((100, 300), 128 / 255), ((512, 300, 2), 128 / 255)])
def test_grey_photos_of_any_size_fill_it(shape: tuple[int, ...], grey: float) -> None:
    square = square_of(View(Photo.from_array(np.full(shape, 128, np.uint8))))
    np.testing.assert_allclose(square, np.full((1, 3, SIZE, SIZE), grey), rtol=1e-6)


@pytest.mark.parametrize("degree", [None, 1])
def test_a_motion_goes_on_beyond_the_square(degree: int | None) -> None:
    """A photo twice as large and with 100 rows more at both ends: t_x doubles, slopes per row halve or stay."""
    view = View(Photo.from_array(np.zeros((712, 512), np.uint8)))
    rows = np.arange(0, SIZE, 18)
    motion = motion_of_square(view, rows, np.stack([0.1 * rows, 0.001 * rows]), "me", degree)
    assert (motion.height, motion.width, motion.estimator) == (712, 512, "me")
    np.testing.assert_allclose(np.diff(motion.tx_px), 0.1, atol=1e-9)
    np.testing.assert_allclose(np.diff(motion.rz_rad), 0.0005, atol=1e-9)
    assert np.interp(100.5, np.arange(712), motion.tx_px) == pytest.approx(0)  # the middle of the square's first row
