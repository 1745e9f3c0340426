"""Tasks that save photos and clips to a file, a zip file, or the folder that the page may save to."""

from __future__ import annotations

import asyncio
import secrets
import shutil
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from starlette.requests import Request

from unshutter.errors import UnshutterError
from unshutter.serve.desk import Desk
from unshutter.serve.fields import PhotoOptions
from unshutter.serve.jobs import clip as clip_jobs
from unshutter.serve.jobs import photo as photo_jobs
from unshutter.serve.jobs.cache import Progress, ProgressFile
from unshutter.serve.lanes import Busy, Urgency
from unshutter.serve.names import clip_result, free_name, photo_result
from unshutter.serve.store import Missing, OpenFile
from unshutter.storage.files import remove_leftovers
from unshutter.video.options import RectifyClip

To: TypeAlias = Literal["file", "zip", "folder"]
Item: TypeAlias = tuple[OpenFile, PhotoOptions | RectifyClip]  # an open photo or clip, and its options

_ZIP_NAME = "unshutter.zip"
_MOST_KEPT = 8  # tasks that are running, or whose files can be downloaded
_LOOK_S = 0.25  # interval at which a worker's progress is read
_STANDSTILL_S = 600.0  # a clip without progress for this long is abandoned
_SWEEPS, _SWEEP_S = 40, 0.05  # a killed process releases its files a moment later


@dataclass(frozen=True)
class SavedItem:
    """Outcome of saving one photo or clip.

    Attributes:
        open_file: the photo or clip.
        result: name of the file that was written, or empty if there is none.
        report: the job's report.
        error: one-line reason why nothing was written.
    """

    open_file: OpenFile
    result: str = ""
    report: Mapping[str, Any] = field(default_factory=dict)
    error: str = ""

    def as_json(self) -> dict[str, Any]:
        """Returns a summary for the page and for programs."""
        about = {"error": self.error} if self.error else {"result": self.result, **self.report}
        return {"photo": self.open_file.id, "name": self.open_file.name, **about}


@dataclass
class Saving:
    """A task that saves photos and clips.

    Attributes:
        id: identifier used by the page.
        to: destination; ``file`` is for a single photo or clip.
        folder: output folder; for a zip file, results are first written here.
        items: the photos and clips, with the options of each.
        closing: files to close when the task ends.
        done: the items that are finished, including those that failed.
        now: the clip being processed.
        progress: progress of that clip, or None if it has not started.
        state: ``working``, ``finished``, ``cancelled``, or ``failed`` with ``error``.
    """

    id: str
    to: To
    folder: Path
    items: list[Item]
    closing: Sequence[OpenFile] = ()
    done: list[SavedItem] = field(default_factory=list)
    now: OpenFile | None = None
    progress: Progress | None = None
    state: str = "working"
    error: str = ""
    task: asyncio.Task[None] | None = None
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def result(self) -> Path | None:
        """The file to download, or None if there is none or it is not ready yet."""
        if self.state != "finished" or self.to == "folder":
            return None
        name = _ZIP_NAME if self.to == "zip" else self.done[0].result
        return self.folder / name if name and (self.folder / name).is_file() else None

    def as_json(self) -> dict[str, Any]:
        """Returns the state and progress, for the page and for programs."""
        done, now = [item.as_json() for item in self.done], None
        if self.now is not None:
            progress = asdict(self.progress) if self.progress else {"what": "waiting"}
            now = {"photo": self.now.id, "name": self.now.name, **progress}
        about = {"id": self.id, "to": self.to, "state": self.state, "total": len(self.items), "done": done, "now": now}
        return about | ({"error": self.error} if self.error else {})

    def forget(self) -> None:
        """Deletes the results, unless they are in the user's folder."""
        if self.to != "folder":
            shutil.rmtree(self.folder, ignore_errors=True)

    async def cancel(self) -> None:
        """Stops the task, or deletes its results if it has already ended."""
        if self.task is not None and not self.task.done():
            self.task.cancel()
            await asyncio.wait([self.task])
        else:
            self.forget()

    async def run(self, desk: Desk) -> None:
        """Saves all items, and records the outcome in ``state``."""
        try:
            for open_file, options in self.items:
                self.done.append(await self._one(desk, open_file, options))
                self.now = self.progress = None
                self._wake()
            self.state = "finished"
        except asyncio.CancelledError:
            await _swept(self.folder)
            self.forget()
            self.state = "cancelled"
        except OSError as error:
            self.state, self.error = "failed", f"cannot write the zip file: {error.strerror}"
        finally:
            for each in self.closing:
                desk.store.remove(each)
            self._wake()

    async def _one(self, desk: Desk, open_file: OpenFile, options: PhotoOptions | RectifyClip) -> SavedItem:
        try:
            if isinstance(options, RectifyClip):
                target = self._free_name(clip_result(open_file.name))
                report = await self._clip(desk, open_file, target, options)
            else:
                target = self._free_name(photo_result(open_file.name, options.save.format))
                job = open_file, target, options.rectify, options.hand
                report = await desk.lanes.do(Urgency.LATER, photo_jobs.saved, *job)
        except UnshutterError as error:
            return SavedItem(open_file, error=str(error))
        except OSError as error:
            return SavedItem(open_file, error=f"cannot write it: {error.strerror}")
        if self.to == "zip":
            await asyncio.to_thread(_move_into_zip, target, self.folder / _ZIP_NAME)
        return SavedItem(open_file, target.name, report)

    def _free_name(self, name: str) -> Path:
        return free_name(self.folder, name, self.folder / _ZIP_NAME if self.to == "zip" else None)

    async def _clip(self, desk: Desk, open_file: OpenFile, target: Path, options: RectifyClip) -> dict[str, Any]:
        """Saves one clip, updating ``now`` and ``progress``."""
        note = ProgressFile(open_file.path.with_name(f"saving-{self.id}.json"))
        note.file.unlink(missing_ok=True)
        work = desk.long_lanes.do(Urgency.LATER, clip_jobs.rectified, open_file, target, options, note)
        job, clock = asyncio.create_task(work), asyncio.get_running_loop()
        last_change_s = clock.time()
        try:
            while not (await asyncio.wait([job], timeout=_LOOK_S))[0]:
                progress = note.read()
                if progress != self.progress or self.now is None:
                    self.now, self.progress, last_change_s = open_file, progress, clock.time()
                    self._wake()
                elif progress is not None and clock.time() - last_change_s > _STANDSTILL_S:
                    raise UnshutterError(f"given up: nothing was done for {_STANDSTILL_S:g} s")
            return job.result()
        finally:
            if not job.done():
                job.cancel()
                await asyncio.wait([job])
                await _swept(self.folder)

    def _wake(self) -> None:
        """Notifies everything that waits for ``changed``."""
        self.changed.set()
        self.changed = asyncio.Event()


