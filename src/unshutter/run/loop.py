"""The main loop of a batch: passes jobs to workers, and outcomes to the manifest and the report."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from typing import ParamSpec, TypeVar

from unshutter.errors import UnshutterError, errors_in_one_line
from unshutter.run.ahead import PreviewError
from unshutter.run.folder import Folder, Judged
from unshutter.run.manifest import Manifest
from unshutter.run.report import Report
from unshutter.run.work import Job, Outcome
from unshutter.storage.files import check_target, remove_leftovers
from unshutter.storage.locations import RunFiles
from unshutter.storage.objects import is_object
from unshutter.storage.targets import TargetKind

P = ParamSpec("P")
T = TypeVar("T")


@dataclass
class Workers:
    """An executor and how to use it."""

    executor: Executor  # runs the jobs
    at_once: int  # number of jobs to submit before the first has ended, enough to keep all workers busy
    renew: Callable[[], Executor]  # creates a new executor after a worker's death broke the old one
    elsewhere: bool = False  # whether a job may run twice because a worker died unnoticed
    timeout_s: float | None = None  # longest duration of a job; None: no limit
    # whether a job whose worker died had used up its time
    is_overdue: Callable[[Future], bool] = lambda _: False


class InThisProcess(Executor):
    """Runs each job immediately when it is submitted."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Runs the job and returns a completed future."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


Work = Callable[[Job], Outcome]
_IF_UNCHANGED = (TargetKind.UNCHANGED, TargetKind.UNCHANGED_MASK)


def check_outputs(job: Job, files: RunFiles, new_folders: bool = False) -> None:
    """Checks that a job may write its outputs, as far as a quick check can tell; new folders will be created."""
    for target in job.targets:
        place = target.path
        if new_folders and not (is_object(place) or place.parent.is_dir()):
            continue
        files.check(place)
        # the worker checks the digest of what an earlier run may have written, and whether the file at the place of a
        # copy is such a copy
        known = target.left is not None or target.kind in _IF_UNCHANGED
        check_target(place, job.overwrite or job.may_repeat or known)


