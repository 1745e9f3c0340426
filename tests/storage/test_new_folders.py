"""Folders appear when they are complete; what killed runs left goes, and what belongs to somebody stays."""

import os
from pathlib import Path

import pytest

from unshutter import UnshutterError
from unshutter.storage.new_folders import new_folder, remove_left_folders

LEFT = ".unshutter-0123456789abcdef.part"


def _made(folder: Path, name: str, age_s: int = 0) -> Path:
    made = folder / name
    made.mkdir()
    (made / "00001.png").write_bytes(b"picture")
    for path in (made / "00001.png", made):
        at = path.stat().st_mtime - age_s
        os.utime(path, (at, at))
    return made


def test_all_or_nothing(tmp_path: Path) -> None:
    with new_folder(tmp_path / "out") as part:
        (part / "a").write_text("a")
        assert not (tmp_path / "out").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    with pytest.raises(UnshutterError, match="exists already"), new_folder(tmp_path / "out"):
        pass
    with pytest.raises(KeyError), new_folder(tmp_path / "other"):
        raise KeyError
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.skipif(os.name == "nt", reason="by age, without locks")
def test_what_a_killed_run_left_goes(tmp_path: Path) -> None:
    _made(tmp_path, LEFT)
    assert remove_left_folders(tmp_path / "out") == 1
    assert not list(tmp_path.iterdir())


def test_what_is_being_filled_stays(tmp_path: Path) -> None:
    with new_folder(tmp_path / "out") as part:
        (part / "00001.png").write_bytes(b"picture")
        assert remove_left_folders(tmp_path / "out") == 0
        assert (part / "00001.png").exists()


def test_what_version_1_0_left_goes_when_it_is_old(tmp_path: Path) -> None:
    _made(tmp_path, ".out.01234567.part", age_s=7200)
    young = _made(tmp_path, ".out.89abcdef.part", age_s=60)
    other = _made(tmp_path, ".other.01234567.part", age_s=7200)
    assert remove_left_folders(tmp_path / "out") == 1
    assert sorted(tmp_path.iterdir()) == sorted([young, other])


def test_what_is_not_ours_stays(tmp_path: Path) -> None:
    inside = _made(tmp_path, "elsewhere")
    (tmp_path / LEFT).symlink_to(inside)
    mine = _made(tmp_path, ".unshutter-mine.part", age_s=7200)
    assert remove_left_folders(tmp_path / "out") == 0
    assert (inside / "00001.png").exists() and mine.exists()
