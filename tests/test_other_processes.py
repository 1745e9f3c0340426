"""Photos, results and estimators on their way to other processes; and processes that are forked."""

import multiprocessing
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.drawn_photos import drawn
from unshutter.photo import Photo

MOTION = unshutter.RowMotion.from_polynomials([0, 9], [0], 120, 160)


@pytest.mark.parametrize("ending", ["jpg", "png", "webp", "tif", "avif"])
def test_results_and_photos_can_be_pickled(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    Photo.from_array(drawn(120, 160)).save(path)
    result = unshutter.rectify(path, motion=MOTION)
    again = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(again.pixels, result.pixels)
    np.testing.assert_array_equal(again.original.pixels, result.original.pixels)
    assert (again.motion, again.verdict, repr(again)) == (result.motion, result.verdict, repr(result))
    assert again.encode() == result.encode()
    in_memory = pickle.loads(pickle.dumps(Photo.from_bytes(path.read_bytes())))
    np.testing.assert_array_equal(in_memory.pixels, result.original.pixels)


@pytest.mark.parametrize(
    "name", ["segment-manhattan", "segment-transformer", "kandula2020", "kandula2020-research", "manhattan", "none"]
)
def test_estimators_can_be_pickled_before_and_after_use(name: str, rolling_facade: np.ndarray) -> None:
    estimator = unshutter.load(name)
    expected = unshutter.estimate(rolling_facade, estimator=estimator)
    again = pickle.loads(pickle.dumps(estimator))
    assert (again.name, again.weights) == (estimator.name, estimator.weights)
    assert unshutter.estimate(rolling_facade, estimator=again) == expected


def test_motions_are_short_in_words_equal_by_value_and_pickled() -> None:
    rotations = unshutter.RotationMotion(width=160, rotations=np.zeros((120, 3)), focal_px=100.0)
    for motion in (MOTION, rotations):
        assert len(repr(motion)) < 120
        assert pickle.loads(pickle.dumps(motion)) == motion
        assert motion != motion.resized(240, 320)


FORKING = """
import multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor
import unshutter
from unshutter.photo import Photo

def width(path):
    try:
        return str(Photo.open(path).pixels.shape[1])
    except unshutter.UsageError as error:
        return str(error)

if __name__ == "__main__":
    method, use, path = sys.argv[1:]
    if use == "used":
        Photo.open(path).pixels
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as pool:
        print(*set(pool.map(width, [path] * 4)), sep="\\n")
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.parametrize(("method", "use"), [("fork", "used"), ("fork", "unused"), ("spawn", "used")])
def test_a_fork_after_use_says_no_instead_of_hanging(method: str, use: str, tmp_path: Path) -> None:
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip("not here")
    path, program = tmp_path / "a.jpg", tmp_path / "forking.py"
    Photo.from_array(drawn(120, 160)).save(path)
    program.write_text(FORKING)
    words = [sys.executable, str(program), method, use, str(path)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=120)
    refused = (method, use) == ("fork", "used")
    assert ("libvips does not support" in done.stdout) == refused, done.stdout
    assert refused or done.stdout == "160\n"
