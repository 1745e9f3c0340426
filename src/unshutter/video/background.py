"""Steps of a pipeline that run beside each other: each is an iterator, worked on ahead of the one that asks for it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from queue import Empty, Full, Queue
from typing import Any, TypeVar

_T = TypeVar("_T")
_U = TypeVar("_U")
_END = object()
_ASK_S = 0.1  # how often a step that waits looks whether it is still wanted


def ahead(items: Iterable[_T], most: int) -> Generator[_T]:
    """The items, worked out by a thread of their own up to so many ahead; errors come out here.

    When the iterator is closed, the thread ends after the item it is at, and closes its own source.
    """
    waiting: Queue[Any] = Queue(most)
    unwanted = threading.Event()
    thread = threading.Thread(target=_work, args=(iter(items), waiting, unwanted), daemon=True)
    thread.start()
    try:
        while True:
            item, error = waiting.get()
            if error is not None:
                raise error
            if item is _END:
                return
            yield item
    finally:
        unwanted.set()
        while thread.is_alive():
            with suppress(Empty):
                waiting.get_nowait()
            thread.join(_ASK_S)


def _work(source: Iterator[Any], waiting: Queue[Any], unwanted: threading.Event) -> None:
    """Puts items into a queue, then the end or the error that ended them."""

    def put(item: Any, error: BaseException | None) -> bool:
        while not unwanted.is_set():
            with suppress(Full):
                waiting.put((item, error), timeout=_ASK_S)
                return True
        return False

    try:
        for item in source:
            if not put(item, None):
                break
        put(_END, None)
    except BaseException as error:  # whatever it is, the one who asks has to know
        put(_END, error)
    finally:
        if isinstance(source, Generator):
            source.close()


def side_by_side(function: Callable[[_T], _U], items: Iterable[_T], threads: int) -> Generator[_U]:
    """``function`` of each item, in order, several at a time."""
    running: deque[Future[_U]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for item in items:
                running.append(pool.submit(function, item))
                if len(running) > threads:
                    yield running.popleft().result()
            while running:
                yield running.popleft().result()
        finally:
            for left in running:
                left.cancel()