class Savings:
    """Registry of saving tasks by id: those that are running, and the last few that ended.

    Args:
        desk: the server's shared state.
    """

    def __init__(self, desk: Desk):
        self._desk = desk
        self._savings: dict[str, Saving] = {}

    def begin(self, to: To, items: list[Item], closing: Sequence[OpenFile] = ()) -> Saving:
        """Starts a new task.

        Args:
            to: destination of the results.
            items: the photos and clips, with the options of each.
            closing: files to close when the task ends.

        Raises:
            Busy: too many tasks are running.
        """
        self._make_room()
        id, folder = secrets.token_urlsafe(9), self._desk.settings.folder
        if to != "folder" or folder is None:
            folder = self._desk.store.folder / f"saving-{id}"
            folder.mkdir()
        saving = self._savings[id] = Saving(id, to, folder, items, closing)
        saving.task = asyncio.create_task(saving.run(self._desk))
        return saving

    def get(self, id: str) -> Saving:
        """Returns the task with this id.

        Raises:
            Missing: the id is unknown or its task has been discarded.
        """
        if id not in self._savings:
            raise Missing("this saving is not known: the server may have been restarted")
        return self._savings[id]

    def _make_room(self) -> None:
        over = [saving for saving in self._savings.values() if saving.state != "working"]
        for saving in over[: max(len(self._savings) - _MOST_KEPT + 1, 0)]:
            del self._savings[saving.id]
            saving.forget()
        if len(self._savings) >= _MOST_KEPT:
            raise Busy("too many files are being saved at once: wait for one of these to end")


def savings_of(request: Request) -> Savings:
    """Returns the server's registry of saving tasks."""
    return request.app.state.savings


async def _swept(folder: Path) -> None:
    """Deletes the partial output of a killed process as soon as the process has released it."""
    for _ in range(_SWEEPS):
        remove_leftovers(folder)
        with suppress(OSError):
            if not any(folder.glob(".unshutter-*.part*")):
                return
        await asyncio.sleep(_SWEEP_S)


def _move_into_zip(file: Path, packed: Path) -> None:
    with zipfile.ZipFile(packed, "a", zipfile.ZIP_STORED) as stream:  # pictures are already compressed
        stream.write(file, file.name)
    file.unlink()
