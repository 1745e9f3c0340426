"""The server's state: open photos and clips in a temporary folder, worker processes, and settings.

Worker processes isolate the server from crashes in decoders. A lane is a worker process that runs one job at a time, so
that a crash can be traced to its job. Jobs queue for a lane in order of urgency; the last free lane is reserved for
jobs whose result a user is waiting to see.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import os
import re
import secrets
import shutil
import signal
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import AsyncIterator, Callable, Collection, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path, PurePosixPath
from typing import TypeVar

from unshutter import version
from unshutter.errors import UnshutterError, UsageError
from unshutter.options.picture_formats import of_suffix
from unshutter.page.jobs import photo_jobs
from unshutter.page.opened import Kind, OpenFile
from unshutter.page.settings import Settings
from unshutter.run.workers import Workers, processes
from unshutter.storage.files import lock

R = TypeVar("R")

_PREFIX = "unshutter-serve-"
_LOCK = "lock"
_VIDEO = re.compile(r"\.[a-z0-9]{2,5}")  # plausible suffix of a clip

_UNUSUAL = re.compile(r'[\x00-\x1f\x7f-\x9f<>:"|?*\u200e\u200f\u202a-\u202e\u2066-\u2069]')


class Refused(UnshutterError):
    """The server cannot do what is asked; ``status`` is that of the response."""

    def __init__(self, message: str, status: int):
        super().__init__(message, status)
        self.status = status


@dataclass
class ServerState:
    """The server's shared state."""

    settings: Settings  # the user's settings
    store: Store  # the open photos and clips
    workers: WorkerPool  # workers for photos and for single moments of clips
    clip_workers: WorkerPool  # worker for whole clips, one at a time, using all processors

    @classmethod
    def open(cls, settings: Settings, folder: Path) -> ServerState:
        """Creates the state with no open files; ``folder`` is where they will be stored."""
        most_bytes = 10 * max(settings.max_bytes, settings.max_clip_bytes)
        store = Store(folder, most_files=1000, most_bytes=most_bytes, max_pixels=settings.max_pixels)
        workers = WorkerPool(min(max(os.cpu_count() or 1, 2), 4), timeout_s=600, most_waiting=48, rest_s=120)
        return cls(settings, store, workers, WorkerPool(1, timeout_s=86_400, most_waiting=8, rest_s=5))

    def close(self) -> None:
        """Stops all workers."""
        self.workers.close()
        self.clip_workers.close()

    def photo_path(self, id: str) -> Path:
        """Returns the path of the open photo with this id."""
        open_file = self.store.get(id)
        if open_file.kind != "photo":
            raise UsageError(f"{open_file.name} is a clip: the frame before or after a photo must be a photo")
        return open_file.path


@dataclass
class Store:
    """Storage of all open photos and clips."""

    folder: Path  # folder of the files
    most_files: int  # largest number of open files
    most_bytes: int  # largest total size of open files
    max_pixels: int  # largest photo allowed [px]
    _open: dict[str, OpenFile] = field(default_factory=dict)
    _sizes: dict[str, int] = field(default_factory=dict)
    _used: Counter[str] = field(default_factory=Counter)

    async def add(self, name: str, data: AsyncIterator[bytes], kind: Kind = "photo", size: int = 0) -> OpenFile:
        """Stores an uploaded file, piece by piece; its size [bytes] is 0 if not known in advance."""
        if len(self._sizes) >= self.most_files:
            raise Refused(f"{self.most_files} files are open already: close some of them", 413)
        if size > shutil.disk_usage(self.folder).free:
            line = f"no disc space is left in {self.folder.parent}: set TMPDIR to a folder on a larger disc"
            raise Refused(line, 413)
        id = secrets.token_urlsafe(9)
        name = clean_name(name, kind)
        suffix = PurePosixPath(name).suffix.lower()
        is_known = _VIDEO.fullmatch(suffix) if kind == "clip" else of_suffix(suffix)
        open_file = OpenFile(id, kind, name, self.folder / id / f"{kind}{suffix if is_known else ''}", self.max_pixels)
        self._sizes[id] = 0
        try:
            open_file.path.parent.mkdir()
            with open_file.path.open("xb") as file:
                async for piece in data:
                    file.write(piece)
                    self._sizes[id] += len(piece)
                    if sum(self._sizes.values()) > self.most_bytes:
                        line = f"the open files have more than {self.most_bytes / 1e6:g} MB: close some of them"
                        raise Refused(line, 413)
            if not self._sizes[id]:
                raise UnshutterError(f"{name} is empty (0 bytes)")
        except OSError as error:
            self.remove(open_file)
            raise UnshutterError(f"cannot keep the {kind}: {error.strerror}") from None
        except BaseException:
            self.remove(open_file)
            raise
        self._open[id] = open_file
        return open_file

    def get(self, id: str) -> OpenFile:
        """Returns the photo or clip with this id."""
        if id not in self._open:
            raise Refused("this file is no longer open: drop it on the page again", 404)
        return self._open[id]

    def remove(self, open_file: OpenFile) -> None:
        """Closes a file, and deletes it along with its cache; one that is in use, when that ends."""
        self._open.pop(open_file.id, None)
        if not self._used[open_file.id]:
            self._sizes.pop(open_file.id, None)
            shutil.rmtree(open_file.path.parent, ignore_errors=True)

    @contextmanager
    def used(self, files: Collection[OpenFile]) -> Iterator[None]:
        """Keeps files until the block ends, even if they are closed earlier."""
        self._used.update(each.id for each in files)
        try:
            yield
        finally:
            self._used.subtract(each.id for each in files)
            for each in files:
                if each.id not in self._open:
                    self.remove(each)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Creates a private temporary folder, after deleting those left behind by killed processes."""
    _remove_leftovers()
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        lock(descriptor)
        yield folder
    finally:
        os.close(descriptor)
        shutil.rmtree(folder, ignore_errors=True)


def _remove_leftovers() -> None:
    """Deletes temporary folders of this user's processes that have ended."""
    if sys.platform == "win32":  # which removes no folder of open files
        return
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if folder.is_symlink() or folder.stat().st_uid != os.getuid():
                continue
            with (folder / _LOCK).open("rb") as file:
                if lock(file.fileno()):  # otherwise the owning process is running
                    shutil.rmtree(folder, ignore_errors=True)


