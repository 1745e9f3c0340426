"""What a message says to install works where unshutter comes from: sources, a folder that was installed, an index."""

import importlib.metadata
import json
import shlex
from pathlib import Path

import pytest

from unshutter import version


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The module as it lies in an environment: no sources around it."""
    home = tmp_path / "site-packages" / "unshutter" / "version.py"
    monkeypatch.setattr(version, "__file__", str(home))
    return tmp_path


def test_sources_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = tmp_path / "my sources"
    (sources / "src" / "unshutter").mkdir(parents=True)
    (sources / "pyproject.toml").touch()
    monkeypatch.setattr(version, "__file__", str(sources / "src" / "unshutter" / "version.py"))
    assert shlex.split(version.extra("web")) == ["pip", "install", f"{sources}[web]"]
    assert shlex.split(version.lab()) == ["pip", "install", f"{sources}/lab"]


@pytest.mark.parametrize("there", [True, False])
def test_a_folder_that_was_installed_is_named_while_it_is_there(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch, there: bool
) -> None:
    folder = elsewhere / "checkout"
    if there:
        folder.mkdir()
        (folder / "pyproject.toml").touch()

    class Installed:
        def read_text(self, name: str) -> str:
            return json.dumps({"url": folder.as_uri(), "dir_info": {}})

    monkeypatch.setattr(importlib.metadata, "distribution", lambda name: Installed())
    words = [f"{folder}[heic]" if there else "unshutter[heic]"]
    assert shlex.split(version.extra("heic")) == ["pip", "install", *words]


def test_an_index_has_it_by_name(elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Installed:
        def read_text(self, name: str) -> None:
            return None

    monkeypatch.setattr(importlib.metadata, "distribution", lambda name: Installed())
    assert version.extra("web") == "pip install 'unshutter[web]'"
    assert version.lab() == "pip install unshutter-lab"
