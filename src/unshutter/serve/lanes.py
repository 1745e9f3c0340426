"""Worker processes with a priority queue, which isolate the server from crashes in decoders.

A lane is a worker process that runs one job at a time, so that a crash can be traced to its job. Jobs queue for a lane
in order of urgency; the last free lane is reserved for jobs whose result a user is waiting to see.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import os
import signal
from collections.abc import Callable
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack, suppress
from enum import IntEnum
from typing import Any, TypeVar

from unshutter.batch.processes import processes
from unshutter.batch.workers import Workers
from unshutter.errors import UnshutterError
from unshutter.serve.jobs.photo import warm

R = TypeVar("R")


class Urgency(IntEnum):
    """Priority of a job in the queue."""

    NOW = 0  # a user is waiting at the screen
    LATER = 1


class Busy(UnshutterError):
    """The job queue is full."""


class _Lane:
    """A worker process, started on demand and stopped when idle for a while."""

    def __init__(self, workers: Workers):
        self._workers = workers
        self._pid: int | None = None

    async def do(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Runs a job in the worker process.

        Raises:
            UnshutterError: the job raised it, or its process died or took too long.
        """
        future = None
        try:
            if self._pid is None:
                self._pid = await asyncio.wrap_future(self._workers.executor.submit(warm))
            future = self._workers.executor.submit(work, *arguments)
            return await asyncio.wrap_future(future)
        except BrokenExecutor:
            overdue = future is not None and self._workers.is_overdue(future)
            self.end()
            if overdue:
                raise UnshutterError(f"given up after {self._workers.timeout_s or 0:g} s") from None
            raise UnshutterError("its worker died: not enough memory, or a fault in a decoder") from None
        except asyncio.CancelledError:
            self.end()
            raise

    def rest(self) -> None:
        """Stops the idle process to free its memory."""
        if self._pid is not None:
            self.end()

    def end(self) -> None:
        """Kills the process, even during a job; the next job starts a new one."""
        pid, self._pid = self._pid, None
        if pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))
        self._workers.executor.shutdown(wait=False, cancel_futures=True)
        self._workers.executor = self._workers.renew()


class Lanes:
    """A pool of lanes with a queue of jobs.

    Args:
        count: number of lanes.
        timeout_s: longest time that a job may take.
        most_waiting: largest number of jobs in the queue; further jobs are refused.
        rest_s: time after which the process of an idle lane is stopped.
    """

    def __init__(self, count: int, timeout_s: float, most_waiting: int, rest_s: float):
        self._stack = ExitStack()
        self._free = [
            _Lane(self._stack.enter_context(processes(1, timeout_s, all_processors=True))) for _ in range(count)
        ]
        self._all = list(self._free)
        self._most_waiting, self._rest_s = most_waiting, rest_s
        self._waiting: list[tuple[Urgency, int, asyncio.Future[_Lane]]] = []
        self._numbers = itertools.count()
        self._rests: dict[_Lane, asyncio.TimerHandle] = {}

    async def do(self, urgency: Urgency, work: Callable[..., R], *arguments: Any) -> R:
        """Runs a job in a worker process as soon as one is free.

        Raises:
            Busy: the queue is full.
            UnshutterError: the job raised it, or its process died or took too long.
        """
        lane = await self._free_lane(urgency)
        try:
            return await lane.do(work, *arguments)
        finally:
            self._release(lane)

    def close(self) -> None:
        """Kills all worker processes."""
        for lane in self._all:
            lane.end()
        self._stack.close()

    async def _free_lane(self, urgency: Urgency) -> _Lane:
        if len(self._waiting) >= self._most_waiting:
            raise Busy("too many requests at once: try again in a moment")
        turn: asyncio.Future[_Lane] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._waiting, (urgency, next(self._numbers), turn))
        self._assign()
        try:
            return await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():
                self._release(turn.result())
            self._waiting = [entry for entry in self._waiting if entry[2] is not turn]
            heapq.heapify(self._waiting)
            raise

    def _assign(self) -> None:
        while self._waiting and self._free:
            if self._waiting[0][0] is Urgency.LATER and len(self._free) == 1 < len(self._all):
                return
            _, _, turn = heapq.heappop(self._waiting)
            if not turn.done():
                lane = self._free.pop()  # the most recently used, so that the others can stay idle
                if lane in self._rests:
                    self._rests.pop(lane).cancel()
                turn.set_result(lane)

    def _release(self, lane: _Lane) -> None:
        self._free.append(lane)
        self._rests[lane] = asyncio.get_running_loop().call_later(self._rest_s, lane.rest)
        self._assign()
