"""Processes that give up on a job that takes too long. Imported only where there are processes: it takes a while."""

from __future__ import annotations

import faulthandler
import os
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

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
