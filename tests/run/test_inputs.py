"""Which files of a folder are photos, and what a batch says of the others."""

import json
import os
from pathlib import Path, PurePosixPath

import pytest

from support.batches import make_photos, rectify
from unshutter.cli import main
from unshutter.errors import UnshutterError
from unshutter.photo import Photo
from unshutter.run.inputs import find_photos

posix = pytest.mark.skipif(os.name == "nt", reason="needs links, pipes and devices")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Two photos, and much else."""
    folder = tmp_path / "archive"
    make_photos(folder, ["a.jpg", "trip/b.png"])
    for name in ("stereo.mpo", "notes.txt", "video.MOV", "trip/film.mov", "README", ".hidden.jpg", "a.rectified.jpg"):
        (folder / name).write_bytes(b"")
    (folder / ".thumbnails").mkdir()
    return folder


def test_what_is_passed_over_is_counted_by_reason(archive: Path) -> None:
    inputs = find_photos([archive])
    assert list(inputs.photos.values()) == [PurePosixPath("."), PurePosixPath("trip")]
    assert inputs.counts() == {
        "hidden": 2,
        "made by unshutter": 1,
        "with several pictures in one file": 1,
        "no photos": 2,
        "films": 2,
    }
    assert inputs.not_taken() == (
        "skipped: 2 videos, see unshutter video (.mov); 2 hidden (no extension, .jpg); "
        "2 are not photos (no extension, .txt); 1 made by unshutter (.jpg); 1 with several pictures in one file (.mpo)"
    )
    assert find_photos([archive / "a.jpg"]).not_taken() == ""


@posix
def test_links_pipes_and_devices_are_counted(archive: Path) -> None:
    os.mkfifo(archive / "pipe.jpg")
    (archive / "gone.jpg").symlink_to("nowhere.jpg")
    (archive / "device.jpg").symlink_to("/dev/zero")
    (archive / "again").symlink_to(archive)
    counts = find_photos([archive]).counts()
    assert (counts["pipes or devices"], counts["broken links"], counts["links to folders"]) == (2, 1, 1)


def test_a_batch_ends_with_what_it_did_not_take(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    log = tmp_path / "log.jsonl"
    for words in (["--dry-run"], ["--json-log", log]):
        assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, *words) == 0
        assert "1 with several pictures in one file (.mpo)" in capsys.readouterr().err
    end = json.loads(log.read_text().splitlines()[-1])
    assert end["not_taken"]["no photos"] == 2
    assert main(["estimate", str(archive), "-o", str(tmp_path / "motions"), "--estimator", "none"]) == 0
    assert "1 with several pictures in one file (.mpo)" in capsys.readouterr().err
    (archive / "a.jpg").unlink()
    (archive / "trip" / "b.png").unlink()
    with pytest.raises(UnshutterError, match=r"no photos in folder .*; skipped: 2 videos"):
        find_photos([archive])


def test_other_endings_of_jpegs_are_taken(motion: Path, tmp_path: Path) -> None:
    make_photos(tmp_path / "in", ["a.jpg", "b.jpg"])
    (tmp_path / "in" / "a.jpg").rename(tmp_path / "in" / "a.jpe")
    (tmp_path / "in" / "b.jpg").rename(tmp_path / "in" / "b.JFIF")
    assert rectify(tmp_path / "in", "-o", tmp_path / "out", "--motion", motion) == 0
    assert Photo.open(tmp_path / "out" / "a.rectified.jpe").format == "jpeg"
    assert Photo.open(tmp_path / "out" / "b.rectified.JFIF").format == "jpeg"


@posix
@pytest.mark.parametrize("command", ["rectify", "estimate"])
def test_what_could_be_waited_for_is_refused(command: str, tmp_path: Path, capsys) -> None:
    os.mkfifo(tmp_path / "pipe.jpg")
    (tmp_path / "stereo.mpo").write_bytes(b"\xff\xd8\xff")
    cases = {tmp_path / "pipe.jpg": "a pipe or a device", Path("/dev/zero"): "a pipe", tmp_path / "stereo.mpo": "MPO"}
    for photo, reason in cases.items():
        out = tmp_path / ("out.json" if command == "estimate" else "out.jpg")
        assert main([command, str(photo), "-o", str(out), "--estimator", "none"]) == 1
        errors = capsys.readouterr().err
        assert reason in errors and str(photo) in errors
        assert errors.count("\n") == 1
