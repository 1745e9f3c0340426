import numpy as np
import pytest

from support.stored import as_stored
from unshutter import ScanDirection, UsageError
from unshutter.orientation import scene_up

FIRST_LINE = {  # which line of the stored pixels is read first
    "top-to-bottom": lambda a: a[0, :],
    "bottom-to-top": lambda a: a[-1, :],
    "left-to-right": lambda a: a[:, 0],
    "right-to-left": lambda a: a[:, -1],
}


@pytest.mark.parametrize("readout", list(ScanDirection))
def test_the_line_read_first_becomes_the_top_row(readout: ScanDirection) -> None:
    stored = np.arange(12).reshape(3, 4)
    frame = readout.to_scan_frame(stored)
    assert frame.shape == readout.frame_size(3, 4)
    assert sorted(frame[0]) == sorted(FIRST_LINE[readout.value](stored))
    np.testing.assert_array_equal(as_stored(frame, readout), stored)


@pytest.mark.parametrize("readout", list(ScanDirection))
def test_points_follow_the_pixels(readout: ScanDirection) -> None:
    stored = np.arange(12).reshape(3, 4)
    frame = readout.to_scan_frame(stored)
    row, col = np.mgrid[0:3, 0:4]
    frame_col, frame_row = readout.points_to_frame(col, row, 3, 4)
    np.testing.assert_array_equal(frame[frame_row, frame_col], stored)
    back = readout.points_to_stored(frame_col, frame_row, 3, 4)
    np.testing.assert_array_equal(back, (col, row))


def test_words() -> None:
    assert ScanDirection.parse("auto") is ScanDirection.TOP_TO_BOTTOM
    assert ScanDirection.parse("right-to-left") is ScanDirection.RIGHT_TO_LEFT
    with pytest.raises(UsageError, match="top-to-bottom"):
        ScanDirection.parse("up")


def exif_upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """What a viewer shows, by the EXIF standard's table (row 0 and column 0 of the stored pixels are ...)."""
    return {
        1: pixels,
        2: pixels[:, ::-1],
        3: pixels[::-1, ::-1],
        4: pixels[::-1],
        5: pixels.transpose(1, 0),
        6: pixels.transpose(1, 0)[:, ::-1],
        7: pixels[::-1, ::-1].transpose(1, 0),
        8: pixels.transpose(1, 0)[::-1],
    }[orientation]


@pytest.mark.parametrize("readout", list(ScanDirection))
@pytest.mark.parametrize("orientation", range(1, 9))
def test_scene_up_points_to_the_top_of_what_a_viewer_shows(orientation: int, readout: ScanDirection) -> None:
    stored = np.arange(12).reshape(3, 4)
    top = set(exif_upright(stored, orientation)[0])
    right, down = scene_up(orientation, readout)
    frame = readout.to_scan_frame(stored)
    edge = {(0, -1): frame[0], (0, 1): frame[-1], (-1, 0): frame[:, 0], (1, 0): frame[:, -1]}[right, down]
    assert set(edge) == top
