"""Several workers: those that die, hang or are told to end cost nothing but their own photo."""

import os
import re
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest

from support.batches import leftovers, rectify, results
from support.covering import thorough
from unshutter.run.job import Job, Outcome
from unshutter.run.loop import Record
from unshutter.run.plan import Plan
from unshutter.run.report import Report
from unshutter.run.workers import Workers, processes
from unshutter.storage.locations import RunFiles
from unshutter.storage.targets import Target


def test_processes_make_the_same_pictures(archive: Path, motion: Path, tmp_path: Path) -> None:
    (archive / "bad.jpg").write_text("no photo")
    assert rectify(archive, "-o", tmp_path / "one", "--motion", motion) == 1
    assert rectify(archive, "-o", tmp_path / "two", "--motion", motion, "--jobs", 2) == 1
    assert results(tmp_path / "one") == results(tmp_path / "two")
    assert len(results(tmp_path / "one")) == 4


def do(jobs: list[Job], work: Callable[[Job], Outcome], workers: Workers, report: Report) -> None:
    """As the loop of a run does it."""
    record = Record(report, RunFiles())
    for job, outcome in workers.do(jobs, work, record.start):
        record.end(job, outcome)


def crash_on_b(job: Job) -> Outcome:
    if job.source.stem == "b":
        os._exit(9)
    return Outcome(group=str(os.getpid()))


def test_a_photo_that_kills_its_worker_costs_nothing_but_itself(tmp_path: Path, capsys) -> None:
    jobs = [Job(tmp_path / f"{name}.jpg", (Target(tmp_path / f"{name}.out.jpg"),)) for name in "abcdefgh"]
    with Report(Plan(jobs)) as report, processes(2) as workers:
        do(jobs, crash_on_b, workers, report)
    assert report.counts == {"done": 7, "skipped": 0, "failed": 1}
    assert "b.jpg: its worker died" in capsys.readouterr().err
    assert isinstance(workers.executor, ProcessPoolExecutor)


class Works(Executor):
    """Does each job when it is given."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


class BreaksWhenGiven(Works):
    """As a pool whose worker has died since the last job came back: it says so when it is given the next."""

    def submit(self, fn, /, *args, **kwargs):
        if args[0].source.stem == "c":
            raise BrokenProcessPool("a child process terminated abruptly")
        return super().submit(fn, *args, **kwargs)


def test_a_worker_that_dies_between_two_jobs_costs_nothing(tmp_path: Path) -> None:
    jobs = [Job(tmp_path / f"{name}.jpg", (Target(tmp_path / f"{name}.out.jpg"),)) for name in "abcdef"]
    with Report(Plan(jobs)) as report:
        workers = Workers(BreaksWhenGiven(), 2, Works)
        do(jobs, lambda job: Outcome(), workers, report)
    assert report.counts == {"done": 6, "skipped": 0, "failed": 0}


# ---- a photo that takes too long -----------------------------------------------------------------------------


def hang_on_b(job: Job) -> Outcome:
    """``b`` never ends, and lets nobody else in its process have a turn."""
    if job.source.stem == "b":
        re.match(r"(a|a)*c", "a" * 200)
    time.sleep(0.05)
    return Outcome(group=str(os.getpid()))


@pytest.mark.parametrize("count", [thorough(1), 2])
def test_a_photo_that_hangs_is_given_up_and_the_others_are_done(count: int, tmp_path: Path, capsys) -> None:
    jobs = [Job(tmp_path / f"{name}.jpg", (Target(tmp_path / f"{name}.out.jpg"),)) for name in "abcdefgh"]
    start = time.monotonic()
    with Report(Plan(jobs)) as report, processes(count, timeout_s=2) as workers:
        do(jobs, hang_on_b, workers, report)
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
    assert results(tmp_path / "no").items() < results(tmp_path / "plain").items()  # what was done before anyone looked
    assert leftovers(tmp_path / "no") == []


@pytest.mark.parametrize("wrong", [["--timeout", "0"], ["--timeout", "nan"], ["--timeout", "5", "--scheduler", "x"]])
def test_time_limits_that_cannot_be(wrong: list, archive: Path, tmp_path: Path, capsys) -> None:
    assert rectify(archive, "-o", tmp_path / "out", *wrong) == 2
    assert "--timeout" in capsys.readouterr().err
