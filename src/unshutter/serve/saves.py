"""Photos and clips on their way into a file, a zip file, or the folder that the page was given."""

from __future__ import annotations

import asyncio
import shutil
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from unshutter.errors import UnshutterError
from unshutter.serve import clip_work, work
from unshutter.serve.clip_work import HowFar
from unshutter.serve.desk import Desk
from unshutter.serve.direct import outcome_told, raise_if_failed
from unshutter.serve.fields import Wanted
from unshutter.serve.lanes import Urgency
from unshutter.serve.names import clip_result, free_name, photo_result
from unshutter.serve.store import Stored
from unshutter.storage.files import remove_leftovers
from unshutter.video.options import RectifyClip

To: TypeAlias = Literal["file", "zip", "folder"]

_ZIP_NAME = "unshutter.zip"
_LOOK_S = 0.25  # how often a lane's notes are read
_STANDSTILL_S = 600.0  # a clip whose notes do not change for so long is given up
_SWEEPS, _SWEEP_S = 40, 0.05  # a process that was ended lets go of its files a moment later


@dataclass
class Saving:
    """Photos and clips on their way.

    Attributes:
        id: by which the page calls it.
        to: what they go into; ``file``: the one photo or clip as it is.
        folder: where the results go; for a zip file, before they are in it.
        items: with what is wanted of each.
        closing: files that are closed when it is over.
        done: a line's worth of facts for each item that is finished, failed ones with ``error``.
        now: how far the clip is that is at work.
        state: ``working``, ``finished``, ``cancelled``, or ``failed`` with ``error``.
    """

    id: str
    to: To
    folder: Path
    items: list[tuple[Stored, Wanted | RectifyClip]]
    closing: Sequence[Stored] = ()
    done: list[dict[str, Any]] = field(default_factory=list)
    now: dict[str, Any] | None = None
    state: str = "working"
    error: str = ""
    task: asyncio.Task[None] | None = None
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def result(self) -> Path | None:
        """The file to download; None: there is none, or not yet."""
        if self.state != "finished" or self.to == "folder":
            return None
        name = _ZIP_NAME if self.to == "zip" else self.done[0].get("result", "")
        return self.folder / name if name and (self.folder / name).is_file() else None

    def told(self) -> dict[str, Any]:
        """How far it is, as the page is told."""
        told = {"id": self.id, "to": self.to, "state": self.state, "total": len(self.items), "done": self.done}
        return {**told, "now": self.now, **({"error": self.error} if self.error else {})}

    def forget(self) -> None:
        """Removes what was made, unless that is in the user's folder."""
        if self.to != "folder":
            shutil.rmtree(self.folder, ignore_errors=True)

    async def run(self, desk: Desk) -> None:
        """Saves all; ends in a state that tells how it went."""
        try:
            for stored, wanted in self.items:
                self.done.append(await self._one(desk, stored, wanted))
                self.now = None
                self._tell()
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
            self._tell()

    async def _one(self, desk: Desk, stored: Stored, wanted: Wanted | RectifyClip) -> dict[str, Any]:
        facts: dict[str, Any] = {"photo": stored.id, "name": stored.name}
        try:
            if isinstance(wanted, RectifyClip):
                target = self._free_name(clip_result(stored.name))
                told = await self._clip(desk, stored, target, wanted)
            else:
                target = self._free_name(photo_result(stored.name, wanted.save.format))
                outcome = await desk.lanes.do(Urgency.LATER, work.saved, desk.held(stored), target, wanted.rectify)
                raise_if_failed(outcome, stored)
                told = outcome_told(outcome)
        except UnshutterError as error:
            return {**facts, "error": str(error)}
        except OSError as error:
            return {**facts, "error": f"cannot write it: {error.strerror}"}
        if self.to == "zip":
            await asyncio.to_thread(_move_into_zip, target, self.folder / _ZIP_NAME)
        return {**facts, "result": target.name, **told}

    def _free_name(self, name: str) -> Path:
        return free_name(self.folder, name, self.folder / _ZIP_NAME if self.to == "zip" else None)

    async def _clip(self, desk: Desk, stored: Stored, target: Path, wanted: RectifyClip) -> dict[str, Any]:
        """Makes one clip, and tells how far it is meanwhile."""
        notes = HowFar(stored.path.with_name(f"saving-{self.id}.json"))
        notes.file.unlink(missing_ok=True)
        given = desk.held(stored), target, wanted, notes
        job = asyncio.create_task(desk.long_lanes.do(Urgency.LATER, clip_work.rectified, *given))
        clock = asyncio.get_running_loop()
        last, since = None, clock.time()
        try:
            while not (await asyncio.wait([job], timeout=_LOOK_S))[0]:
                note = notes.read()
                if note != last or self.now is None:
                    last, since = note, clock.time()
                    self.now = {"photo": stored.id, "name": stored.name, **(note or {"what": "waiting"})}
                    self._tell()
                elif note is not None and clock.time() - since > _STANDSTILL_S:
                    raise UnshutterError(f"given up: nothing was done for {_STANDSTILL_S:g} s")
            return job.result()
        finally:
            if not job.done():
                job.cancel()
                await asyncio.wait([job])
                await _swept(self.folder)

    def _tell(self) -> None:
        self.changed.set()
        self.changed = asyncio.Event()


async def _swept(folder: Path) -> None:
    """Removes what a process that was ended has left half written, as soon as it has let go of it."""
    for _ in range(_SWEEPS):
        remove_leftovers(folder)
        with suppress(OSError):
            if not any(folder.glob(".unshutter-*.part*")):
                return
        await asyncio.sleep(_SWEEP_S)


def _move_into_zip(file: Path, packed: Path) -> None:
    with zipfile.ZipFile(packed, "a", zipfile.ZIP_STORED) as stream:  # pictures do not get smaller
        stream.write(file, file.name)
    file.unlink()
