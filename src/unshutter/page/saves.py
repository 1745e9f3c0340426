"""Background tasks that save photos and clips, one as a file, several as a ZIP file, and the names of these files."""

from __future__ import annotations

import asyncio
import os
import secrets
import shutil
import unicodedata
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Literal, TypeAlias

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.options.clip_options import RectifyClip
from unshutter.options.picture_formats import of_suffix
from unshutter.page.jobs import clip_jobs, photo_jobs
from unshutter.page.opened import ProgressFile, neighbour_names
from unshutter.page.settings import PhotoOptions, refusal
from unshutter.page.store import OpenFile, Refused, ServerState, Urgency
from unshutter.reasons import JsonObject
from unshutter.run.inputs import MOST_BYTES, fitting, picture_name, unchanged_name, usual_format, video_name

Destination: TypeAlias = Literal["file", "zip"]
Item: TypeAlias = tuple[OpenFile, PhotoOptions | RectifyClip]  # an open photo or clip, and its options

_ZIP_NAME = "unshutter.zip"
_MOST_KEPT = 8  # tasks that are running, or whose files can be downloaded
_LOOK_S = 0.25  # interval at which a worker's progress is read
_STANDSTILL_S = 600.0  # a clip without progress for this long is abandoned


@dataclass
class Saving:
    """A task that saves photos and clips."""

    id: str  # identifier used by the page
    to: Destination  # destination; ``file`` is for a single photo or clip
    folder: Path  # temporary folder for the results
    items: list[Item]  # the photos and clips, with the options of each
    only_changed: bool = False  # whether those that are left unchanged are left out
    kept: ExitStack = field(default_factory=ExitStack)  # keeps the files of the items until the task ends
    # reports on the items that are finished: each with the name of its ``result``, or an ``error`` of one line
    done: list[JsonObject] = field(default_factory=list)
    now: OpenFile | None = None  # the clip being processed
    progress: JsonObject | None = None  # progress of that clip, or None if it has not started
    state: str = "working"  # ``working``, ``finished``, ``cancelled``, or ``failed`` with ``error``
    error: str = ""
    task: asyncio.Task[None] | None = None
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def result(self) -> Path | None:
        """The file to download, or None if there is none or it is not ready yet."""
        if self.state != "finished":
            return None
        name = _ZIP_NAME if self.to == "zip" else self.done[0].get("result")
        return self.folder / name if name and (self.folder / name).is_file() else None

    def as_json(self) -> JsonObject:
        """Returns the state and progress."""
        now = None if self.now is None else _named(self.now) | (self.progress or {"what": "waiting"})
        about = {"id": self.id, "to": self.to, "state": self.state, "total": len(self.items), "now": now}
        return about | {"done": self.done} | ({"error": self.error} if self.error else {})

    def forget(self) -> None:
        """Deletes the results."""
        shutil.rmtree(self.folder, ignore_errors=True)

    async def cancel(self) -> None:
        """Stops the task, or deletes its results if it has already ended."""
        if self.task is not None and not self.task.done():
            self.task.cancel()
            await asyncio.wait([self.task])
        else:
            self.forget()

    async def run(self, state: ServerState) -> None:
        """Saves all items, and records the outcome in ``state``."""
        try:
            for open_file, options in self.items:
                self.done.append(_named(open_file) | await self._one(state, open_file, options))
                self.now = self.progress = None
                self._wake()
            self.state = "finished"
        except asyncio.CancelledError:
            self.forget()
            self.state = "cancelled"
        except OSError as error:
            self.state = "failed"
            self.error = f"cannot write the zip file: {error.strerror}"
        finally:
            self.kept.close()
            self._wake()

    async def _one(self, state: ServerState, open_file: OpenFile, options: PhotoOptions | RectifyClip) -> JsonObject:
        try:
            if isinstance(options, RectifyClip):
                target = self._free_name(clip_result(open_file.name))
                options = replace(options, only_changed=self.only_changed or self.to == "file")
                report = await self._clip(state, open_file, target, options)
                may_be_copy = options.may_be_copy and options.steadiness.stabilize is None
                is_unchanged = self.to == "zip" and may_be_copy and not report["rectified"]
                report |= await asyncio.to_thread(self._clip_result, target, open_file if is_unchanged else None)
            else:
                name = open_file.name
                format = options.save.format
                unchanged = None if self.only_changed else self._free_name(unchanged_name(PurePosixPath(name), format))
                places = self._free_name(photo_result(open_file, format)), unchanged
                report = await state.workers.do(Urgency.LATER, photo_jobs.save, open_file, *places, options)
        except UnshutterError as error:
            return refusal(error)
        except OSError as error:
            return {"error": f"cannot write it: {error.strerror}"}
        if self.to == "zip" and "result" in report:
            await asyncio.to_thread(_move_into_zip, self.folder / report["result"], self.folder / _ZIP_NAME)
        return report

    def _clip_result(self, target: Path, unchanged: OpenFile | None) -> dict[str, str]:
        """Replaces the result of an unchanged clip by a copy under its own name; returns the name, if there is one."""
        if not target.exists():
            return {}
        if unchanged is not None:
            target.unlink()
            target = self._free_name(unchanged.name)
            shutil.copyfile(unchanged.path, target)
        return {"result": target.name}

    def _free_name(self, name: str) -> Path:
        return free_name(self.folder, name, [report.get("result", "") for report in self.done])

    async def _clip(self, state: ServerState, open_file: OpenFile, target: Path, options: RectifyClip) -> JsonObject:
        """Saves one clip, updating ``now`` and ``progress``."""
        note = ProgressFile(open_file.path.with_name(f"saving-{self.id}.json"))
        note.file.unlink(missing_ok=True)
        work = state.clip_workers.do(Urgency.LATER, clip_jobs.rectified, open_file, target, options, note)
        job = asyncio.create_task(work)
        clock = asyncio.get_running_loop()
        last_change_s = clock.time()
        try:
            while not (await asyncio.wait([job], timeout=_LOOK_S))[0]:
                progress = note.read()
                if progress != self.progress or self.now is None:
                    self.now, self.progress, last_change_s = open_file, progress, clock.time()
                    self._wake()
                elif progress is not None and clock.time() - last_change_s > _STANDSTILL_S:
                    raise UnshutterError(f"cancelled: no progress for {_STANDSTILL_S:g} s")
            return job.result()
        finally:
            if not job.done():
                job.cancel()
                await asyncio.wait([job])

    def _wake(self) -> None:
        """Notifies everything that waits for ``changed``."""
        self.changed.set()
        self.changed = asyncio.Event()


