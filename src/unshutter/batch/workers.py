"""Workers behind a ``concurrent.futures.Executor``: this process or a Dask cluster (processes: processes.py)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from unshutter import installation
from unshutter.errors import UnshutterError


@dataclass
class Workers:
    """An executor and how to use it.

    Attributes:
        executor: runs the jobs.
        at_once: number of jobs to submit before the first has ended, enough to keep all workers busy.
        renew: creates a new executor after a worker's death broke the old one.
        elsewhere: whether a job may run twice because a worker died unnoticed.
        timeout_s: longest duration of a job; None: no limit.
        is_overdue: whether a job whose worker died had used up its time.
    """

    executor: Executor
    at_once: int
    renew: Callable[[], Executor]
    elsewhere: bool = False
    timeout_s: float | None = None
    is_overdue: Callable[[Future[Any]], bool] = lambda _: False


class InThisProcess(Executor):
    """An executor that runs each job immediately when it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Runs the job and returns a completed future."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def this_process() -> Iterator[Workers]:
    """Processes one photo after another in this process; libvips uses all processors for each."""
    yield Workers(InThisProcess(), 1, InThisProcess)


@contextmanager
def _quiet_loggers() -> Iterator[None]:
    """Keeps Dask from printing tracebacks when its scheduler shuts down, which unshutter reports itself."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """Connects to the workers of a Dask scheduler, which need unshutter and the same view of the files.

    Raises:
        UnshutterError: the extra is missing, or the address does not respond.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise UnshutterError(f"--scheduler needs the extra: {installation.extra('dask')} ({error})") from None
    try:
        client = Client(address, timeout=5, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise UnshutterError(f"cannot reach the Dask scheduler {address}: {' '.join(str(error).split())}") from None
    with _quiet_loggers(), client:

        def executor() -> Executor:
            return client.get_executor(pure=False)

        threads: Any = client.nthreads()
        yield Workers(executor(), max(4 * sum(threads.values()), 32), executor, elsewhere=True)
