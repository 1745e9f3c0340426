"""Folders in, folders out: structure, resuming, what is done again and what is never touched."""

import json
import os
import re
import signal
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.batches import leftovers, make_motion, make_photos, rectify, results, start_rectify
from unshutter.batch.job import Job, Outcome
from unshutter.batch.report import Report
from unshutter.batch.run import Batch
from unshutter.batch.workers import InThisProcess, Workers, processes
from unshutter.cli import main
from unshutter.photo import Photo
from unshutter.storage.files import written_whole

NAMES = ["a.jpg", "b.png", "trip/a.jpg", "trip/day 2/c.webp"]
MANIFEST = "unshutter-manifest.jsonl"


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    folder = tmp_path / "archive"
    make_photos(folder, NAMES)
    return folder


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    return make_motion(tmp_path / "motion.json")


def stamps(folder: Path) -> dict[str, tuple[int, int]]:
    """What changes when a result is written anew."""
    found = [path for path in folder.rglob("*.rectified.*") if path.is_file()]
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in found}


def records(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / MANIFEST).read_text().splitlines()]


# ---- which files, and where to -------------------------------------------------------------------------------


def test_folders_are_gone_through_and_their_structure_is_kept(archive: Path, motion: Path, tmp_path: Path) -> None:
    (archive / ".thumbnails").mkdir()
    for passed_over in (".thumbnails/t.jpg", "._a.jpg", ".unshutter-0011223344556677.part.jpg", "a.rectified.jpg"):
        (archive / passed_over).write_bytes(b"not meant")
    (archive / "again").symlink_to(archive)  # a circle
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion) == 0
    expected = ["a.rectified.jpg", "b.rectified.png", "trip/a.rectified.jpg", "trip/day 2/c.rectified.webp"]
    assert list(results(tmp_path / "out")) == expected


def test_results_inside_the_archive_are_no_photos(archive: Path, motion: Path) -> None:
    out = archive / "straight"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    (out / "a.rectified.jpg").rename(out / "renamed.jpg")
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert sorted(results(out)) == sorted(
        ["a.rectified.jpg", "b.rectified.png", "renamed.jpg", "trip/a.rectified.jpg", "trip/day 2/c.rectified.webp"]
    )


def test_beside_the_photos_folders_are_gone_through_too(archive: Path, motion: Path) -> None:
    assert rectify(archive, "--motion", motion) == 0
    assert (archive / "trip/day 2/c.rectified.webp").exists()
    assert not (archive / MANIFEST).exists()


def test_motions_have_the_same_structure(archive: Path, motion: Path, tmp_path: Path) -> None:
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--save-motion", tmp_path / "motions") == 0
    found = sorted(p.relative_to(tmp_path / "motions").as_posix() for p in (tmp_path / "motions").rglob("*.json"))
    assert found == ["a.json", "b.json", "trip/a.json", "trip/day 2/c.json"]
    (tmp_path / "motions" / "b.json").unlink()  # a part of the result: without it, the photo is done again
    before = stamps(tmp_path / "out")
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--save-motion", tmp_path / "motions") == 0
    after = stamps(tmp_path / "out")
    assert {name for name in after if after[name] != before[name]} == {"b.rectified.png"}
    assert (tmp_path / "motions" / "b.json").exists()


