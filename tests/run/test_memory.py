"""Memory stays flat, however many photos a process works on."""

import gc
import os
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest

from support.batches import start_rectify
from support.covering import thorough
from support.drawn_photos import textured
from unshutter import Motion, RowMotion
from unshutter.motion.warp import straighten
from unshutter.photo import Photo

HEIGHT, WIDTH = 300, 400


@pytest.fixture
def motion() -> Motion:
    return RowMotion.from_polynomials([0, 6, -9], [0, 0.05], HEIGHT, WIDTH)


def test_pictures_go_when_nobody_needs_them(motion: Motion) -> None:
    """Not only when the interpreter looks for cycles, which it does so rarely that many large photos pile up."""
    gc.disable()
    try:
        pixels = textured(HEIGHT, WIDTH)
        result = straighten(pixels, motion)[0]
        kept = [weakref.ref(pixels), weakref.ref(result)]
        del pixels, result
        assert [ref() is None for ref in kept] == [True, True]
    finally:
        gc.enable()


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the peak memory of a child process")
@pytest.mark.parametrize("given", [True, thorough(False)], ids=["with a motion", "with estimates"])
def test_many_photos_need_no_more_than_few(
    given: bool, motion: Motion, rolling_facade: np.ndarray, tmp_path: Path
) -> None:
    """Two are held at a time, the next one's estimate with it.

    Slow, because a leak shows only over many photos.
    """
    Photo.from_array(textured(HEIGHT, WIDTH) if given else rolling_facade).save(tmp_path / "photo.jpg")
    motion.save(tmp_path / "motion.json")
    how = ["--motion", tmp_path / "motion.json"] if given else []
    peaks = []
    for count in (10, 40) if given else (6, 20):  # more pixels in each of the latter
        folder = tmp_path / str(count)
        folder.mkdir()
        for k in range(count):
            (folder / f"{k}.jpg").write_bytes((tmp_path / "photo.jpg").read_bytes())
        process = start_rectify(folder, "-o", tmp_path / f"out{count}", "--json-log", tmp_path / "log", *how)
        process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        process.stdout.close()
        process.stderr.close()
        assert process.returncode == 0
        peaks.append(usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3))  # MB
    assert np.diff(peaks) < 6  # the pixels of the other photos are 10 to 11 MB
