"""A whole evaluation: all cases of a protocol, over processes, resumable, then the files that show it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from unshutter.batch.workers import settle_worker
from unshutter.errors import UnshutterError, UsageError
from unshutter.estimators import register
from unshutter.estimators.base import Estimator
from unshutter.evaluation.cases.case import Case, Record
from unshutter.evaluation.cases.protocols import PROTOCOLS, Request
from unshutter.evaluation.pages.plots import check_matplotlib
from unshutter.evaluation.pages.report import write_report
from unshutter.evaluation.results import Results, examples_of
from unshutter.evaluation.store import Store
from unshutter.progress import Progress

# what the libraries ask for how many threads they may start
_THREADS = ("VIPS_CONCURRENCY", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# (case, estimators still to be judged)
_Task = tuple[Case, list[str]]


def evaluate(request: Request, estimators: str, output: Path, jobs: int | None = None, overwrite: bool = False) -> int:
    """Measures estimators and writes results.md, results.json, results.csv, plots and contact sheets.

    Args:
        request: what is measured on what.
        estimators: names with commas between them, or ``all``.
        output: folder; a run that is there and was stopped goes on.
        jobs: processes; by default one for each processor. They have no say in the figures.
        overwrite: whether a run with other settings or code that is there may be thrown away.

    Returns:
        Number of pictures that could not be used.

    Raises:
        UsageError: unknown estimator or protocol, numbers that cannot be, another run in the folder.
        UnshutterError: data or an estimator's extra are missing, data cannot be used, the folder not written to.
    """
    names = _chosen(estimators)
    if request.per_photo < 1 or request.seed < 0 or (request.photos is not None and request.photos < 1):
        raise UsageError("needs at least one photo of a folder, one motion for it, and a seed of 0 or more")
    if jobs is not None and jobs < 1:
        raise UsageError(f"needs at least one process, got {jobs}")
    if request.protocol not in PROTOCOLS:
        raise UsageError(f"unknown protocol '{request.protocol}': choose one of {', '.join(PROTOCOLS)}")
    check_matplotlib()
    cases = PROTOCOLS[request.protocol].cases(request)
    for name in names:
        register.load(name)  # a missing extra is told before the work, not after
    store = Store(output, {key: _plain(value) for key, value in asdict(request).items()}, overwrite)
    rivals = list(dict.fromkeys(rival for case in cases for rival in case.rivals))
    tasks = [(case, store.missing(case.key, [*names, *case.rivals])) for case in cases]
    with Progress(len(cases), "pictures") as bar:
        for _ in range(sum(not missing for _, missing in tasks)):
            bar.advance()
        failed: dict[str, str] = {}  # case -> what is wrong with its picture
        for (case, missing), records in _judged([task for task in tasks if task[1]], jobs or os.cpu_count() or 1):
            if isinstance(records, str):  # a picture that cannot be used: the others are judged all the same
                if records not in failed.values():
                    bar.tell(f"unshutter: {records}")
                failed[case.key] = records
            else:
                store.add(case.key, missing, records)
            bar.advance()
    cases = [case for case in cases if case.key not in failed]
    records = store.records([case.key for case in cases], [*names, *rivals])
    if not records:
        raise UnshutterError("nothing could be measured")
    results = Results.of(request, names, rivals, records)
    examples = [case.show(names, _loaded) for case in examples_of(cases, records)]
    write_report(results.with_examples(examples), examples, output)
    return len(failed)


def _chosen(estimators: str) -> list[str]:
    names = register.names() if estimators == "all" else [name.strip() for name in estimators.split(",")]
    for name in names:
        register.check_name(name)
    return list(dict.fromkeys(names))


def _judged(tasks: list[_Task], jobs: int) -> Iterator[tuple[_Task, list[Record] | str]]:
    """The records of each task, in any order; a line instead where the picture cannot be used."""
    if jobs == 1 or len(tasks) < 2:
        for task in tasks:
            yield task, _judge(*task)
        return
    # spawned, not forked: libvips and OpenCV have threads that a fork would lose
    pool = ProcessPoolExecutor(min(jobs, len(tasks)), get_context("spawn"), settle_worker)
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))  # read by the libraries when the processes start
    try:
        running = {pool.submit(_judge, *task): task for task in tasks}
        for done in as_completed(running):
            yield running[done], done.result()
    except BrokenProcessPool:
        raise UnshutterError("a process died (out of memory?): what was finished is kept; try fewer --jobs") from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        for name, value in before.items():
            os.environ.pop(name)
            os.environ.update({name: value} if value is not None else {})


def _judge(case: Case, names: list[str]) -> list[Record] | str:
    try:
        return case.judge(names, _loaded)
    except UnshutterError as error:
        return str(error)


@cache
def _loaded(name: str) -> Estimator:
    """Every estimator once per process, however many there are."""
    return register.load(name)


def _plain(value: object) -> object:
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return str(value) if isinstance(value, Path) else value
