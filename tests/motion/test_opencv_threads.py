"""The host's OpenCV keeps its number of threads, whatever unshutter does in however many threads."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.drawn_photos import drawn
from unshutter import RowMotion, UnshutterError
from unshutter.motion.opencv_threads import no_opencv_threads

MOTION = RowMotion.from_polynomials([0, 20], [0], 200, 300)


@pytest.fixture(autouse=True)
def three_threads():
    before = cv2.getNumThreads()
    cv2.setNumThreads(3)
    yield
    assert cv2.getNumThreads() == 3
    cv2.setNumThreads(before)


def test_photos() -> None:
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda _: unshutter.rectify(drawn(200, 300), motion=MOTION).array, range(8)))
        list(threads.map(lambda _: unshutter.rectify(drawn(200, 300)).array, range(4)))


def test_blocks_in_one_another() -> None:
    with no_opencv_threads():
        with pytest.raises(UnshutterError), no_opencv_threads():
            raise UnshutterError
        assert cv2.getNumThreads() == 1


def test_clips(tmp_path: Path) -> None:
    pytest.importorskip("av")
    with pytest.raises(UnshutterError):
        unshutter.rectify_clip(tmp_path / "none.mp4", tmp_path / "out.mp4")
    frames = [np.roll(drawn(200, 300), k, axis=1) for k in range(6)]
    assert len(list(unshutter.rectify_clip_frames(frames, readout_ratio=0.5))) == 6
