import numpy as np
import pytest

from unshutter.errors import UsageError
from unshutter.frames.frame_motion import Timing


def test_rows_are_exposed_one_after_the_other() -> None:
    timing = Timing(0.8, 100)
    np.testing.assert_allclose(timing.exposed(3, np.array([0, 50, 100])), [3, 3.4, 3.8])


@pytest.mark.parametrize(("reference", "moment"), [("first", 2.0), ("middle", 2.4), ("last", 2.8)])
def test_moments_of_reference_rows(reference, moment) -> None:
    assert Timing(0.8, 100).moment(reference, 2) == pytest.approx(moment)


def test_a_copy_has_the_clock_of_the_frames() -> None:
    timing = Timing(0.6, 100)
    copy = timing.of_copy(25)
    # the centre of row 3 of the copy lies between rows 13 and 14 of the frame
    assert copy.exposed(1, np.array(3.0)) == pytest.approx(float(timing.exposed(1, np.array(13.5))))


@pytest.mark.parametrize("ratio", [0, -0.5, 1.01, float("nan")])
def test_ratios_that_cannot_be(ratio) -> None:
    with pytest.raises(UsageError, match="above 0 and at most 1"):
        Timing(ratio, 100)
