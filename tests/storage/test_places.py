"""Files and objects behind the same interface, and one line for whatever goes wrong with them."""

import os
import pickle
import subprocess
import sys
import warnings
from pathlib import Path, PurePosixPath

import pytest

from unshutter.errors import UnshutterError
from unshutter.storage.locations import (
    absolute,
    check_place,
    fingerprint,
    is_folder,
    objects_below,
    place,
    read_place,
    remove,
    way,
    write_place,
)


def test_paths_are_paths_and_nothing_is_imported_for_them() -> None:
    assert place("a/b.jpg") == Path("a/b.jpg")
    assert place("file:///a/b.jpg") == Path("/a/b.jpg")
    code = "from unshutter.storage.locations import place; place('a.jpg'); import sys; print('upath' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_written_read_and_removed(folder) -> None:
    target = folder / "a.txt"
    assert fingerprint(target) is None
    write_place(b"one", target)
    first = fingerprint(target)
    assert read_place(target) == b"one"
    assert first is not None and first.startswith("3:")
    write_place(b"another", target)
    assert fingerprint(target) != first
    assert is_folder(folder) and not is_folder(target)
    remove(target)
    remove(target)  # gone already: nothing happens
    assert fingerprint(target) is None
    with pytest.raises(UnshutterError, match=r"cannot reach .*a\.txt: no such file"):
        read_place(target)


def test_what_is_there_is_only_replaced_when_asked(folder) -> None:
    target = folder / "a.jpg"
    check_place(target, False)
    write_place(b"mine", target)
    with pytest.raises(UnshutterError, match="--overwrite"):
        check_place(target, False)
    check_place(target, True)


def test_the_way_from_a_folder(folder) -> None:
    assert way(folder, folder / "x" / "a b.jpg") == PurePosixPath("x/a b.jpg")
    assert way(folder, folder) == PurePosixPath()
    assert way(folder / "x", folder / "xy") is None
    assert way(folder, Path("elsewhere")) is None


def test_a_path_is_made_absolute_without_following_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert absolute(Path("x/../a.jpg")) == Path(os.getcwd(), "a.jpg")


def test_objects_are_listed_relative_to_their_folder(memory) -> None:
    for name in ("b.jpg", "trip/day 2/a.jpg", "trip#1/c.jpg"):
        write_place(b"x", memory / name)
    assert [str(name) for name in objects_below(memory)] == ["b.jpg", "trip#1/c.jpg", "trip/day 2/a.jpg"]
    assert [str(name) for name in objects_below(place("memory://archive/trip/"))] == ["day 2/a.jpg"]


def test_a_place_may_be_a_key_and_goes_to_other_processes(memory) -> None:
    assert {place("memory://archive/"): 1}[memory] == 1
    assert pickle.loads(pickle.dumps(memory / "a.jpg")) == memory / "a.jpg"
    assert str(memory / "a b.jpg") == "memory://archive/a b.jpg"


def test_an_unknown_protocol_is_named() -> None:
    pytest.importorskip("upath", reason="needs unshutter[dask]")
    with pytest.raises(UnshutterError, match=r"cannot reach nowhere://x/a\.jpg: .*nowhere") as error:
        place("nowhere://x/a.jpg")
    assert "\n" not in str(error.value)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "upath", None)
    with pytest.raises(UnshutterError, match=r"needs a package that is missing.*\[dask\]"):
        place("s3://bucket/a.jpg")


def test_a_store_that_was_never_tested_prints_no_warning():
    pytest.importorskip("upath", reason="needs unshutter[dask]")
    with pytest.warns() as printed:
        warnings.warn("the only one", UserWarning, stacklevel=1)
        with pytest.raises(UnshutterError, match="cannot reach generic://x"):
            place("generic://x")
    assert [str(each.message) for each in printed] == ["the only one"]
