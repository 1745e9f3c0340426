"""Pictures for the tests: drawn, or made from the photo that the repository ships."""

from __future__ import annotations

import gc
import os
import signal
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command line has it: two threads round differently from one
# libraries' other threads, too: those of several tests at a time would mostly wait for one another, and wait busily
os.environ.update(OMP_NUM_THREADS="1", OPENCV_FOR_THREADS_NUM="1")

import cv2
import numpy as np
import pytest

from support.checked import check_shapes

if TYPE_CHECKING:
    from unshutter import Motion

os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # of the onnxruntime that some tests import themselves
check_shapes()  # of modules that are imported from here on
# Before tests import pyvips themselves: its handler of libvips's log, which unshutter removes, may collect garbage, and
# the process is aborted if that makes libvips warn once more.
import_module("unshutter.photo.libvips").libvips()


def _hear_signals() -> None:
    """Programs that the tests start hear what nohup and a shell's background would have them ignore.

    A program ignores what its parent ignores, but not what its parent has a handler for.
    """
    for name in ("SIGINT", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, lambda *_: None)


_hear_signals()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="also run the tests marked thorough: make test-all")


def pytest_xdist_auto_num_workers() -> int:
    """One worker more than processors: tests often wait, for a browser and for programs that they start."""
    return 1 + (os.cpu_count() or 1)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leaves out the thorough tests, unless all are wanted."""
    if config.getoption("--all"):
        return
    left_out = [item for item in items if item.get_closest_marker("thorough")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not item.get_closest_marker("thorough")]


def pytest_collection_finish() -> None:
    """Modules and tests stay until the end: nothing among them is looked for that nobody needs."""
    gc.freeze()


def draw_facade(height: int = 420, width: int = 560) -> np.ndarray:
    """A house front with windows, seen straight on: uint8 RGB."""
    big = np.full((2 * height, 2 * width, 3), 215, np.uint8)
    cv2.rectangle(big, (0, 0), (2 * width, height // 3), (150, 180, 220), -1)  # sky
    left, right, top = width // 5, 2 * width - width // 5, height // 4
    cv2.rectangle(big, (left, top), (right, 2 * height - 60), (180, 150, 120), -1)
    for row in np.linspace(top + 50, 2 * height - 260, 4).astype(int):
        for col in np.linspace(left + 40, right - 140, 6).astype(int):
            cv2.rectangle(big, (col, row), (col + 90, row + 120), (60, 70, 90), -1)
            cv2.rectangle(big, (col, row), (col + 90, row + 120), (235, 235, 230), 6)
            cv2.line(big, (col + 45, row), (col + 45, row + 120), (235, 235, 230), 5)
    noise = np.random.default_rng(0).normal(0, 4, (height, width, 3))
    small = cv2.resize(big, (width, height), interpolation=cv2.INTER_AREA)
    return np.clip(small + noise, 0, 255).astype(np.uint8)


MARGIN = 90  # px around what is kept: what the motion brings into view


@pytest.fixture(scope="session")
def facade_canvas() -> np.ndarray:
    return draw_facade(420 + 2 * MARGIN, 560 + 2 * MARGIN)


@pytest.fixture(scope="session")
def facade(facade_canvas: np.ndarray) -> np.ndarray:
    """420 x 560 px, undistorted."""
    return facade_canvas[MARGIN:-MARGIN, MARGIN:-MARGIN].copy()


@pytest.fixture(scope="session")
def facade_motion() -> Motion:
    from unshutter import RowMotion

    return RowMotion.from_polynomials([0, 50, -90], [0, 0.05], 420, 560)


@pytest.fixture(scope="session")
def rolling_facade(facade_canvas: np.ndarray, facade_motion: Motion) -> np.ndarray:
    """The facade as a rolling shutter would have taken it: the motion goes on beyond the rows that are kept."""
    from unshutter import RowMotion
    from unshutter.motion.warp import distort_pixels
    from unshutter.photo import Photo

    rows = np.arange(-MARGIN, 420 + MARGIN)
    tx, rz = (
        np.polynomial.Polynomial.fit(np.arange(420), a, 2)(rows) for a in (facade_motion.tx_px, facade_motion.rz_rad)
    )
    whole = RowMotion(facade_canvas.shape[1], tx, rz)
    photo = Photo.from_array(facade_canvas)
    distorted = distort_pixels(photo.pixels, whole)
    return distorted[MARGIN:-MARGIN, MARGIN:-MARGIN].copy()


@pytest.fixture(scope="session")
def rolling_facade_jpeg(rolling_facade: np.ndarray) -> bytes:
    from unshutter.photo import Photo

    return Photo.from_array(rolling_facade).to_bytes("jpeg", quality=92)


@pytest.fixture
def photo(tmp_path: Path, rolling_facade_jpeg: bytes) -> Path:
    """street.jpg, the rolling facade as a file."""
    path = tmp_path / "street.jpg"
    path.write_bytes(rolling_facade_jpeg)
    return path


@pytest.fixture(scope="session")
def basilica() -> tuple[np.ndarray, Motion]:
    """The shipped photo's middle, 490 x 490 px, with a strong motion put in; and that motion."""
    from unshutter.photo import Photo
    from unshutter_lab.synthesis.pairs import synthesize_native
    from unshutter_lab.synthesis.row_motions import draw_quadratic

    original = Photo.open(Path(__file__).parent / "examples" / "original" / "basilica.webp").to_array()
    rs, _, motion = synthesize_native(original, draw_quadratic(np.random.default_rng(5)))
    return rs, motion
