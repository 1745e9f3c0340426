"""Workers that do the work elsewhere: processes on this machine, which exit when a job takes too long, or a cluster."""

from __future__ import annotations

import faulthandler
import logging
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    InvalidStateError,
    ProcessPoolExecutor,
)
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, ParamSpec, TypeVar, cast

from unshutter import version
from unshutter.errors import UnshutterError
from unshutter.run.job import Job, Outcome
from unshutter.storage.files import remove_leftovers, remove_own_parts

if TYPE_CHECKING:
    from ctypes import Array, c_double

P = ParamSpec("P")
T = TypeVar("T")

LONGEST_JOB_S = 1800.0  # unless the user chooses another limit: the largest photo takes minutes on a slow processor


@dataclass
class Workers:
    """An executor of jobs, and what to do when workers die: a job that kills its worker costs nothing but itself."""

    executor: Executor  # runs the jobs
    at_once: int  # number of jobs to submit before the first has ended, enough to keep all workers busy
    renew: Callable[[], Executor]  # creates a new executor after a worker's death broke the old one
    may_repeat: bool = False  # whether a job may run twice because a worker died unnoticed
    timeout_s: float | None = None  # longest duration of a job; None: no limit
    # whether a job whose worker died had used up its time
    is_overdue: Callable[[Future], bool] = lambda _: False
    _work: Callable[[Job], Outcome] = field(init=False)  # pickled along with the jobs
    _stopping: bool = field(default=False, init=False)
    _running: dict[Future[Outcome], Job] = field(default_factory=dict, init=False)
    _left_in: set[Path] = field(default_factory=set, init=False)  # folders in which workers were writing when they died
    # futures that ended, some twice; futures.wait would leave them locked if a signal came while it takes their locks
    _ended: SimpleQueue[Future[Outcome]] = field(default_factory=SimpleQueue, init=False)

    def do(
        self, jobs: Iterable[Job], work: Callable[[Job], Outcome], may_start: Callable[[Job], bool]
    ) -> Iterator[tuple[Job, Outcome]]:
        """Does the jobs that may start, and yields what came of each as it ends."""
        self._work = work
        waiting = deque(jobs)
        while waiting or self._running:
            while waiting and len(self._running) < self.at_once:
                job = waiting.popleft()
                if may_start(job):
                    self._start(replace(job, may_repeat=True) if self.may_repeat else job)
            yield from self._collect()

    def stop(self, tell: Callable[[str], None]) -> Iterator[tuple[Job, Outcome]]:
        """Drops jobs that have not started, and yields what came of the others."""
        self._stopping = True
        for future in list(self._running):
            if future.cancel():
                del self._running[future]
            else:  # the signal may have come before its end was noted
                future.add_done_callback(self._ended.put)
        if self._running:
            with suppress(OSError):  # the terminal is closed
                tell("unshutter: finishing the photos in progress (press Ctrl-C again to abandon them)")
        while self._running:
            yield from self._collect()

    def remove_leftovers(self) -> None:
        """Removes what dead workers left; to be called again when all have ended, since they hold files until then."""
        for folder in self._left_in:
            remove_leftovers(folder)

    def _start(self, job: Job) -> None:
        future = self._submit(job)
        self._running[future] = job
        future.add_done_callback(self._ended.put)

    def _submit(self, job: Job) -> Future[Outcome]:
        """Submits the job; returns a failed future if a worker has just died unnoticed."""
        try:
            return self.executor.submit(self._work, job)
        except BrokenExecutor as error:
            broken: Future[Outcome] = Future()
            broken.set_exception(error)
            return broken

    def _collect(self) -> Iterator[tuple[Job, Outcome]]:
        """Waits for a running job to end, if there is one, and yields all that have."""
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
                yield job, _fail(job, f"{type(error).__name__}: {' '.join(str(error).split())}")
            else:
                yield job, future.result()
        if crashed and self._stopping:  # the signal that stopped this process may also have ended its workers
            self._running = {}
        elif crashed:
            crashed |= self._running  # all jobs of a broken executor
            self._running = {}
            yield from self._go_on_after(crashed)

    def _go_on_after(self, crashed: dict[Future[Outcome], Job]) -> Iterator[tuple[Job, Outcome]]:
        """Finds out which of the jobs killed its worker, and restarts the others."""
        overdue = {future for future in crashed if self.is_overdue(future)}
        self.executor = self.renew()
        self._left_in |= {job.picture.parent for job in crashed.values()}
        self.remove_leftovers()
        for future, job in crashed.items():
            if not overdue:
                yield job, self._do_alone(replace(job, may_repeat=True))
            elif future in overdue:
                yield job, self._time_out(job)
            else:
                self._start(replace(job, may_repeat=True))

    def _do_alone(self, job: Job) -> Outcome:
        """Does a job while no other runs, which shows whether it kills its worker."""
        future = self._submit(job)
        try:
            return future.result()
        except BrokenExecutor:
            is_overdue = self.is_overdue(future)
            self.executor = self.renew()
        died = "its worker died: not enough memory, or a fault in a decoder"
        return self._time_out(job) if is_overdue else _fail(job, died)

    def _time_out(self, job: Job) -> Outcome:
        limit_s = self.timeout_s or 0.0
        return replace(_fail(job, f"given up after {limit_s:g} s ({{--timeout}} gives it longer)"), seconds=limit_s)


def _fail(job: Job, message: str) -> Outcome:
    """Returns the outcome of a job that no worker could end."""
    return Outcome(UnshutterError(f"{{photo}}: {message}", photo=job.source))


