"""The main loop of a batch: passes jobs to workers, and outcomes to the manifest and the report."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from unshutter.batch.job import Job, Outcome
from unshutter.batch.manifest import Manifest
from unshutter.batch.report import Report
from unshutter.batch.workers import Workers
from unshutter.errors import UnknownRatioError, UnshutterError, UsageError, errors_in_one_line
from unshutter.storage.files import remove_leftovers
from unshutter.storage.places import check_place
from unshutter.storage.protection import Protection

Work = Callable[[Job], Outcome]


def check_outputs(job: Job, protection: Protection) -> None:
    """Checks that a job may write its outputs, as far as a quick check can tell.

    Raises:
        UnshutterError: an input, a link, or a file that must not be replaced is in the way.
    """
    for target in job.outputs:
        protection.check(target)
    perhaps_ours = job.may_repeat or job.left[0] is not None  # the worker checks the digest
    check_place(job.target, job.overwrite or perhaps_ours, job.source)


class Batch:
    """Runs jobs on workers.

    Args:
        work: performs a job; pickled along with the jobs if the workers are other processes.
        workers: the workers.
        manifest: of the output folder; None if no later run will look for the results.
        report: progress and messages for the user.
        protection: protects the files that the run reads.
    """

    def __init__(
        self,
        work: Work,
        workers: Workers,
        manifest: Manifest | None,
        report: Report,
        protection: Protection | None = None,
    ):
        self._work = work
        self._workers = workers
        self._manifest = manifest
        self._report = report
        self._protection = protection or Protection([])
        self._stopping = False
        self._running: dict[Future[Outcome], Job] = {}
        self._later: deque[Job] = deque()  # deferred until another run has finished them or is known to be dead

    def run(self, jobs: Iterable[Job]) -> None:
        """Runs all jobs.

        Raises:
            UnshutterError: the run cannot continue, for example because the manifest cannot be written.
        """
        waiting = deque(jobs)
        try:
            while waiting or self._later or self._running:
                starting: list[Job] = []
                while (waiting or self._later) and len(self._running) + len(starting) < self._workers.at_once:
                    job = waiting.popleft() if waiting else self._later.popleft()
                    if waiting and self._another_has_begun(job):
                        self._later.append(job)
                    elif self._may_start(job):
                        starting.append(self._begun(job))
                if self._manifest is not None:
                    self._manifest.flush()
                for job in starting:
                    self._running[self._submit(job)] = job
                self._collect()
        except KeyboardInterrupt:
            self._stop()
            raise
        finally:
            if self._manifest is not None:
                self._manifest.close()

    def _submit(self, job: Job) -> Future[Outcome]:
        """Submits the job; returns a failed future if a worker has just died unnoticed."""
        try:
            return self._workers.executor.submit(self._work, job)
        except BrokenExecutor as error:
            broken: Future[Outcome] = Future()
            broken.set_exception(error)
            return broken

    def _another_has_begun(self, job: Job) -> bool:
        if self._manifest is None:
            return False
        self._manifest.refresh()
        return self._manifest.begun_by_another(job)

    def _may_start(self, job: Job) -> bool:
        """Whether the job still needs doing and is allowed; reports it if not."""
        if self._manifest is not None and self._manifest.finished_by_another(job):
            self._report.skipped(job)
            return False
        try:
            with errors_in_one_line(job.source):
                check_outputs(job, self._protection)
        except UnshutterError as error:
            if not self._put_off(job):
                self._report_on(job, Outcome(str(error), isinstance(error, UsageError)))
            return False
        return True

    def _begun(self, job: Job) -> Job:
        """Records the start of a job and returns it as it is sent to the worker."""
        if self._manifest is not None:
            self._manifest.begin(job)
            job = replace(job, recorded=True)
        if not self._workers.elsewhere:
            return job
        return replace(job, may_repeat=True)

    def _collect(self) -> None:
        """Waits for at least one running job to end; returns at once if there is none."""
        crashed: dict[Future[Outcome], Job] = {}
        for future in wait(self._running, return_when=FIRST_COMPLETED).done:
            job = self._running.pop(future)
            error = _error_of(future)
            if isinstance(error, BrokenExecutor):
                crashed[future] = job
            elif isinstance(error, CancelledError):
                raise UnshutterError("the workers cannot be reached any more: give the same command again to go on")
            elif error is not None:
                line = f"{job.source}: {type(error).__name__}: {' '.join(str(error).split())}"
                self._finish(job, Outcome(line))
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
        overdue = {future for future in crashed if self._workers.is_overdue(future)}
        self._workers.executor = self._workers.renew()
        for folder in {job.target.parent for job in crashed.values()}:
            if isinstance(folder, Path):
                remove_leftovers(folder)
        if not overdue:
            self._one_by_one(crashed.values())
        for future, job in crashed.items():
            if future in overdue:
                self._finish(job, self._timed_out(job))
            elif overdue:
                again = replace(job, may_repeat=True)
                self._running[self._submit(again)] = again

    def _one_by_one(self, jobs: Iterable[Job]) -> None:
        for job in jobs:
            future = self._submit(replace(job, may_repeat=True))
            try:
                outcome = future.result()
            except BrokenExecutor:
                died = Outcome(f"{job.source}: its worker died: not enough memory, or a fault in a decoder")
                outcome = self._timed_out(job) if self._workers.is_overdue(future) else died
                self._workers.executor = self._workers.renew()
            self._finish(job, outcome)

    def _timed_out(self, job: Job) -> Outcome:
        limit_s = self._workers.timeout_s or 0.0
        return Outcome(f"{job.source}: given up after {limit_s:g} s (--timeout gives it longer)", seconds=limit_s)

    def _put_off(self, job: Job) -> bool:
        """Defers a failed job, and returns True, if another run is working on the same result."""
        if self._manifest is None or job.overwrite or job.may_repeat:
            return False
        self._manifest.refresh()
        if self._manifest.is_contested(job):
            self._later.append(replace(job, may_repeat=True))
            return True
        return False

    def _finish(self, job: Job, outcome: Outcome) -> None:
        if outcome.error and self._put_off(job):
            return
        if self._manifest is not None:
            self._manifest.end(job, outcome)
        self._report_on(job, outcome)

    def _report_on(self, job: Job, outcome: Outcome) -> None:
        if not outcome.error:
            self._report.done(job, outcome)
        elif self._report.total == 1:
            unknown = UnknownRatioError if outcome.unknown_ratio else UnshutterError
            raise (UsageError if outcome.usage else unknown)(outcome.error)
        else:
            self._report.failed(job.source, outcome.error, outcome.seconds)

    def _stop(self) -> None:
        """Drops jobs that have not started and waits for the others."""
        self._stopping = True
        for future in list(self._running):
            if future.cancel():
                del self._running[future]
        if self._running:
            with suppress(OSError):  # the terminal is closed
                self._report.tell("unshutter: finishing the photos that are at work (Ctrl-C again to drop them)")
        while self._running:
            self._collect()


def _error_of(future: Future[Outcome]) -> BaseException | None:
    """Returns the exception of a completed future; a scheduler that shuts down cancels all its jobs."""
    try:
        return future.exception()
    except CancelledError as cancelled:
        return cancelled
