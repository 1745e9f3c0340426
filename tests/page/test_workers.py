"""Processes that may die, and who waits for them."""

import asyncio
import os
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from unshutter.errors import UnshutterError
from unshutter.page import store as module
from unshutter.page.store import Refused, Urgency, WorkerPool

NOW, LATER = Urgency.NOW, Urgency.LATER


@pytest.fixture(autouse=True)
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.photo_jobs, "warm", os.getpid)  # nothing to load


def _with_lanes(test: Callable[[WorkerPool], Awaitable[Any]], **how: Any) -> Any:
    made = WorkerPool(**({"count": 2, "timeout_s": 30, "most_waiting": 10, "rest_s": 60} | how))

    async def run() -> Any:
        return await asyncio.wait_for(test(made), 30)

    try:
        return asyncio.run(run())
    finally:
        made.close()


async def _ended(pid: int) -> None:
    """Waits until a process is gone."""
    with pytest.raises(ProcessLookupError):
        while True:
            os.kill(pid, 0)
            await asyncio.sleep(0.02)


def test_the_process_that_died_is_replaced_and_the_other_goes_on() -> None:
    async def test(lanes: WorkerPool) -> None:
        other = asyncio.create_task(lanes.do(NOW, time.sleep, 1.0))
        with pytest.raises(UnshutterError, match="its worker died"):
            await lanes.do(NOW, os.abort)
        with pytest.raises(ZeroDivisionError):  # what a job raises comes back
            await lanes.do(NOW, divmod, 1, 0)
        assert await other is None

    _with_lanes(test)


def test_a_job_that_takes_too_long_is_given_up() -> None:
    async def test(lanes: WorkerPool) -> None:
        with pytest.raises(UnshutterError, match=r"given up after 0\.3 s"):
            await lanes.do(NOW, time.sleep, 20)
        assert await lanes.do(NOW, abs, -3) == 3

    _with_lanes(test, timeout_s=0.3)


def test_no_process_of_another_version_is_started(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    async def test(lanes: WorkerPool) -> None:
        assert await lanes.do(NOW, abs, -3) == 3
        monkeypatch.setattr("unshutter.version.__file__", str(tmp_path / "gone.py"))
        assert await lanes.do(NOW, abs, -3) == 3  # by the process that is there
        with pytest.raises(UnshutterError, match="was updated while the page ran"):
            await asyncio.gather(*(lanes.do(NOW, time.sleep, 0.3) for _ in range(2)))

    _with_lanes(test)


def test_a_cancelled_job_is_ended_and_who_looks_at_the_screen_comes_first() -> None:
    async def test(lanes: WorkerPool) -> list[str]:
        pid = await lanes.do(NOW, os.getpid)
        job = asyncio.create_task(lanes.do(NOW, time.sleep, 20))
        await asyncio.sleep(0.2)
        job.cancel()
        await asyncio.wait([job])
        assert job.cancelled()
        await _ended(pid)
        done: list[str] = []

        async def one(name: str, urgency: Urgency) -> None:
            await lanes.do(urgency, time.sleep, 0.05)
            done.append(name)

        first = [asyncio.create_task(one(f"later {k}", LATER)) for k in range(3)]
        await asyncio.sleep(0)
        await asyncio.gather(asyncio.create_task(one("now", NOW)), *first)
        return done

    assert _with_lanes(test, count=1)[:2] == ["later 0", "now"]


def test_no_more_wait_than_may() -> None:
    async def test(lanes: WorkerPool) -> None:
        jobs = [asyncio.create_task(lanes.do(NOW, time.sleep, 0.5)) for _ in range(3)]
        await asyncio.sleep(0)
        with pytest.raises(Refused):
            await lanes.do(NOW, abs, -3)
        await asyncio.gather(*jobs)
        assert await lanes.do(NOW, abs, -3) == 3

    _with_lanes(test, count=1, most_waiting=2)


def test_a_lane_is_kept_free_for_them() -> None:
    async def test(lanes: WorkerPool) -> float:
        await asyncio.gather(lanes.do(NOW, time.sleep, 0.1), lanes.do(NOW, time.sleep, 0.1))  # both are there
        later = [asyncio.create_task(lanes.do(LATER, time.sleep, 20)) for _ in range(2)]
        await asyncio.sleep(0.1)
        began = time.monotonic()
        await lanes.do(NOW, abs, -3)
        took = time.monotonic() - began
        for job in later:
            job.cancel()
        await asyncio.wait(later)
        return took

    assert _with_lanes(test) < 15


def test_a_lane_without_work_gives_its_memory_back() -> None:
    async def test(lanes: WorkerPool) -> None:
        pid = await lanes.do(NOW, os.getpid)
        await _ended(pid)
        assert await lanes.do(NOW, os.getpid) != pid

    _with_lanes(test, rest_s=0.2)
