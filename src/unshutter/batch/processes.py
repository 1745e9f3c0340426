"""Workers that are processes of this machine, and end themselves when a job takes too long."""

from __future__ import annotations

import faulthandler
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

from unshutter.batch.workers import Workers
from unshutter.storage.files import remove_own_parts

LONGEST_JOB_S = 1800.0  # unless the user says otherwise: the largest photo takes minutes on a slow processor


@contextmanager
def processes(count: int, timeout_s: float | None = None, all_processors: bool = False) -> Iterator[Workers]:
    """Processes on this machine.

    Args:
        count: how many.
        timeout_s: longest time of a job; by default half an hour.
        all_processors: whether each uses all processors, rather than one.
    """
    limit_s = LONGEST_JOB_S if timeout_s is None else timeout_s

    def pool() -> Executor:
        pools.append(TimedPool(count, limit_s, settle_only_worker if all_processors else settle_worker))
        return pools[-1]

    def is_overdue(future: Future[Any]) -> bool:
        return any(each.is_overdue(future) for each in pools)

    _keep_tracker_from_hanging_up()
    pools: list[TimedPool] = []
    try:
        yield Workers(pool(), 2 * count, pool, timeout_s=limit_s, is_overdue=is_overdue)
    finally:
        for each in pools:
            each.shutdown(wait=True, cancel_futures=True)


def _keep_tracker_from_hanging_up() -> None:
    """Starts multiprocessing's helper, which outlives the workers, such that SIGHUP does not end it before them.

    Python sees to the same for SIGINT and SIGTERM. Else its successor would complain that it knows nothing.
    """
    from multiprocessing import resource_tracker

    if hasattr(signal, "SIGHUP") and threading.current_thread() is threading.main_thread():
        before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
        resource_tracker.ensure_running()
        signal.signal(signal.SIGHUP, before)


def settle_worker() -> None:
    """Makes a worker process use one processor, leave Ctrl-C to its parent, and end when its parent does.

    When terminated, it removes what it has half written.
    """
    for name in ("VIPS_CONCURRENCY", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    import cv2

    cv2.setNumThreads(1)
    settle_only_worker()


def settle_only_worker() -> None:
    """Makes a worker process leave Ctrl-C to its parent, and end when its parent does; it uses all processors."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _end)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end(number: int, _frame: object) -> None:
    remove_own_parts()
    os._exit(128 + number)  # an exception would be taken for the job's, and the worker go on


def _end_with_parent() -> None:
    """A killed parent cannot notify its workers, and they would wait for work indefinitely."""
    from multiprocessing import parent_process
    from multiprocessing.connection import wait

    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        remove_own_parts()
        os._exit(1)


_clock: Any = None  # in a worker: when the job in each place began


class TimedPool(ProcessPoolExecutor):
    """A pool whose workers end themselves when a job takes too long: nothing else stops a decoder that hangs.

    The end of one worker breaks the pool, as every worker's death does; :meth:`is_overdue` says whose job it was.

    Args:
        count: of processes.
        timeout_s: longest time of a job.
        settle: what a new process does first.
    """

    def __init__(self, count: int, timeout_s: float, settle: Callable[[], None]):
        context = get_context(
            "spawn"
        )  # a fork would copy libvips's and OpenCV's locks without the threads that hold them
        self._began = context.RawArray("d", 4 * count)
        self._free = list(range(len(self._began)))
        self._places: dict[Future[Any], int] = {}
        self._timeout_s = timeout_s
        super().__init__(count, mp_context=context, initializer=_settle, initargs=(self._began, settle))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """See ProcessPoolExecutor."""
        place = self._free.pop() if self._free else None
        if place is not None:
            self._began[place] = 0
        future = super().submit(_timed, place, self._timeout_s, fn, *args, **kwargs)
        if place is not None:
            self._places[future] = place
            future.add_done_callback(self._set_free)
        return future

    def _set_free(self, future: Future[Any]) -> None:
        if future.cancelled() or not isinstance(future.exception(), BrokenExecutor):
            self._free.append(self._places.pop(future))

    def is_overdue(self, future: Future[Any]) -> bool:
        """Whether a job that was not done when the pool broke had been given all its time."""
        place = self._places.get(future)
        began = 0.0 if place is None else self._began[place]
        return began > 0 and time.monotonic() - began >= self._timeout_s


def _settle(clock: Any, settle: Callable[[], None]) -> None:
    global _clock
    _clock = clock
    settle()


def _timed(place: int | None, timeout_s: float, fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Does a job; ends this process if it takes too long, whatever keeps it busy: the watch needs no Python."""
    if place is not None:
        _clock[place] = time.monotonic()
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(timeout_s, exit=True, file=nowhere)
        try:
            return fn(*args, **kwargs)
        finally:
            faulthandler.cancel_dump_traceback_later()
