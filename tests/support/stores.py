"""A folder of files, and one of objects in memory."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from unshutter.storage.objects import path_of


@pytest.fixture
def memory():
    if find_spec("fsspec") is None:
        pytest.skip("needs unshutter[dask]")
    from fsspec.implementations.memory import MemoryFileSystem

    MemoryFileSystem.store.clear()
    yield path_of("memory://archive")
    MemoryFileSystem.store.clear()


@pytest.fixture(params=["files", "objects"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path if request.param == "files" else request.getfixturevalue("memory")
