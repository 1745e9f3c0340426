"""Written whole or not at all, over nothing but what may be replaced."""

import errno
import os
from pathlib import Path

import pytest

from unshutter.errors import UnshutterError
from unshutter.storage.files import check_target, digest, new_hash, remove_leftovers, remove_own_parts, written_whole
from unshutter.storage.opened import Opened

posix = pytest.mark.skipif(os.name == "nt", reason="needs links, pipes and permissions")


def write(target: Path, data: bytes, **options) -> None:
    with written_whole(target, **options) as part:
        part.write_bytes(data)


def test_the_name_is_taken_when_all_is_written(tmp_path: Path) -> None:
    target = tmp_path / "a.jpg"
    with written_whole(target) as part:
        part.write_bytes(b"new")
        assert not target.exists() and part.suffix == ".jpg"
    assert target.read_bytes() == b"new"
    with pytest.raises(RuntimeError), written_whole(target) as part:
        part.write_bytes(b"half")
        raise RuntimeError
    assert target.read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["a.jpg"]


@pytest.mark.parametrize("links", [True, False], ids=["with hard links", "without"])
def test_what_came_meanwhile_is_not_replaced(tmp_path: Path, links: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    if not links:  # as on exFAT
        monkeypatch.setattr(os, "link", refuse)
    target = tmp_path / "a.jpg"
    write(target, b"mine", overwrite=False)
    with pytest.raises(UnshutterError, match="exists already"), written_whole(target, overwrite=False) as part:
        part.write_bytes(b"other")
    assert target.read_bytes() == b"mine"
    before = target.stat()
    write(target, b"mine", overwrite=False)  # the same bytes: the work was done before
    assert (target.stat().st_ino, target.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert os.listdir(tmp_path) == ["a.jpg"]
    write(target, b"other", overwrite=True)
    assert target.read_bytes() == b"other"
    assert target.stat().st_nlink == 1


@posix
def test_nothing_is_written_through_a_link(tmp_path: Path) -> None:
    behind = tmp_path / "behind.jpg"
    behind.write_bytes(b"precious")
    for name, leads_to in (("link.jpg", behind), ("dangling.jpg", tmp_path / "missing.jpg")):
        link = tmp_path / name
        link.symlink_to(leads_to)
        for overwrite in (False, True):
            with pytest.raises(UnshutterError, match="link"):
                check_target(link, overwrite)
            with pytest.raises(UnshutterError):
                write(link, b"new", overwrite=overwrite)
        assert link.is_symlink()
    assert behind.read_bytes() == b"precious"
    assert sorted(os.listdir(tmp_path)) == ["behind.jpg", "dangling.jpg", "link.jpg"]


@posix
def test_only_files_are_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.jpg")
    (tmp_path / "folder.jpg").mkdir()
    for name, reason in (("pipe.jpg", "not a plain file"), ("folder.jpg", "a folder"), ("none/a.jpg", "no folder")):
        with pytest.raises(UnshutterError, match=reason):
            check_target(tmp_path / name, True)


@posix
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444])
def test_permissions_are_those_of_the_original(tmp_path: Path, mode: int) -> None:
    original, target = tmp_path / "a.jpg", tmp_path / "b.jpg"
    original.write_bytes(b"private")
    original.chmod(mode)
    with written_whole(target, mode_of=original) as part:
        assert part.stat().st_mode & 0o077 == 0  # not for a moment anybody else's to read
        part.write_bytes(b"private")
    assert target.stat().st_mode & 0o777 == mode
    write(tmp_path / "c.jpg", b"", mode_of=tmp_path / "missing.jpg")
    (tmp_path / "new.jpg").touch()
    assert (tmp_path / "c.jpg").stat().st_mode == (tmp_path / "new.jpg").stat().st_mode


def test_times_that_are_given_are_kept(tmp_path: Path) -> None:
    target, then = tmp_path / "a.jpg", (1_000_000_000_000_000_000, 900_000_000_000_000_000)  # 2001 and 1998
    write(target, b"new", times_ns=then)
    assert Opened.at(target).times_ns == then
    assert digest(target) is not None
    if hasattr(os, "O_NOATIME"):
        assert Opened.at(target).times_ns == then  # looking at a result of ours is no access
    write(target, b"newer", times_ns=(1 << 200, 1 << 200))  # no file system has them
    assert target.read_bytes() == b"newer"
    assert Opened.at(tmp_path / "missing.jpg").times_ns is None


def test_leftovers_go_unless_somebody_writes_them(tmp_path: Path) -> None:
    dead, kept = ".unshutter-0123456789abcdef.part.jpg", ".unshutter-mine.part.jpg"
    for name in (dead, kept, "a.jpg"):
        (tmp_path / name).write_bytes(b"half")
    if os.name != "nt":
        (tmp_path / ".unshutter-aaaaaaaaaaaaaaaa.part").symlink_to("a.jpg")
        os.mkfifo(tmp_path / ".unshutter-bbbbbbbbbbbbbbbb.part")  # opening it would wait
    with written_whole(tmp_path / "b.jpg") as part:
        assert remove_leftovers(tmp_path) == 1
        assert part.exists()
    assert not (tmp_path / dead).exists()
    assert (tmp_path / kept).exists() and (tmp_path / "a.jpg").exists()
    assert remove_leftovers(tmp_path / "missing") == 0


def test_a_process_that_is_ended_takes_its_own_along(tmp_path: Path) -> None:
    (tmp_path / ".unshutter-0123456789abcdef.part.jpg").write_bytes(b"another's")
    with pytest.raises(UnshutterError), written_whole(tmp_path / "a.jpg") as part:
        part.write_bytes(b"half")
        remove_own_parts()
        assert os.listdir(tmp_path) == [".unshutter-0123456789abcdef.part.jpg"]


def test_a_digest_is_the_one_that_manifests_of_earlier_versions_have(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"abc")
    assert digest(tmp_path / "a.txt") == "cf4ab791c62b8d2b2109c90275287816"  # b2sum -l 128
    assert new_hash(b"abc").hexdigest() == "cf4ab791c62b8d2b2109c90275287816"
    assert digest(tmp_path / "missing") is None
