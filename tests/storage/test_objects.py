"""Files and objects behind the same functions, and one line for whatever goes wrong with them."""

import os
import pickle
import re
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest

from unshutter.errors import UnshutterError, visible
from unshutter.storage.files import check_target, fingerprint, remove, write_file
from unshutter.storage.locations import absolute, full_name, is_folder, way
from unshutter.storage.objects import is_object, objects_below, path_of, read_object


def test_paths_are_paths_and_nothing_is_imported_for_them() -> None:
    assert path_of("a/b.jpg") == Path("a/b.jpg")
    assert path_of("file:///a/b.jpg") == Path("/a/b.jpg")
    code = "from unshutter.storage.objects import path_of; path_of('a.jpg'); import sys; print('fsspec' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def content(path: Path) -> bytes:
    return read_object(path) if is_object(path) else path.read_bytes()


def test_written_read_and_removed(folder: Path) -> None:
    target = folder / "a.txt"
    assert fingerprint(target) is None
    write_file(b"one", target)
    first = fingerprint(target)
    assert content(target) == b"one"
    assert first is not None and first.startswith("3:")
    write_file(b"another", target)
    assert fingerprint(target) != first
    assert is_folder(folder) and not is_folder(target)
    remove(target)
    remove(target)  # gone already: nothing happens
    assert fingerprint(target) is None


def test_what_is_there_is_only_replaced_when_asked(folder: Path) -> None:
    target = folder / "a.jpg"
    check_target(target, False)
    write_file(b"mine", target)
    with pytest.raises(UnshutterError, match="--overwrite"):
        check_target(target, False)
    check_target(target, True)
    write_file(b"mine", target, overwrite=False)  # as it is there already
    with pytest.raises(UnshutterError, match="--overwrite"):
        write_file(b"another", target, overwrite=False)
    assert content(target) == b"mine"


def test_the_way_from_a_folder(folder: Path) -> None:
    assert way(folder, folder / "x" / "a b.jpg") == PurePosixPath("x/a b.jpg")
    assert way(folder, folder) == PurePosixPath()
    assert way(folder / "x", folder / "xy") is None
    assert way(folder, Path("elsewhere")) is None


def test_a_path_is_made_absolute_without_following_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert absolute(Path("x/../a.jpg")) == Path(os.getcwd(), "a.jpg")


def test_objects_are_listed_relative_to_their_folder(memory: Path) -> None:
    for name in ("b.jpg", "trip/day 2/a.jpg", "trip#1/c.jpg"):
        write_file(b"x", memory / name)
    assert [str(name) for name in objects_below(memory)] == ["b.jpg", "trip#1/c.jpg", "trip/day 2/a.jpg"]
    assert [str(name) for name in objects_below(path_of("memory://archive/trip/"))] == ["day 2/a.jpg"]


@pytest.mark.parametrize(
    "url", ["memory://archive/a b.jpg", "memory:///archive/a.jpg", "simplecache::memory://archive/a.jpg"]
)
def test_the_path_of_an_object_is_its_url_in_any_process(memory: Path, url: str) -> None:
    path = pickle.loads(pickle.dumps(path_of(url)))
    assert full_name(path) == url
    assert (path.name, path.suffix) == (url.rpartition("/")[2], ".jpg")
    assert visible(f"{path} is new") == f"{url} is new"


def test_nothing_can_lie_where_the_paths_of_objects_seem_to_lead(memory: Path) -> None:
    assert not (memory / "a.jpg").exists()
    with pytest.raises(OSError, match=re.escape(os.devnull)):
        memory.mkdir(parents=True)


def test_a_missing_object_and_an_unknown_protocol_are_named(memory: Path) -> None:
    with pytest.raises(UnshutterError, match=r"cannot reach memory://archive/a\.jpg: no such file"):
        read_object(memory / "a.jpg")
    with pytest.raises(UnshutterError, match=r"cannot reach nowhere://x/a\.jpg: .*nowhere") as error:
        path_of("nowhere://x/a.jpg")
    assert "\n" not in str(error.value)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(UnshutterError, match=r"needs a package that is missing.*\[dask\]"):
        path_of("s3://bucket/a.jpg")
