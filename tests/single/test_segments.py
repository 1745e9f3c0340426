import numpy as np
import pytest

from unshutter.single.likelihood import find_segments, in_rows, unusable


def test_segments_of_a_drawn_edge_lie_on_it() -> None:
    """Dark up to column 99, bright from column 100: the edge is at 99.5, pixel centres at whole numbers."""
    grey = np.zeros((200, 160), np.uint8)
    grey[:, 100:] = 255
    for picture, edge in ((grey, slice(0, 4, 2)), (np.ascontiguousarray(grey.T), slice(1, 4, 2))):
        (found,) = find_segments(picture)
        np.testing.assert_allclose(found[edge], 99.5, atol=0.1)


def test_segments_come_longest_first_and_in_rows() -> None:
    grey = np.zeros((200, 300), np.uint8)
    grey[20:180, 40:60] = 255
    grey[50:100, 200:280] = 200
    found = find_segments(grey)
    lengths = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
    assert (np.diff(lengths) <= 0).all()
    np.testing.assert_array_equal(find_segments(grey, 2), found[:2])
    corners = in_rows(np.array([[0.0, 0.0, 299.0, 199.0]]), 200, 300)
    np.testing.assert_allclose(corners, [[-149.5 / 200, -99.5 / 200, 149.5 / 200, 99.5 / 200]])
    assert find_segments(np.zeros((64, 64), np.uint8)).shape == (0, 4)


@pytest.mark.parametrize(
    ("count", "height", "width", "reason"),
    [(8, 400, 1000, ""), (7, 400, 1000, "only 7 straight segments"), (8, 400, 1001, "2.5"), (8, 1001, 400, "2.5")],
)
def test_too_few_segments_and_panoramas_cannot_be_used(count: int, height: int, width: int, reason: str) -> None:
    found = unusable(np.zeros((count, 4)), height, width)
    assert reason in str(found or "")
    assert bool(reason) == (found is not None)