def clean_name(name: str, otherwise: str = "photo") -> str:
    """Returns the last component of a file name, without path separators or characters that are not text, shortened."""
    last = re.split(r"[/\\]", name)[-1]
    last = _UNUSUAL.sub("", last.encode("utf-8", "ignore").decode()).strip()
    stem, _, suffix = last.rpartition(".")
    if not suffix or len(suffix) > 10 or last == suffix:
        stem = last
        suffix = ""
    stem = stem.lstrip(".")[: 120 - len(suffix)].strip() or otherwise
    return f"{stem}.{suffix}" if suffix else stem


# ---- worker processes --------------------------------------------------------------------------------------------


def _stamp() -> tuple[int, int] | None:
    """Returns what changes when the program is updated or removed."""
    with suppress(OSError):
        status = os.stat(version.__file__)
        return status.st_ino, status.st_mtime_ns
    return None


_STAMP = _stamp()


class Urgency(IntEnum):
    """Priority of a job in the queue."""

    NOW = 0  # a user is waiting at the screen
    LATER = 1


class _Worker:
    """A worker process, started on demand and stopped when idle for a while."""

    def __init__(self, workers: Workers):
        self._workers = workers
        self._pid: int | None = None
        self._endings: list[threading.Thread] = []

    async def do(self, work: Callable[..., R], *arguments: object) -> R:
        """Runs a job in the worker process."""
        future = None
        try:
            if self._pid is None:
                if _stamp() != _STAMP:  # the process would run another version
                    raise UnshutterError(
                        "unshutter was updated while the page ran: stop it with Ctrl-C, start it again"
                    )
                self._pid = await asyncio.wrap_future(self._workers.executor.submit(photo_jobs.warm))
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

    def end(self) -> None:
        """Kills the process, even during a job; the next job starts a new one."""
        pid = self._pid
        self._pid = None
        if pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))
        ending = threading.Thread(target=self._workers.executor.shutdown, kwargs={"cancel_futures": True}, daemon=True)
        ending.start()  # it waits, so that Python 3.13 does not find a pool half closed when it exits
        self._endings = [*(each for each in self._endings if each.is_alive()), ending]
        self._workers.executor = self._workers.renew()

    def close(self) -> None:
        """Kills the process and waits for the end of all that were started."""
        self.end()
        for each in self._endings:
            each.join()


class WorkerPool:
    """A pool of lanes with a queue of jobs, which takes ``most_waiting``; idle lanes are stopped after ``rest_s``."""

    def __init__(self, count: int, timeout_s: float, most_waiting: int, rest_s: float):
        self._stack = ExitStack()
        self._free = [
            _Worker(self._stack.enter_context(processes(1, timeout_s, all_processors=True))) for _ in range(count)
        ]
        self._all = list(self._free)
        self._most_waiting = most_waiting
        self._rest_s = rest_s
        self._waiting: list[tuple[Urgency, int, asyncio.Future[_Worker]]] = []
        self._numbers = itertools.count()
        self._rests: dict[_Worker, asyncio.TimerHandle] = {}

    async def do(self, urgency: Urgency, work: Callable[..., R], *arguments: object) -> R:
        """Runs a job in a worker process as soon as one is free."""
        lane = await self._free_lane(urgency)
        try:
            return await lane.do(work, *arguments)
        finally:
            self._release(lane)

    def close(self) -> None:
        """Kills all worker processes."""
        for lane in self._all:
            lane.close()
        self._stack.close()

    async def _free_lane(self, urgency: Urgency) -> _Worker:
        if len(self._waiting) >= self._most_waiting:
            raise Refused("too many requests at once: try again in a moment", 503)
        rotation: asyncio.Future[_Worker] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._waiting, (urgency, next(self._numbers), rotation))
        self._assign()
        try:
            return await rotation
        except asyncio.CancelledError:
            if rotation.done() and not rotation.cancelled():
                self._release(rotation.result())
            self._waiting = [entry for entry in self._waiting if entry[2] is not rotation]
            heapq.heapify(self._waiting)
            raise

    def _assign(self) -> None:
        while self._waiting and self._free:
            if self._waiting[0][0] is Urgency.LATER and len(self._free) == 1 < len(self._all):
                return
            _, _, rotation = heapq.heappop(self._waiting)
            if not rotation.done():
                lane = self._free.pop()  # the most recently used, so that the others can stay idle
                if lane in self._rests:
                    self._rests.pop(lane).cancel()
                rotation.set_result(lane)

    def _release(self, lane: _Worker) -> None:
        self._free.append(lane)
        self._rests[lane] = asyncio.get_running_loop().call_later(self._rest_s, lane.end)
        self._assign()
