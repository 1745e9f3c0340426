"""Switches OpenCV's own threads off while others run, and restores the host's setting afterwards."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

import cv2

_lock = Lock()
_blocks = 0  # that run now, in any thread
_usual = 0  # the host's number of threads, while there are any


@contextmanager
def no_opencv_threads() -> Iterator[None]:
    """Keeps OpenCV from starting threads in this process until the last of these blocks ends; also a decorator."""
    global _blocks, _usual
    with _lock:
        if not _blocks:
            _usual = cv2.getNumThreads()
            cv2.setNumThreads(1)
        _blocks += 1
    try:
        yield
    finally:
        with _lock:
            _blocks -= 1
            if not _blocks:
                cv2.setNumThreads(_usual)