@dataclass
class Batch:
    """Runs jobs on workers; ``work`` is pickled along with the jobs if these are other processes."""

    work: Work
    workers: Workers
    manifest: Manifest | None
    report: Report
    files: RunFiles = field(default_factory=RunFiles)
    folder: Folder | None = None  # what the photos say together; None: each is judged by itself
    _stopping: bool = field(default=False, init=False)
    _running: dict[Future[Outcome], Job] = field(default_factory=dict, init=False)
    _left_in: set[Path] = field(default_factory=set, init=False)  # folders in which workers were writing when they died
    # futures that ended, some twice; futures.wait would leave them locked if a signal came while it takes their locks
    _ended: SimpleQueue[Future[Outcome]] = field(default_factory=SimpleQueue, init=False)

    def run(self, jobs: Iterable[Job]) -> None:
        """Runs all jobs, then again those that the other photos of their folder decide differently."""
        self._run(jobs)
        if self.folder is not None:
            self._run(self.folder.to_redo())

    def remove_leftovers(self) -> None:
        """Removes what workers that died left: to be called again when all have ended, as they hold files till then."""
        for folder in self._left_in:
            remove_leftovers(folder)

    def _run(self, jobs: Iterable[Job]) -> None:
        waiting = deque(jobs)
        try:
            while waiting or self._running:
                starting: list[Job] = []
                while waiting and len(self._running) + len(starting) < self.workers.at_once:
                    job = waiting.popleft()
                    if self._may_start(job):
                        starting.append(self._record_start(job))
                if self.manifest is not None:
                    self.manifest.flush()
                for job in starting:
                    self._start(job)
                self._collect()
        except KeyboardInterrupt:
            self._stop()
            raise

    def _start(self, job: Job) -> None:
        future = self._submit(job)
        self._running[future] = job
        future.add_done_callback(self._ended.put)

    def _submit(self, job: Job) -> Future[Outcome]:
        """Submits the job; returns a failed future if a worker has just died unnoticed."""
        try:
            return self.workers.executor.submit(self.work, job)
        except BrokenExecutor as error:
            broken: Future[Outcome] = Future()
            broken.set_exception(error)
            return broken

    def _may_start(self, job: Job) -> bool:
        """Whether a job is allowed; reports it if not."""
        try:
            with errors_in_one_line(job.source):
                check_outputs(job, self.files)
        except UnshutterError as error:
            self._report_on(job, Outcome(error))
            return False
        return True

    def _record_start(self, job: Job) -> Job:
        """Records the start of a job and returns it as it is sent to the worker."""
        if self.manifest is not None:
            self.manifest.begin(job)
        job = replace(job, recorded=self.manifest is not None or self.folder is not None)
        return replace(job, may_repeat=True) if self.workers.elsewhere else job

    def _collect(self) -> None:
        """Waits for a running job to end, if there is one, and takes all that have."""
        crashed: dict[Future[Outcome], Job] = {}
        ended = [self._ended.get()] if self._running else []
        while not self._ended.empty():
            ended.append(self._ended.get())
        for future in ended:
            job = self._running.pop(future, None)
            if job is None:  # it was given up, or is here for the second time
                continue
            error = _error_of(future)
            if isinstance(error, BrokenExecutor):
                crashed[future] = job
            elif isinstance(error, CancelledError):
                raise UnshutterError("the workers cannot be reached any more: run the same command again to continue")
            elif error is not None:
                self._finish(job, _fail(job, f"{type(error).__name__}: {' '.join(str(error).split())}"))
            else:
                self._finish(job, future.result())
        if crashed and self._stopping:  # the signal that stopped this process may also have ended its workers
            self._running = {}
        elif crashed:
            crashed |= self._running  # all jobs of a broken executor
            self._running = {}
            self._go_on_after(crashed)

    def _go_on_after(self, crashed: dict[Future[Outcome], Job]) -> None:
        """Finds out which of the jobs killed its worker, and restarts the others."""
        overdue = {future for future in crashed if self.workers.is_overdue(future)}
        self.workers.executor = self.workers.renew()
        self._left_in |= {job.picture.parent for job in crashed.values()}
        self.remove_leftovers()
        if not overdue:
            self._one_by_one(crashed.values())
        for future, job in crashed.items():
            if future in overdue:
                self._finish(job, self._time_out(job))
            elif overdue:
                self._start(replace(job, may_repeat=True))

    def _one_by_one(self, jobs: Iterable[Job]) -> None:
        for job in jobs:
            future = self._submit(replace(job, may_repeat=True))
            try:
                outcome = future.result()
            except BrokenExecutor:
                died = _fail(job, "its worker died: not enough memory, or a fault in a decoder")
                outcome = self._time_out(job) if self.workers.is_overdue(future) else died
                self.workers.executor = self.workers.renew()
            self._finish(job, outcome)

    def _time_out(self, job: Job) -> Outcome:
        limit_s = self.workers.timeout_s or 0.0
        return replace(_fail(job, f"given up after {limit_s:g} s ({{--timeout}} gives it longer)"), seconds=limit_s)

    def _finish(self, job: Job, outcome: Outcome) -> None:
        if self.manifest is not None:
            self.manifest.end(job, outcome)
        if self.folder is not None and outcome.error is None:
            digests = {file.path: file.digest for file in outcome.written}
            targets = tuple(replace(target, left=digests.get(target.path)) for target in job.targets)
            self.folder.add(replace(job, targets=targets), Judged.of(job, outcome))
        self._report_on(job, outcome)

    def _report_on(self, job: Job, outcome: Outcome) -> None:
        if outcome.error is None:
            self.report.done(job, outcome)
        elif self.report.total == 1:
            raise outcome.error
        elif isinstance(outcome.error, PreviewError):
            self.report.not_taken(job)
        else:
            self.report.failed(job.source, str(outcome.error), outcome.seconds)

    def _stop(self) -> None:
        """Drops jobs that have not started and waits for the others."""
        self._stopping = True
        for future in list(self._running):
            if future.cancel():
                del self._running[future]
            else:  # the signal may have come before its end was noted
                future.add_done_callback(self._ended.put)
        if self._running:
            with suppress(OSError):  # the terminal is closed
                self.report.tell("unshutter: finishing the photos in progress (press Ctrl-C again to abandon them)")
        while self._running:
            self._collect()


def _fail(job: Job, message: str) -> Outcome:
    """Returns the outcome of a job that no worker could end."""
    return Outcome(UnshutterError(f"{{photo}}: {message}", photo=job.source))


def _error_of(future: Future[Outcome]) -> BaseException | None:
    """Returns the exception of a completed future; a scheduler that shuts down cancels all its jobs."""
    try:
        return future.exception()
    except CancelledError as cancelled:
        return cancelled
