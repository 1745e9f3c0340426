"""A run never writes to what it reads, nor through links, nor two outputs to one file."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from unshutter.errors import UnshutterError, UsageError
from unshutter.options import option
from unshutter.storage.files import write_file
from unshutter.storage.locations import RunFiles

posix = pytest.mark.skipif(os.name == "nt", reason="needs links")


@posix
def test_inputs_are_known_by_any_name(tmp_path: Path) -> None:
    photo, given_as_link = tmp_path / "in" / "a.jpg", tmp_path / "in" / "b.jpg"
    photo.parent.mkdir()
    photo.write_bytes(b"photo")
    (tmp_path / "real.jpg").write_bytes(b"another")
    given_as_link.symlink_to(tmp_path / "real.jpg")
    (tmp_path / "symbolic.jpg").symlink_to(photo)
    (tmp_path / "hard.jpg").hardlink_to(photo)
    (tmp_path / "folder").symlink_to(tmp_path / "in")
    files = RunFiles(reads=[photo, given_as_link, None])
    names = ("in/a.jpg", "in/../in/a.jpg", "symbolic.jpg", "hard.jpg", "folder/a.jpg", "in/b.jpg", "real.jpg")
    for name in names:
        with pytest.raises(UnshutterError, match="never overwritten"):
            files.check(tmp_path / name)
    for name in ("in/c.jpg", "in", "new/a.jpg"):
        files.check(tmp_path / name)


def refuse(*arguments: object) -> None:
    raise OSError


@posix
def test_without_inodes_real_paths_decide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    photo = tmp_path / "a.jpg"
    photo.write_bytes(b"photo")
    (tmp_path / "link.jpg").symlink_to(photo)
    files = RunFiles(reads=[photo])
    monkeypatch.setattr(os, "stat", refuse)
    for name in ("a.jpg", "link.jpg"):
        with pytest.raises(UnshutterError, match="never overwritten"):
            files.check(tmp_path / name)


@posix
def test_links_below_the_output_folder_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "trip").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "named").symlink_to(tmp_path / "out")
    for folder in ("out", "named"):  # the user's own link to the folder is the user's business
        files = RunFiles(folders=[tmp_path / folder, None])
        files.check(tmp_path / folder / "a.jpg")
        files.check(tmp_path / folder / "day" / "a.jpg")
        for below in ("trip/a.jpg", "trip/day/a.jpg"):
            with pytest.raises(UnshutterError, match="trip is a link"):
                files.check(tmp_path / folder / below)


def test_objects_are_inputs_too(memory) -> None:
    write_file(b"photo", memory / "a.jpg")
    files = RunFiles(reads=[memory / "a.jpg"], folders=[memory])
    files.check(memory / "b.jpg")
    with pytest.raises(UnshutterError, match="never overwritten"):
        files.check(memory / "a.jpg")


def test_an_output_has_one_purpose(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    for other in ("a.png", "A.PNG", "folder/../a.png"):
        files = RunFiles()
        files.writes("the picture", tmp_path / "a.png", tmp_path / "b.png", None)
        files.writes("its motion", tmp_path / "c.png")
        with pytest.raises(UsageError, match="would be both the picture and its motion"):
            files.writes("its motion", tmp_path / other)


@dataclass(frozen=True)
class _Group:
    log: Path | None = option(None, "", names="output")
    camera: str = option("off", "", names="word")


@dataclass(frozen=True)
class _Options:
    photos: list[Path] = option(None, "", names="input")
    folder: Path | None = option(None, "", names="results")
    group: _Group = field(default_factory=_Group)


def test_the_files_of_options_are_collected(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_text(name)
    RunFiles(_Options([tmp_path / "a"], tmp_path / "a"))  # the command knows which files are in it
    RunFiles(_Options([tmp_path / "a"]), _Group(tmp_path / "b", camera=str(tmp_path / "b")))
    with pytest.raises(UnshutterError, match="b is an original"):
        RunFiles(_Options([tmp_path / "a", tmp_path / "b"], group=_Group(tmp_path / "b")))
