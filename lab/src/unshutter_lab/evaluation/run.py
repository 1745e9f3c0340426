"""Runs an evaluation: judges all cases of a protocol in several processes, resumably, and writes the report."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from functools import cache
from itertools import chain
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from unshutter.errors import UnshutterError, UsageError
from unshutter.progress import Progress
from unshutter.run.workers import settle_worker
from unshutter.single import register
from unshutter.single.estimator import Estimator
from unshutter.storage.files import written_whole
from unshutter.storage.locations import RunFiles
from unshutter_lab.evaluation.answers import PREFIX, FolderAnswers, answers_in
from unshutter_lab.evaluation.case import Example, Record, Trial
from unshutter_lab.evaluation.pair_cases import logs_in, pictures_in
from unshutter_lab.evaluation.plots import check_matplotlib, draw_plots, write_sheet
from unshutter_lab.evaluation.protocols import PROTOCOLS, Protocol, Request
from unshutter_lab.evaluation.results import Results, Store, examples_of
from unshutter_lab.evaluation.tables import tables

# environment variables that limit the threads of libraries, which read them when they are loaded
_THREADS = ("VIPS_CONCURRENCY", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
AnyTrial = TypeVar("AnyTrial", bound=Trial)
# (case, names not judged yet)
_Task = tuple[AnyTrial, list[str]]


def evaluate(
    request: Request,
    estimators: str,
    output: Path,
    jobs: int | None = None,
    overwrite: bool = False,
    answers: Sequence[Path] = (),
) -> int:
    """Measures estimators and writes results.md, results.json, results.csv, plots and contact sheets.

    Args:
        request: what to measure.
        estimators: comma-separated names, or ``all``.
        output: output folder; an interrupted run in it is resumed.
        jobs: number of processes; by default one per processor. The figures do not depend on it.
        overwrite: whether a run in the folder with other settings or code may be discarded.
        answers: folders of motion files, each a method's answers (answers.py).

    Returns:
        The number of pictures that could not be used.
    """
    protocol = PROTOCOLS[request.protocol]
    names = _chosen(estimators, protocol)
    if answers and protocol.methods:
        raise UsageError(f"--answers is for protocols of photos, which {request.protocol} is not")
    check_jobs(jobs)
    check_matplotlib()
    cases = protocol.cases(request)
    for name in names if not protocol.methods else ():
        register.load(name)  # reports a missing extra before the work
    if protocol.check is not None:
        protocol.check(names)
    _check_output(output, request, names, answers)
    names = list(dict.fromkeys([*names, *answers_in(answers, cases)]))
    store = Store(output, json.loads(json.dumps(asdict(request), default=str)), overwrite)
    measured = measure(cases, names, store, jobs)
    oracles = list(dict.fromkeys(oracle for case in cases for oracle in case.oracles))
    records = store.records([case.key for case in measured], [*names, *oracles])
    if not records:
        raise UnshutterError("nothing could be measured")
    shown = [case.show(names, _loaded) for case in examples_of(measured, records)]
    examples = [example for example in shown if example is not None]
    write_report(Results.of(request, names, oracles, records).with_examples(examples), examples, output)
    return len(cases) - len(measured)


def _check_output(folder: Path, request: Request, names: list[str], answers: Sequence[Path]) -> None:
    """Raises UnshutterError if the output folder contains files that the run reads."""
    logs = logs_in(request.trajectory) if request.trajectory is not None else ()
    given = chain.from_iterable(folder.glob("*.json") for folder in answers)
    read = [*given, *chain.from_iterable(map(pictures_in, request.data)), *logs, *map(register.weights_file, names)]
    RunFiles(reads=read).check_all_in(folder)


def check_jobs(jobs: int | None) -> None:
    """Raises UsageError if the number of processes is invalid."""
    if jobs is not None and jobs < 1:
        raise UsageError(f"needs at least one process, got {jobs}")


def measure(cases: Sequence[AnyTrial], names: list[str], store: Store, jobs: int | None) -> list[AnyTrial]:
    """Judges everything not in the store yet; returns the cases whose pictures could be used."""
    tasks = [(case, store.missing(case.key, [*names, *case.oracles])) for case in cases]
    waiting = [task for task in tasks if task[1]]
    problems: dict[str, str] = {}  # case -> problem with its picture
    with Progress(len(cases), "pictures") as bar:
        for _ in range(len(tasks) - len(waiting)):
            bar.advance()
        for (case, missing), records in _judged(waiting, jobs or os.cpu_count() or 1):
            if isinstance(records, str):
                if records not in problems.values():  # one photo has several cases
                    bar.tell(f"unshutter: {records}")
                problems[case.key] = records
            else:
                store.add(case.key, missing, records)
            bar.advance()
    return [case for case in cases if case.key not in problems]


def _chosen(estimators: str, protocol: Protocol) -> list[str]:
    known = protocol.methods or register.names()
    names = known if estimators == "all" else [name.strip() for name in estimators.split(",")]
    for name in names:
        if not protocol.methods:
            register.check_name(name)
        elif name not in known:
            raise UsageError(f"'{name}' is not compared by this protocol: choose from {', '.join(known)}")
    return list(dict.fromkeys(names))


def _judged(tasks: list[_Task[AnyTrial]], jobs: int) -> Iterator[tuple[_Task[AnyTrial], list[Record] | str]]:
    """Yields the records of each task, in any order, or an error message if the picture cannot be used."""
    if jobs == 1 or len(tasks) < 2:
        for task in tasks:
            yield task, _judge(*task)
        return
    # spawned, not forked: libvips and OpenCV have threads that a fork would lose
    pool = ProcessPoolExecutor(min(jobs, len(tasks)), get_context("spawn"), settle_worker)
    before = {name: os.environ.get(name) for name in _THREADS}
    try:
        os.environ.update(dict.fromkeys(_THREADS, "1"))  # for the processes started now
        running = {pool.submit(_judge, *task): task for task in tasks}
        for done in as_completed(running):
            yield running[done], done.result()
    except BrokenProcessPool:
        raise UnshutterError("a process died (out of memory?): finished results are kept; try fewer --jobs") from None
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            os.environ.update({name: value} if value is not None else {})
        pool.shutdown(wait=True, cancel_futures=True)


def _judge(case: Trial, names: list[str]) -> list[Record] | str:
    """Returns the records of a case, or the problem with its picture."""
    try:
        return case.judge(names, _loaded)
    except UnshutterError as error:
        return str(error)


@cache
def _loaded(name: str) -> Estimator:
    """Returns the estimator with that name, loaded once per process."""
    if name.startswith(PREFIX):
        return FolderAnswers(Path(name.removeprefix(PREFIX)))
    return register.load(name)


def write_report(results: Results, examples: list[Example], folder: Path) -> None:
    """Writes tables, plots, contact sheets and figures of a run."""
    sheets = [(f"sheet_{k}.jpg", example.title) for k, example in enumerate(examples, start=1)]
    for (file, _), example in zip(sheets, examples, strict=True):
        write_sheet(example, folder / file)
    write_text(folder / "results.json", results.to_json() + "\n")
    write_text(folder / "results.csv", results.to_csv())
    write_text(folder / "results.md", page(results, draw_plots(results, folder), sheets))


def page(
    results: Results, plots: list[tuple[str, str]], sheets: list[tuple[str, str]], figures: str | None = None
) -> str:
    """Returns the Markdown page of one run."""
    protocol = PROTOCOLS[results.request.protocol]
    parts = [f"# {protocol.title}", protocol.description, _counts(results), f"```sh\n{results.command}\n```"]
    parts.append(tables(results) if figures is None else figures)
    parts += [f"![Plot]({file})\n\n*{caption}*" for file, caption in plots]
    parts += [f"![Pictures]({file})\n\n*{caption}*" for file, caption in sheets]
    return "\n\n".join(parts) + "\n"


def write_text(path: Path, text: str) -> None:
    """Writes a text file completely or not at all."""
    with written_whole(path) as part:
        part.write_text(text, encoding="utf-8")


def _counts(results: Results) -> str:
    """Describes the number of pictures per folder; the command shows how they were selected."""
    photos = results.frame.groupby("group", sort=False)["photo"].nunique()
    listed = ", ".join(f"{group} {count}" for group, count in photos.items())
    kinds = {"places": "Places", "sequences": "Photos, seen by each log at each ratio"}
    kinds |= dict.fromkeys(("pairs", "video"), "Sequences") | dict.fromkeys(("real clips", "rendered clips"), "Clips")
    what = kinds.get(PROTOCOLS[results.request.protocol].kind, "Photos")
    return f"{what}: {listed}."
