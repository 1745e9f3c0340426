"""A folder of files, and one of objects in memory."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from unshutter.storage.locations import Place, place


@pytest.fixture
def memory():
    if find_spec("upath") is None:
        pytest.skip("needs unshutter[dask]")
    from fsspec.implementations.memory import MemoryFileSystem

    MemoryFileSystem.store.clear()
    yield place("memory://archive")
    MemoryFileSystem.store.clear()


@pytest.fixture(params=["files", "objects"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Place:
    return tmp_path if request.param == "files" else request.getfixturevalue("memory")