def test_estimate_goes_through_folders_too(archive: Path, tmp_path: Path) -> None:
    assert main(["estimate", str(archive), "-o", str(tmp_path / "out"), "--estimator", "none"]) == 0
    assert (tmp_path / "out/trip/day 2/c.json").exists()


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="the superuser can read everything")
def test_a_folder_that_cannot_be_read_counts_as_failed(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    (archive / "trip").chmod(0)
    try:
        assert rectify(archive, "-o", tmp_path / "out", "--motion", motion) == 1
    finally:
        (archive / "trip").chmod(0o755)
    assert "trip: Permission denied" in capsys.readouterr().err


# ---- going on ------------------------------------------------------------------------------------------------


def test_only_what_changed_is_done_again(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    first = stamps(out)
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert "4 finished already" in capsys.readouterr().err
    assert stamps(out) == first

    make_photos(archive, ["new.jpg"])
    Photo.from_array(np.full((72, 96, 3), 99, np.uint8)).save(archive / "b.png", overwrite=True)
    (out / "trip/a.rectified.jpg").unlink()
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    second = stamps(out)
    assert {n for n in second if second[n] != first.get(n)} >= {"new.rectified.jpg", "b.rectified.png"}
    assert (out / "trip/a.rectified.jpg").exists()
    assert second["c.rectified.webp"] == first["c.rectified.webp"]

    assert rectify(archive, "-o", out, "--motion", motion, "--edges", "fill") == 0
    third = stamps(out)
    assert all(third[name] != second[name] for name in second)


def test_other_weights_are_another_option(archive: Path, tmp_path: Path, capsys) -> None:
    shipped = Path(unshutter.__file__).parent / "weights" / "segment-transformer.onnx"
    weights = tmp_path / "mine.onnx"
    weights.write_bytes(shipped.read_bytes())
    for expected in ("4 of 4 photos done", "4 finished already", "4 of 4 photos done"):
        assert rectify(archive, "-o", tmp_path / "out", "--estimator", f"segment-transformer@{weights}") == 0
        assert expected in capsys.readouterr().err
        if "finished" in expected:
            os.utime(weights, (0, 0))


def test_overwrite_does_all_again(archive: Path, motion: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    first = stamps(out)
    assert rectify(archive, "-o", out, "--motion", motion, "--overwrite") == 0
    assert all(stamps(out)[name] != first[name] for name in first)


def test_what_others_left_in_the_folder_is_kept(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.rectified.jpg").write_bytes(b"somebody's")
    for _ in range(2):  # that it failed once is no permission
        assert rectify(archive, "-o", out, "--motion", motion) == 1
        errors = capsys.readouterr().err
        assert "--overwrite" in errors
        assert "1 of 4 photos failed" in errors
        assert (out / "a.rectified.jpg").read_bytes() == b"somebody's"
    # a result that somebody edited is theirs
    (out / "b.rectified.png").write_bytes(b"edited")
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    assert "2 of 4 photos failed" in capsys.readouterr().err
    assert (out / "b.rectified.png").read_bytes() == b"edited"
    assert rectify(archive, "-o", out, "--motion", motion, "--overwrite") == 0
    assert Photo.open(out / "b.rectified.png").format == "png"


def test_another_archive_does_not_replace_the_first_ones_results(archive, motion, tmp_path, capsys) -> None:
    out, other = tmp_path / "out", tmp_path / "other"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    before = results(out)
    make_photos(other, ["x.jpg", "x2.jpg", "b.png"])  # b.png: another photo of the same name
    assert rectify(other, "-o", out, "--motion", motion) == 1
    assert "the result of another photo" in capsys.readouterr().err
    assert results(out)["b.rectified.png"] == before["b.rectified.png"]
    # the same archive in another place is still the same
    moved = archive.rename(tmp_path / "moved")
    assert rectify(moved, "-o", out, "--motion", motion) == 0
    assert "4 finished already" in capsys.readouterr().err


def test_a_result_that_was_begun_is_not_trusted(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    """As after a kill between the last byte and the last record: the file is there, the word is not.

    It is made once more, and stays if it is the same. If not, it is somebody's: that it was begun is no permission.
    """
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    whole = results(out)
    lines = (out / MANIFEST).read_text().splitlines(keepends=True)
    last = json.loads(lines[-1])["target"]
    (out / MANIFEST).write_text("".join(lines[:-1]) + lines[-1][:40])  # cut short, too
    cut = (out / MANIFEST).read_bytes()
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert "1 of 4 photos done" in capsys.readouterr().err
    assert results(out) == whole
    (out / MANIFEST).write_bytes(cut)
    (out / last).write_bytes(b"somebody's")
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert (out / last).read_bytes() == b"somebody's"
    (out / last).unlink()
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert results(out) == whole
    assert rectify(archive, "-o", out, "--motion", motion, "--dry-run") == 0


def test_a_damaged_manifest_costs_nothing_but_work(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    whole = results(out)
    rubbish = ['{"target": 3}', "[]", "null", '{"target": "a.rectified.jpg", "outputs": 7}', "\x00\xff", '{"target"']
    text = (out / MANIFEST).read_text()
    (out / MANIFEST).write_text("\n".join(rubbish) + "\n" + text + "\n".join(rubbish))
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert "4 finished already" in capsys.readouterr().err
    (out / MANIFEST).write_bytes(os.urandom(3000))
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert results(out) == whole


def test_leftovers_of_killed_runs_go_and_those_at_work_stay(archive: Path, motion: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "trip").mkdir(parents=True)
    (out / "trip" / ".unshutter-0123456789abcdef.part.jpg").write_bytes(b"half")
    (out / ".unshutter-mine.part.jpg").write_bytes(b"not ours")
    with written_whole(out / "trip" / "elsewhere.jpg") as part:
        assert rectify(archive, "-o", out, "--motion", motion) == 0
        assert sorted(leftovers(out)) == sorted([part.name, ".unshutter-mine.part.jpg"])
        part.write_bytes(b"whole")
    assert (out / "trip" / "elsewhere.jpg").read_bytes() == b"whole"


# ---- what the user is told -----------------------------------------------------------------------------------


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
    before = results(archive)
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--json-log", archive / "a.jpg") == 1
    assert "no log" in capsys.readouterr().err
    assert results(archive) == before


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


# ---- several workers -----------------------------------------------------------------------------------------


def test_processes_make_the_same_pictures(archive: Path, motion: Path, tmp_path: Path) -> None:
    (archive / "bad.jpg").write_text("no photo")
    assert rectify(archive, "-o", tmp_path / "one", "--motion", motion) == 1
    assert rectify(archive, "-o", tmp_path / "two", "--motion", motion, "--jobs", 2) == 1
    assert results(tmp_path / "one") == results(tmp_path / "two")
    assert len(results(tmp_path / "one")) == 4


def crash_on_b(job: Job) -> Outcome:
    if job.source.stem == "b":
        os._exit(9)
    return Outcome(note=str(os.getpid()))


def test_a_photo_that_kills_its_worker_costs_nothing_but_itself(tmp_path: Path, capsys) -> None:
    jobs = [Job(tmp_path / f"{name}.jpg", tmp_path / f"{name}.out.jpg", None, False, 1) for name in "abcdefgh"]
    with Report(len(jobs), len(jobs)) as report, processes(2) as workers:
        Batch(crash_on_b, workers, None, report).run(jobs)
    assert report.counts == {"done": 7, "skipped": 0, "failed": 1}
    assert "b.jpg: its worker died" in capsys.readouterr().err
    assert isinstance(workers.executor, ProcessPoolExecutor)


class BreaksWhenGiven(InThisProcess):
    """As a pool whose worker has died since the last job came back: it says so when it is given the next."""

    def submit(self, fn, /, *args, **kwargs):
        if args[0].source.stem == "c":
            raise BrokenProcessPool("a child process terminated abruptly")
        return super().submit(fn, *args, **kwargs)


def test_a_worker_that_dies_between_two_jobs_costs_nothing(tmp_path: Path) -> None:
    jobs = [Job(tmp_path / f"{name}.jpg", tmp_path / f"{name}.out.jpg", None, False, 1) for name in "abcdef"]
    with Report(len(jobs), len(jobs)) as report:
        workers = Workers(BreaksWhenGiven(), 2, InThisProcess)
        Batch(lambda job: Outcome(), workers, None, report).run(jobs)
    assert report.counts == {"done": 6, "skipped": 0, "failed": 0}


def wait_for(found, seconds: float = 60) -> None:
    until = time.monotonic() + seconds
    while not found():
        assert time.monotonic() < until, "nothing happened"
        time.sleep(0.01)


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize("jobs", [[], ["--jobs", 2]])
def test_ctrl_c_keeps_what_is_finished(jobs: list, motion: Path, tmp_path: Path) -> None:
    make_photos(tmp_path / "many", [f"{k:03}.jpg" for k in range(400)])
    out = tmp_path / "out"
    process = start_rectify(tmp_path / "many", "-o", out, "--motion", motion, *jobs)
    wait_for(lambda: (out / MANIFEST).exists() and any(r["state"] == "done" for r in whole_records(out)))
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert leftovers(out) == []
    done = {r["target"] for r in whole_records(out) if r["state"] == "done"}
    assert set(results(out)) == done
    assert 0 < len(done) < 400


def whole_records(folder: Path) -> list[dict]:
    text = (folder / MANIFEST).read_text()
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]


# ---- a photo that takes too long -----------------------------------------------------------------------------


def hang_on_b(job: Job) -> Outcome:
    """``b`` never ends, and lets nobody else in its process have a turn."""
    if job.source.stem == "b":
        re.match(r"(a|a)*c", "a" * 200)
    time.sleep(0.05)
    return Outcome(note=str(os.getpid()))


@pytest.mark.parametrize("count", [1, 2])
def test_a_photo_that_hangs_is_given_up_and_the_others_are_done(count: int, tmp_path: Path, capsys) -> None:
    jobs = [Job(tmp_path / f"{name}.jpg", tmp_path / f"{name}.out.jpg", None, False, 1) for name in "abcdefgh"]
    start = time.monotonic()
    with Report(len(jobs), len(jobs)) as report, processes(count, timeout_s=2) as workers:
        Batch(hang_on_b, workers, None, report).run(jobs)
    assert report.counts == {"done": 7, "skipped": 0, "failed": 1}
    assert "b.jpg: given up after 2 s (--timeout gives it longer)" in capsys.readouterr().err
    assert time.monotonic() - start < 60


def test_a_time_limit_without_processes_takes_one(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--timeout", 600) == 0
    assert rectify(archive, "-o", tmp_path / "plain", "--motion", motion) == 0
    assert results(tmp_path / "out") == results(tmp_path / "plain")
    assert rectify(archive, "-o", tmp_path / "no", "--motion", motion, "--timeout", "0.01") == 1
    told = capsys.readouterr().err
    assert "given up after 0.01 s" in told and "Traceback" not in told
    assert results(tmp_path / "no") == {} and leftovers(tmp_path / "no") == []


@pytest.mark.parametrize("wrong", [["--timeout", "0"], ["--timeout", "nan"], ["--timeout", "5", "--scheduler", "x"]])
def test_time_limits_that_cannot_be(wrong: list, archive: Path, tmp_path: Path, capsys) -> None:
    assert rectify(archive, "-o", tmp_path / "out", *wrong) == 2
    assert "--timeout" in capsys.readouterr().err
