"""Who does the work, a ``concurrent.futures.Executor``: this process, or a Dask cluster (or processes.py)."""

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
        executor: that jobs are given to.
        at_once: jobs that it is given before the first has ended: enough that nobody waits.
        renew: gives a new executor after a worker died and took the old one with it.
        elsewhere: whether jobs may be done twice, when a worker dies that nobody has heard from.
        timeout_s: longest time of a job; None: no limit.
        is_overdue: whether a job whose worker died had been given all its time.
    """

    executor: Executor
    at_once: int
    renew: Callable[[], Executor]
    elsewhere: bool = False
    timeout_s: float | None = None
    is_overdue: Callable[[Future[Any]], bool] = lambda _: False


class InThisProcess(Executor):
    """Does each job when it is given, before anything else."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The future is there when the job is done."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def this_process() -> Iterator[Workers]:
    """One photo after the other; libvips works on each with all processors."""
    yield Workers(InThisProcess(), 1, InThisProcess)


@contextmanager
def _quiet_loggers() -> Iterator[None]:
    """Keeps Dask from writing tracebacks to the terminal when its scheduler goes: a line of ours reports it."""
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
    """The workers of a Dask scheduler, which need unshutter and the same view of the files.

    Raises:
        UnshutterError: the extra is missing, or nobody answers at the address.
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
