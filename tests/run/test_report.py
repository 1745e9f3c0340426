"""What the user is told of a batch: dry runs, the JSON log, usage."""

import json
import os
from functools import partial
from pathlib import Path

import pytest

from support.batches import make_photos, rectify, results, start_rectify
from support.covering import thorough
from unshutter.motion.finding import Finding


def test_a_dry_run_writes_nothing(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    before = sorted(tmp_path.rglob("*"))
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--dry-run") == 0
    told = capsys.readouterr()
    assert len(told.out.splitlines()) == 4
    assert "4 photos to do, 0 finished already, 0 refused" in told.err
    assert sorted(tmp_path.rglob("*")) == before
    make_photos(tmp_path, ["out/a.rectified.jpg"])
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--dry-run") == 1
    assert "3 photos to do, 0 finished already, 1 refused" in capsys.readouterr().err


def test_the_json_log_says_what_happened(archive: Path, motion: Path, tmp_path: Path) -> None:
    (archive / "bad.jpg").write_text("no photo")
    log = tmp_path / "log.jsonl"
    for _ in range(2):
        assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--json-log", log) == 1
    events = [json.loads(line) for line in log.read_text().splitlines()]
    told = [event["event"] for event in events]
    assert sorted(told[:5]) == ["done"] * 4 + ["failed"]
    assert sorted(told[6:11]) == ["failed"] + ["skipped"] * 4
    (failed, _) = (event for event in events if event["event"] == "failed")
    assert failed["photo"] == str(archive / "bad.jpg")
    assert "is not a JPEG" in failed["error"]
    assert {"done": 0, "skipped": 4, "failed": 1, "photos": 5, "stopped": False}.items() <= events[-1].items()


def test_a_photo_is_no_log(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path, ["another.jpg"])
    before = results(tmp_path)
    for photo, why in ((archive / "a.jpg", "is an original"), (tmp_path / "another.jpg", "is not an unshutter log")):
        assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--json-log", photo) == 1
        assert why in capsys.readouterr().err
    assert results(tmp_path) == before


@pytest.mark.parametrize(
    "options", [["--jobs", 0], ["--jobs", 2, "--scheduler", "tcp://127.0.0.1:1"], ["--max-pixels", 0]]
)
def test_wrong_usage(archive: Path, tmp_path: Path, options: list, capsys) -> None:
    assert rectify(archive, "-o", tmp_path / "out", *options) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_large_photos_are_refused_unless_the_limit_is_raised(archive: Path, motion: Path, tmp_path: Path, capsys):
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--max-pixels", 72 * 96 - 1) == 1
    assert "4 of 4 photos failed" in capsys.readouterr().err
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--max-pixels", 72 * 96) == 0


ODD = "a\nb\x1b[2Jc"


@pytest.mark.skipif(os.name == "nt", reason="names cannot hold line breaks there")
def test_names_and_reasons_do_not_break_lines_or_terminals(tmp_path: Path, motion: Path, capsys) -> None:
    make_photos(tmp_path / "in", ["photo.jpg"])
    (tmp_path / "in" / "photo.jpg").rename(tmp_path / "in" / f"{ODD}.jpg")
    (tmp_path / "in" / f"bad{ODD}.jpg").write_text("no photo")
    assert rectify(tmp_path / "in", "-o", tmp_path / "out", "--motion", motion, "--dry-run") == 0
    told = capsys.readouterr()
    assert told.out.count("\n") == 2 and "\x1b" not in told.out and r"a\nb\x1b[2Jc.jpg -> " in told.out
    assert rectify(tmp_path / "in", "-o", tmp_path / "out", "--motion", motion) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 5 and "\x1b" not in told  # one for each photo, then three counts
    assert told.count(r"bada\nb\x1b[2Jc.jpg") == 1  # a message names its photo once

    data = json.loads(motion.read_text())
    motion.write_text(json.dumps(data | {"reason": ODD, "estimator": ODD}))
    assert rectify(tmp_path / "in" / f"{ODD}.jpg", "-o", tmp_path / "a.jpg", "--motion", motion) == 0
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "\x1b" not in told
    assert str(Finding.load(motion).reason) == Finding.load(motion).estimator == r"a\nb\x1b[2Jc"
    motion.write_text(json.dumps(data | {"reference": ["first"]}))
    assert rectify(tmp_path / "in" / f"{ODD}.jpg", "-o", tmp_path / "b.jpg", "--motion", motion) in (1, 2)
    assert "unknown reference row" in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="needs limits of file sizes")
@pytest.mark.parametrize("jobs", [[], thorough(["--jobs", 1])], ids=["one process", "jobs"])
def test_a_log_that_finds_no_room_is_named(jobs: list, archive: Path, motion: Path, tmp_path: Path) -> None:
    import resource

    log, limit = tmp_path / "log.jsonl", 200_000
    log.write_text('{"event": "done"}\n' * (limit // 18))
    before = log.read_bytes()
    room = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, limit))
    words = [archive, "-o", tmp_path / "out", "--motion", motion]
    with start_rectify(*words, "--json-log", log, *jobs, preexec_fn=room) as process:
        errors = process.communicate(timeout=120)[1]
    assert process.returncode == 1
    assert errors.splitlines()[-1] == f"unshutter: cannot write {log}: File too large"
    assert errors.count("log.jsonl") == 1 and "Traceback" not in errors
    assert log.read_bytes()[: len(before)] == before
    assert rectify(*words) == 0  # goes on where that one ended
