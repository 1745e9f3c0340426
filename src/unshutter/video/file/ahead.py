"""Steps of a clip that run ahead of the next, in threads of their own."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from threading import Lock
from typing import TypeVar

_T = TypeVar("_T")


def ahead(items: Iterable[_T], most: int) -> Generator[_T]:
    """Yields the items, computed by a separate thread up to ``most`` ahead (0: by none); re-raises its errors.

    When the iterator is closed, the thread ends after its current item and closes its own source.
    """
    if most == 0:
        yield from items
        return
    source = iter(items)
    waiting = deque[Future[list[_T]]]()
    one_at_a_time = Lock()  # a pool does not know a thread whose start was interrupted, and would not wait for it

    def take_next() -> list[_T]:
        """Takes the next item, in a list that is empty at the end."""
        with one_at_a_time:
            return list(islice(source, 1))

    def close() -> None:
        with one_at_a_time:
            if isinstance(source, Generator):
                source.close()

    with ThreadPoolExecutor(1) as thread:
        try:
            waiting.extend(thread.submit(take_next) for _ in range(most))
            while item := waiting.popleft().result():
                waiting.append(thread.submit(take_next))
                yield item[0]
        finally:
            for future in waiting:
                future.cancel()
            thread.submit(close)
