"""A small archive, and a motion that changes every photo in it."""

from pathlib import Path

import pytest

from support.batches import make_motion, make_photos
from support.stores import folder, memory

__all__ = ["archive", "folder", "memory", "motion"]

NAMES = ["a.jpg", "b.png", "trip/a.jpg", "trip/day 2/c.webp"]


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    folder = tmp_path / "archive"
    make_photos(folder, NAMES)
    return folder


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    return make_motion(tmp_path / "motion.json")
