"""Threads that work ahead end before what they read is closed, whenever they are interrupted."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event, Thread, Timer

import pytest

from unshutter.video.file import ahead as module
from unshutter.video.file.ahead import ahead


def test_a_thread_whose_start_is_interrupted_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go_on, closed = Event(), Event(), []

    def items() -> Iterator[int]:
        try:
            begun.set()
            go_on.wait()
            yield 1
        finally:
            closed.append(True)

    class Interrupted(ThreadPoolExecutor):
        """As when a signal comes once a thread runs, but before the pool knows it."""

        def submit(self, function: Callable, /, *args: object, **kwargs: object) -> Future:
            if begun.is_set():
                return super().submit(function, *args, **kwargs)
            Thread(target=function, args=args).start()
            begun.wait()
            Timer(0.2, go_on.set).start()
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "ThreadPoolExecutor", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        next(ahead(items(), 1))
    assert closed