class SaveTasks:
    """Registry of saving tasks by id: those that are running, and the last few that ended."""

    def __init__(self, state: ServerState):
        self._desk = state
        self._savings: dict[str, Saving] = {}

    def begin(self, to: Destination, items: list[Item], only_changed: bool = False) -> Saving:
        """Starts a new task. The files of its items may be closed at once."""
        self._make_room()
        id = secrets.token_urlsafe(9)
        folder = self._desk.store.folder / f"saving-{id}"
        folder.mkdir()
        saving = self._savings[id] = Saving(id, to, folder, items, only_changed)
        saving.kept.enter_context(self._desk.store.used([file for item in items for file in self._files(item)]))
        saving.task = asyncio.create_task(saving.run(self._desk))
        return saving

    def get(self, id: str) -> Saving:
        """Returns the task with this id."""
        if id not in self._savings:
            raise Refused("this task is unknown: the server may have been restarted", 404)
        return self._savings[id]

    def _files(self, item: Item) -> Iterator[OpenFile]:
        """Yields a photo with its neighbours, or a clip."""
        open_file, options = item
        yield open_file
        if isinstance(options, PhotoOptions):
            yield from (self._desk.store.get(path.parent.name) for path in neighbour_names(options.neighbours))

    def _make_room(self) -> None:
        over = [saving for saving in self._savings.values() if saving.state != "working"]
        for saving in over[: max(len(self._savings) - _MOST_KEPT + 1, 0)]:
            del self._savings[saving.id]
            saving.forget()
        if len(self._savings) >= _MOST_KEPT:
            raise Refused("too many files are being saved at once: wait until one is finished", 503)


def _named(open_file: OpenFile) -> JsonObject:
    return {"photo": open_file.id, "name": open_file.name}


def _move_into_zip(file: Path, packed: Path) -> None:
    with zipfile.ZipFile(packed, "a", zipfile.ZIP_STORED) as stream:  # pictures are already compressed
        stream.write(file, file.name)
    file.unlink()


# ---- names of files -------------------------------------------------------------------------------------------


def photo_result(open_file: OpenFile, format: str | None) -> str:
    """Returns the name of a photo's result, as on the command line: ``street.rectified.jpg``, or of another format."""
    pure = PurePosixPath(open_file.name)
    if of_suffix(pure.suffix) is None and format is None:
        raise UsageError(f"the name '{pure}' has no extension of a picture format: choose a format")
    return picture_name(pure, format or usual_format(open_file.path))


def clip_result(name: str) -> str:
    """Returns the name of a clip's result: ``walk.rectified.mp4``."""
    pure = PurePosixPath(name)
    if pure.suffix.lower() not in VIDEO_FORMATS:
        raise UsageError(f"the name '{name}' has no extension: add one such as .mp4")
    return video_name(pure)


def free_name(folder: Path, name: str, taken: Iterable[str]) -> Path:
    """Returns a path for a result in a folder: ``a.rectified.jpg``, or ``a.rectified-2.jpg`` if the first is taken."""
    most = MOST_BYTES
    with suppress(AttributeError, OSError, ValueError):  # Windows, and file systems that do not report it
        most = min(os.pathconf(folder, "PC_NAME_MAX"), MOST_BYTES)
    occupied = {_comparable(other) for other in taken}
    number = 1
    path = folder / fitting(name, most=most)
    while _comparable(path.name) in occupied:
        number += 1
        path = folder / fitting(name, f"-{number}", most)
    return path


def _comparable(name: str) -> str:
    """Normalises a name, so that names that some file systems treat as identical are equal."""
    return unicodedata.normalize("NFC", name).casefold()