def _error_of(future: Future[Outcome]) -> BaseException | None:
    """Returns the exception of a completed future; a scheduler that shuts down cancels all its jobs."""
    try:
        return future.exception()
    except CancelledError as cancelled:
        return cancelled


# ---- processes --------------------------------------------------------------------------------------------------


@contextmanager
def processes(count: int, timeout_s: float | None = None, all_processors: bool = False) -> Iterator[Workers]:
    """Starts worker processes on this machine, each on one processor or on all of them.

    A job may take half an hour unless its limit is given.
    """
    limit_s = LONGEST_JOB_S if timeout_s is None else timeout_s

    def pool() -> Executor:
        pools.append(TimedPool(count, limit_s, settle_only_worker if all_processors else settle_worker))
        return pools[-1]

    def is_overdue(future: Future) -> bool:
        return any(each.is_overdue(future) for each in pools)

    _keep_tracker_from_hanging_up()
    pools: list[TimedPool] = []
    workers = Workers(pool(), 2 * count, pool, timeout_s=limit_s, is_overdue=is_overdue)
    try:
        yield workers
    finally:
        for each in pools:
            each.shutdown(wait=True, cancel_futures=True)
        workers.remove_leftovers()


def _keep_tracker_from_hanging_up() -> None:
    """Starts multiprocessing's resource tracker, which outlives the workers, with SIGHUP ignored.

    Python does so for SIGINT and SIGTERM only. A tracker ended by SIGHUP would be replaced by one that complains of
    unknown resources.
    """
    if hasattr(signal, "SIGHUP") and threading.current_thread() is threading.main_thread():
        before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
        resource_tracker.ensure_running()
        signal.signal(signal.SIGHUP, before)


def settle_worker() -> None:
    """Restricts a worker process to one processor, leaves Ctrl-C to its parent, and ends it when its parent ends.

    When terminated, it removes its partial files.
    """
    for name in ("VIPS_CONCURRENCY", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    import cv2

    cv2.setNumThreads(1)
    settle_only_worker()


def settle_only_worker() -> None:
    """Leaves Ctrl-C to a worker's parent, and ends the worker when its parent ends; it uses all processors."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _end)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end(number: int, _frame: object) -> None:
    remove_own_parts()
    os._exit(128 + number)  # an exception would count as the job's, and the worker would continue


def _end_with_parent() -> None:
    """Ends this worker when its parent ends: a killed parent cannot notify workers, which would wait indefinitely."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        remove_own_parts()
        os._exit(1)


_clock: Array[c_double] | None = None  # in a worker: start times of the jobs, by slot


class _Result(Future[T]):
    """The future of a job, which may be cancelled before its worker dies: Python 3.11 reports that death to it, too."""

    def set_exception(self, exception: BaseException | None) -> None:
        """Sets the exception unless the job was cancelled."""
        with suppress(InvalidStateError):
            super().set_exception(exception)


class TimedPool(ProcessPoolExecutor):
    """A pool whose workers exit when a job takes too long: nothing else stops a decoder that hangs.

    A worker's exit breaks the pool, as any worker's death does; :meth:`is_overdue` identifies the job responsible. Each
    new process calls ``settle`` first.
    """

    def __init__(self, count: int, timeout_s: float, settle: Callable[[], None]):
        # a fork would copy libvips's and OpenCV's locks without the threads that hold them
        context = get_context("spawn")
        self._began = context.RawArray("d", 4 * count)
        self._free = list(range(len(self._began)))
        self._places: dict[Future, int] = {}
        self._timeout_s = timeout_s
        super().__init__(count, mp_context=context, initializer=_settle, initargs=(self._began, settle))

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Submits a job and assigns it a slot for its start time."""
        place = self._free.pop() if self._free else None
        if place is not None:
            self._began[place] = 0
        future = super().submit(_timed, place, self._timeout_s, fn, *args, **kwargs)
        future.__class__ = _Result
        if place is not None:
            self._places[future] = place
            future.add_done_callback(self._set_free)
        return future

    def _set_free(self, future: Future) -> None:
        if future.cancelled() or not isinstance(future.exception(), BrokenExecutor):
            self._free.append(self._places.pop(future))

    def is_overdue(self, future: Future) -> bool:
        """Whether an unfinished job had used up its time when the pool broke."""
        place = self._places.get(future)
        began = 0.0 if place is None else self._began[place]
        return began > 0 and time.monotonic() - began >= self._timeout_s


def _settle(clock: Array[c_double], settle: Callable[[], None]) -> None:
    global _clock
    _clock = clock
    settle()


def _timed(place: int | None, timeout_s: float, fn: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Runs a job; ends this process if it takes too long, even in native code: the watchdog does not need Python."""
    if place is not None and _clock is not None:
        _clock[place] = time.monotonic()
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(timeout_s, exit=True, file=nowhere)
        try:
            return fn(*args, **kwargs)
        finally:
            faulthandler.cancel_dump_traceback_later()


# ---- cluster ----------------------------------------------------------------------------------------------------


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """Connects to the workers of a Dask scheduler, which need unshutter and the same view of the files."""
    try:
        from distributed import Client
    except ImportError as error:
        raise UnshutterError(f"{{--scheduler}} needs the extra: {version.extra('dask')} ({error})") from None
    try:
        client = Client(address, timeout=5, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise UnshutterError(f"cannot reach the Dask scheduler {address}: {' '.join(str(error).split())}") from None
    for name in ("distributed", "distributed.client", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # no tracebacks when the scheduler shuts down
    with client:

        def executor() -> Executor:
            return client.get_executor(pure=False)

        threads = cast(dict[str, int], client.nthreads())
        yield Workers(executor(), max(4 * sum(threads.values()), 32), executor, may_repeat=True)
