"""A run never writes to what it reads, nor through links."""

import os
from pathlib import Path

import pytest

from unshutter.errors import UnshutterError
from unshutter.storage.places import write_place
from unshutter.storage.protection import Protection

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
    protection = Protection([photo, given_as_link, None])
    names = ("in/a.jpg", "in/../in/a.jpg", "symbolic.jpg", "hard.jpg", "folder/a.jpg", "in/b.jpg", "real.jpg")
    for name in names:
        with pytest.raises(UnshutterError, match="never overwritten"):
            protection.check(tmp_path / name)
    for name in ("in/c.jpg", "in", "new/a.jpg"):
        protection.check(tmp_path / name)
    protection.check(None)


@posix
def test_without_inodes_real_paths_decide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    photo = tmp_path / "a.jpg"
    photo.write_bytes(b"photo")
    (tmp_path / "link.jpg").symlink_to(photo)
    protection = Protection([photo])
    monkeypatch.setattr(Protection, "_inodes", set())
    for name in ("a.jpg", "link.jpg"):
        with pytest.raises(UnshutterError, match="never overwritten"):
            protection.check(tmp_path / name)


@posix
def test_links_below_the_output_folder_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "trip").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "named").symlink_to(tmp_path / "out")
    for folder in ("out", "named"):  # the user's own link to the folder is the user's business
        protection = Protection([], [tmp_path / folder, None])
        protection.check(tmp_path / folder / "a.jpg")
        protection.check(tmp_path / folder / "day" / "a.jpg")
        for below in ("trip/a.jpg", "trip/day/a.jpg"):
            with pytest.raises(UnshutterError, match="trip is a link"):
                protection.check(tmp_path / folder / below)


def test_objects_are_inputs_too(memory) -> None:
    write_place(b"photo", memory / "a.jpg")
    protection = Protection([memory / "a.jpg"], [memory])
    protection.check(memory / "b.jpg")
    with pytest.raises(UnshutterError, match="never overwritten"):
        protection.check(memory / "a.jpg")
