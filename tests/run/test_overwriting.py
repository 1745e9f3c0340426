"""Nothing that people have only once is destroyed, whatever lies in the folders and whoever put it there."""

import json
import os
from pathlib import Path

import pytest

from support.batches import make_photos, rectify, results
from support.covering import thorough
from unshutter.cli import main
from unshutter.photo import Photo

MANIFEST = "unshutter-manifest.jsonl"
posix = pytest.mark.skipif(os.name == "nt", reason="needs links and permissions")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    make_photos(tmp_path / "archive", ["a.jpg", "b.jpg"])
    return tmp_path / "archive"


def begun(target: str, source: Path, **more: object) -> str:
    return json.dumps({"target": target, "state": "begun", "source": str(source), **more}) + "\n"


@pytest.mark.parametrize("jobs", [[], thorough(["--jobs", 2])], ids=["one process", "two"])
def test_an_input_that_has_the_name_of_a_result(jobs: list, motion: Path, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path, ["x.jpg", "x.rectified.jpg"])
    before = results(tmp_path)
    photos = (tmp_path / "x.jpg", tmp_path / "x.rectified.jpg")
    for words in ([], ["-o", tmp_path]):
        assert rectify(*photos, "--motion", motion, "--overwrite", *words, *jobs) == 1
        errors = capsys.readouterr().err
        assert "x.rectified.jpg is an original (an input of this run), which is never overwritten" in errors
        assert "1 of 2 photos failed" in errors
        assert before.items() <= results(tmp_path).items()
    assert rectify(*photos, "-o", tmp_path, "--motion", motion, "--overwrite", "--dry-run") == 1
    assert "1 refused" in capsys.readouterr().err


@posix
@pytest.mark.parametrize("kind", ["symbolic", "hard"])
def test_a_link_to_another_input(kind: str, archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out, before = tmp_path / "out", results(archive)
    out.mkdir()
    make = Path.symlink_to if kind == "symbolic" else Path.hardlink_to
    make(out / "a.rectified.jpg", archive / "b.jpg")
    assert rectify(archive, "-o", out, "--motion", motion, "--overwrite") == 1
    assert "never overwritten" in capsys.readouterr().err
    assert results(archive) == before
    assert (out / "a.rectified.jpg").samefile(archive / "b.jpg")


@posix
@pytest.mark.parametrize("words", [[], ["--overwrite"]], ids=["not asked to", "asked to"])
def test_a_link_in_a_foreign_folder(words: list, archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    """With a manifest that calls it its own."""
    out, precious = tmp_path / "out", tmp_path / "precious.txt"
    out.mkdir()
    precious.write_text("precious")
    for name in ("a.rectified.jpg", "motions.json"):
        (out / name).symlink_to(precious)
    (out / "trip").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").mkdir()
    make_photos(archive, ["trip/c.jpg"])
    (out / MANIFEST).write_text(begun("a.rectified.jpg", archive / "a.jpg"))
    assert rectify(archive, "-o", out, "--motion", motion, *words) == 1
    errors = capsys.readouterr().err
    assert errors.count("nothing is written through links") == 2
    assert "2 of 3 photos failed" in errors
    assert rectify(archive / "a.jpg", "-o", tmp_path / "a.png", "--save-motion", out / "motions.json", *words) == 1
    assert precious.read_text() == "precious"
    assert list((tmp_path / "elsewhere").iterdir()) == []


@pytest.mark.parametrize("state", ["begun", "done", "failed"])
def test_the_word_of_a_manifest_is_not_enough(state: str, archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    """It may say what it likes of a file: what it names must have the digest that it had."""
    out = tmp_path / "out"
    out.mkdir()
    theirs = out / "a.rectified.jpg"
    theirs.write_bytes(b"somebody's")
    status = theirs.stat()
    fingerprint = f"{status.st_size}:{status.st_mtime_ns}"
    for told in ({}, {"outputs": {theirs.name: fingerprint}}, {"digests": 3}, {"digests": {theirs.name: "0" * 32}}):
        record = json.loads(begun(theirs.name, archive / "a.jpg", outputs={theirs.name: fingerprint}))
        (out / MANIFEST).write_text(json.dumps({**record, "state": state, **told}) + "\n")
        assert rectify(archive, "-o", out, "--motion", motion) == 1
        assert "--overwrite" in capsys.readouterr().err
        assert theirs.read_bytes() == b"somebody's"


@posix
@pytest.mark.parametrize("kind", ["symbolic", "hard"])
def test_a_manifest_that_is_a_link(kind: str, archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out, before = tmp_path / "out", results(archive)
    out.mkdir()
    make = Path.symlink_to if kind == "symbolic" else Path.hardlink_to
    make(out / MANIFEST, archive / "a.jpg")
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    errors = capsys.readouterr().err
    assert "link" in errors and MANIFEST in errors
    assert results(archive) == before
    (out / MANIFEST).unlink()
    os.mkfifo(out / MANIFEST)  # which would be waited for
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    assert "not a plain file" in capsys.readouterr().err


def test_an_empty_photo_is_no_log(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    (archive / "empty.jpg").write_bytes(b"")
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--json-log", archive / "empty.jpg") == 1
    assert "never overwritten" in capsys.readouterr().err
    assert (archive / "empty.jpg").read_bytes() == b""


def test_a_motion_file_is_replaced_only_when_asked(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    theirs = tmp_path / "motions" / "a.json"
    theirs.parent.mkdir()
    theirs.write_text("somebody's")
    words = [archive, "-o", tmp_path / "out", "--motion", motion, "--save-motion", theirs.parent]
    assert rectify(*words) == 1
    assert "a.json exists already" in capsys.readouterr().err
    assert theirs.read_text() == "somebody's"
    for command in (["estimate", str(archive / "a.jpg"), "-o", str(theirs), "--estimator", "none"],):
        assert main(command) == 1
        assert theirs.read_text() == "somebody's"
    assert rectify(*words, "--overwrite") == 0
    assert theirs.read_text() != "somebody's"


@posix
@pytest.mark.parametrize("jobs", [[], thorough(["--jobs", 2])], ids=["one process", "two"])
def test_results_are_as_private_as_their_photos(jobs: list, archive: Path, motion: Path, tmp_path: Path) -> None:
    (archive / "a.jpg").chmod(0o600)
    (archive / "b.jpg").chmod(0o640)
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion, "--save-motion", out, *jobs) == 0
    modes = {path.name: oct(path.stat().st_mode & 0o777) for path in out.iterdir() if path.name != MANIFEST}
    assert modes == {"a.rectified.jpg": "0o600", "a.json": "0o600", "b.rectified.jpg": "0o640", "b.json": "0o640"}
    assert main(["estimate", str(archive / "a.jpg"), "-o", str(tmp_path / "a.json"), "--estimator", "none"]) == 0
    assert (tmp_path / "a.json").stat().st_mode & 0o777 == 0o600
    assert Photo.open(out / "a.rectified.jpg").format == "jpeg"
