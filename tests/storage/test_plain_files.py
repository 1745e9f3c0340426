"""Files that are opened in place are files, and have no other name."""

import os
from contextlib import nullcontext
from pathlib import Path

import pytest

from unshutter.errors import UnshutterError
from unshutter.storage.files import check_plain, digest, open_plain, written_whole

posix = pytest.mark.skipif(os.name == "nt", reason="needs links, pipes and devices")
ADDING = os.O_RDWR | os.O_CREAT | os.O_APPEND


@posix
def test_nothing_is_added_to_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").write_bytes(b"photo")
    (tmp_path / "symbolic").symlink_to("photo.jpg")
    (tmp_path / "dangling").symlink_to("missing")
    (tmp_path / "hard").hardlink_to(tmp_path / "photo.jpg")
    for name, reason in (("symbolic", "it is a link"), ("dangling", "it is a link"), ("hard", "a second name")):
        with pytest.raises(UnshutterError, match=rf"cannot write .*{name}: .*{reason}"):
            open_plain(tmp_path / name, ADDING)
    assert (tmp_path / "photo.jpg").read_bytes() == b"photo"
    assert not (tmp_path / "missing").exists()
    os.close(open_plain(tmp_path / "hard", os.O_RDONLY))  # reading harms nothing


@posix
def test_nothing_waits(tmp_path: Path) -> None:
    """A pipe that nobody writes to would be waited for, for ever."""
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/null"), tmp_path):
        for flags in (os.O_RDONLY, ADDING):
            with pytest.raises(UnshutterError, match="not a plain file"):
                open_plain(path, flags)
    for path in (tmp_path / "pipe", Path("/dev/null")):
        with pytest.raises(UnshutterError, match="a pipe or a device"):
            check_plain(path)
    check_plain(tmp_path / "missing")
    assert digest(tmp_path / "pipe") is None


@posix
def test_what_takes_a_files_place_after_it_was_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "photo.jpg").write_bytes(b"photo")
    (tmp_path / "symbolic").symlink_to("photo.jpg")
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setattr(Path, "is_symlink", lambda _: False)
    monkeypatch.setattr(Path, "is_file", lambda _: True)
    with pytest.raises(UnshutterError, match="cannot write"):
        open_plain(tmp_path / "symbolic", ADDING)
    with pytest.raises(UnshutterError, match="not a plain file"):
        open_plain(tmp_path / "pipe", os.O_RDONLY)


def test_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        open_plain(tmp_path / "a", os.O_RDONLY)
    with pytest.raises(UnshutterError, match="there is no folder"):
        open_plain(tmp_path / "none" / "a", ADDING)
    os.close(open_plain(tmp_path / "a", ADDING))
    assert (tmp_path / "a").read_bytes() == b""


def test_only_a_file_with_the_same_bytes_counts_as_written(tmp_path: Path) -> None:
    for name, data in {"a": b"x" * 3_000_000, "c": b"x" * 2_999_999 + b"y", "d": b"x"}.items():
        (tmp_path / name).write_bytes(data)
    others = ["c", "d"]
    if os.name != "nt":
        (tmp_path / "link").symlink_to("a")
        others.append("link")
    for name in ("a", *others):
        refused = pytest.raises(UnshutterError, match="exists already") if name in others else nullcontext()
        with refused, written_whole(tmp_path / name, overwrite=False) as part:
            part.write_bytes(b"x" * 3_000_000)
