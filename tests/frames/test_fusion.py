import numpy as np
import pytest

from unshutter.frames.frame_motion import Timing
from unshutter.frames.neighbours import Warped, fuse
from unshutter.motion.grid import SamplingGrid

HEIGHT, WIDTH = 20, 30
TIMING = Timing(1e-6, HEIGHT)  # nearly a global shutter: frame k is of the moment k


def warped(frame, grey, shift=0.0, dtype=np.uint8):
    """A frame of one grey whose pixels were looked up some columns farther right."""
    grid = SamplingGrid.of(lambda col, row: (col + shift, row), HEIGHT, WIDTH)
    return Warped(np.full((HEIGHT, WIDTH, 3), grey, dtype), grid, frame)


def test_frames_that_agree_are_averaged_by_nearness() -> None:
    picture, valid = fuse(warped(0, 100), [warped(1, 104)], TIMING, 0.2, borrow=False)
    shares = np.array([0.2**-0.7, 0.8**-0.7])
    assert valid.all()
    np.testing.assert_allclose(picture, shares @ [100, 104] / shares.sum(), atol=0.6)
    assert 100 < picture[0, 0, 0] < 102


@pytest.mark.parametrize(("moment", "nearest"), [(0.3, 20), (0.7, 220)])
def test_where_they_do_not_the_nearest_alone_is_taken(moment, nearest) -> None:
    picture, _ = fuse(warped(0, 20), [warped(1, 220)], TIMING, moment, borrow=False)
    np.testing.assert_array_equal(picture, nearest)


def test_of_three_frames_the_nearest_two_may_agree() -> None:
    picture, _ = fuse(warped(0, 100), [warped(-1, 250), warped(1, 100)], TIMING, 0.4, borrow=False)
    np.testing.assert_array_equal(picture, 100)


def test_what_the_frame_did_not_see_is_borrowed_or_stays() -> None:
    unseen = np.arange(WIDTH) + 10 > WIDTH - 1
    picture, valid = fuse(warped(0, 100, shift=10), [warped(1, 180)], TIMING, 0.4, borrow=False)
    np.testing.assert_array_equal(valid, np.broadcast_to(~unseen, valid.shape))
    np.testing.assert_array_equal(picture[:, unseen], 100)  # as it came
    borrowed, valid = fuse(warped(0, 100, shift=10), [warped(1, 180)], TIMING, 0.4, borrow=True)
    assert valid.all()
    np.testing.assert_array_equal(borrowed[:, unseen], 180)


def test_16_bits_are_not_lost() -> None:
    picture, _ = fuse(
        warped(0, 40_001, dtype=np.uint16), [warped(1, 40_001, dtype=np.uint16)], TIMING, 0.5, borrow=False
    )
    np.testing.assert_array_equal(picture, 40_001)
