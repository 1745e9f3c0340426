"""Results that have the times of their photos, for programs that sort by them."""

import os
from pathlib import Path

import pytest

from support.batches import make_photos, rectify
from support.covering import thorough
from unshutter.photo import Photo
from unshutter.storage.opened import Opened

READ, CHANGED = 1_000_000_000_123_456_000, 900_000_000_987_654_000  # ns: 2001 and 1998, so that reading is noted


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    names = ["a.jpg", "b.png", "below/c.tif"]
    make_photos(tmp_path / "archive", names)
    for k, name in enumerate(names):
        os.utime(tmp_path / "archive" / name, ns=(READ + k * 1000, CHANGED + k * 1000))
    return tmp_path / "archive"


RESULTS = ["a.rectified.jpg", "b.rectified.png", "below/c.rectified.tif"]
EXPECTED = [(READ + k * 1000, CHANGED + k * 1000) for k in range(3)]


@pytest.mark.parametrize("jobs", [[], thorough(["--jobs", 2])], ids=["one process", "two"])
def test_of_a_folder(archive: Path, tmp_path: Path, motion: Path, capsys: pytest.CaptureFixture[str], jobs) -> None:
    words = (archive, "-o", tmp_path / "out", "--motion", motion, *jobs)
    assert rectify(*words) == 0
    assert all(Opened.at(tmp_path / "out" / name).times_ns[1] > 1_700_000_000_000_000_000 for name in RESULTS)
    for k, name in enumerate(("a.jpg", "b.png", "below/c.tif")):
        os.utime(archive / name, ns=EXPECTED[k])
    assert rectify(*words, "--keep-times") == 0  # other results are wanted now
    assert [Opened.at(tmp_path / "out" / name).times_ns for name in RESULTS] == EXPECTED
    capsys.readouterr()
    assert rectify(*words, "--keep-times") == 0
    assert "3 finished already" in capsys.readouterr().err
    assert [Opened.at(tmp_path / "out" / name).times_ns for name in RESULTS] == EXPECTED


def test_of_one_photo_while_a_motion_is_looked_for(archive: Path, tmp_path: Path) -> None:
    assert rectify(archive / "a.jpg", "--estimator", "none", "--keep-times", "-o", tmp_path / "out") == 0
    assert Opened.at(tmp_path / "out" / "a.jpg").times_ns == EXPECTED[0]


def test_of_what_an_earlier_run_did_not_finish(archive: Path, tmp_path: Path, motion: Path) -> None:
    words = (archive, "-o", tmp_path / "out", "--motion", motion, "--keep-times")
    assert rectify(*words) == 0
    manifest = tmp_path / "out" / "unshutter-manifest.jsonl"
    lines = manifest.read_text().splitlines(keepends=True)
    manifest.write_text("".join(line for line in lines if "finished" not in line))
    (tmp_path / "out" / RESULTS[0]).unlink()
    os.utime(archive / "a.jpg", ns=EXPECTED[0])
    assert rectify(*words) == 0
    assert [Opened.at(tmp_path / "out" / name).times_ns[1] for name in RESULTS] == [changed for _, changed in EXPECTED]
    assert Opened.at(tmp_path / "out" / RESULTS[0]).times_ns == EXPECTED[0]


def test_urls_are_refused(archive: Path, tmp_path: Path, motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("fsspec", reason="URLs need the extra dask")
    for words in ((archive, "-o", "memory://out"), ("memory://in/a.jpg", "-o", tmp_path / "out.jpg")):
        assert rectify(*words, "--motion", motion, "--keep-times") == 2
        message = capsys.readouterr().err
        assert message.count("\n") == 1 and "--keep-times is for files" in message
    assert not (tmp_path / "out.jpg").exists()
    assert Photo.open(archive / "a.jpg").height
