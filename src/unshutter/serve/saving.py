"""Many photos saved: into one zip file to download, or into the folder that the page was given."""

from __future__ import annotations

import asyncio
import json
import secrets
import shutil
import zipfile
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse

from unshutter.errors import UnshutterError, UsageError
from unshutter.serve import work
from unshutter.serve.answers import told_header
from unshutter.serve.desk import Desk, desk_of
from unshutter.serve.direct import outcome_told, raise_if_failed, result_name
from unshutter.serve.fields import Wanted, read
from unshutter.serve.lanes import Busy, Urgency
from unshutter.serve.store import Full, Missing, Stored
from unshutter.storage.files import remove_leftovers

_MOST_KEPT = 8  # savings whose zip files lie ready, or that are at work
_MOST_REQUEST = 2_000_000  # bytes
_ALIVE_S = 15.0  # between signs of life to the page
_ZIP_NAME = "unshutter.zip"


@dataclass
class Saving:
    """Photos on their way into a zip file or folder.

    Attributes:
        id: by which the page calls it.
        to: ``zip`` or ``folder``.
        folder: where the results go; for a zip file, before they are in it.
        photos: with what is wanted of each.
        done: a line's worth of facts for each photo that is finished, failed ones with ``error``.
        state: ``working``, ``finished``, ``cancelled``, or ``failed`` with ``error``.
    """

    id: str
    to: Literal["zip", "folder"]
    folder: Path
    photos: list[tuple[Stored, Wanted]]
    done: list[dict[str, Any]] = field(default_factory=list)
    state: str = "working"
    error: str = ""
    task: asyncio.Task[None] | None = None
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def zip(self) -> Path:
        """The zip file."""
        return self.folder / _ZIP_NAME

    def told(self) -> dict[str, Any]:
        """How far it is, as the page is told."""
        told = {"id": self.id, "to": self.to, "state": self.state, "total": len(self.photos), "done": self.done}
        return {**told, "error": self.error} if self.error else told

    async def run(self, desk: Desk) -> None:
        """Saves all; ends in a state that tells how it went."""
        try:
            for stored, wanted in self.photos:
                self.done.append(await self._one(desk, stored, wanted))
                self._tell()
            self.state = "finished"
        except asyncio.CancelledError:
            self.state = "cancelled"
            remove_leftovers(self.folder)  # of the process that was ended
            if self.to == "zip":
                shutil.rmtree(self.folder, ignore_errors=True)
        except OSError as error:
            self.state, self.error = "failed", f"cannot write the zip file: {error.strerror}"
        finally:
            self._tell()

    async def _one(self, desk: Desk, stored: Stored, wanted: Wanted) -> dict[str, Any]:
        facts: dict[str, Any] = {"photo": stored.id, "name": stored.name}
        try:
            target = free_name(self.folder, result_name(stored, wanted.save.format))
            outcome = await desk.lanes.do(Urgency.LATER, work.saved, desk.held(stored), target, wanted.rectify)
            raise_if_failed(outcome, stored)
        except UnshutterError as error:
            return {**facts, "error": str(error)}
        if self.to == "zip":
            await asyncio.to_thread(_move_into_zip, target, self.zip)
        return {**facts, "result": target.name, **outcome_told(outcome)}

    def _tell(self) -> None:
        self.changed.set()
        self.changed = asyncio.Event()


async def start(request: Request) -> Response:
    """``POST /api/saves``: photos with their options -> the id of the saving."""
    desk = desk_of(request)
    to, photos = _parsed(desk, await _body(request))
    savings = _savings(request)
    _make_room(savings)
    id = secrets.token_urlsafe(9)
    folder = desk.settings.folder
    if to == "zip" or folder is None:
        folder = desk.store.folder / f"saving-{id}"
        folder.mkdir()
    saving = savings[id] = Saving(id, to, folder, photos)
    saving.task = asyncio.create_task(saving.run(desk))
    return JSONResponse(saving.told(), 202)


async def events(request: Request) -> Response:
    """``GET /api/saves/{id}/events``: how far it is, as server-sent events, until its end."""
    saving = _saving(request)

    async def lines() -> AsyncIterator[str]:
        while True:
            changed = saving.changed
            yield f"data: {json.dumps(saving.told())}\n\n"
            while saving.state == "working" and not changed.is_set():
                try:
                    await asyncio.wait_for(changed.wait(), _ALIVE_S)
                except TimeoutError:
                    yield ": still at work\n\n"
            if saving.state != "working" and not changed.is_set():
                return

    return StreamingResponse(lines(), media_type="text/event-stream")


async def cancel(request: Request) -> Response:
    """``DELETE /api/saves/{id}``: stops it; what is in a folder stays there."""
    saving = _saving(request)
    if saving.task is not None and not saving.task.done():
        saving.task.cancel()
        await asyncio.wait([saving.task])
    return JSONResponse(saving.told())


async def download(request: Request) -> Response:
    """``GET /api/saves/{id}/zip``: the zip file."""
    saving = _saving(request)
    if saving.to != "zip" or saving.state != "finished" or not saving.zip.exists():
        raise Missing("there is no such zip file, or not yet")
    return FileResponse(saving.zip, filename=_ZIP_NAME, headers={"unshutter-name": told_header(_ZIP_NAME)})


def free_name(folder: Path, name: str) -> Path:
    """A place for a result in a folder where nothing is in its way: ``a.rectified.jpg``, else ``a.rectified-2.jpg``."""
    pure = PurePosixPath(name)
    number, path = 1, folder / name
    taken = _names_in(folder / _ZIP_NAME)
    while path.name in taken or path.exists() or path.is_symlink():
        number += 1
        path = folder / f"{pure.stem}-{number}{pure.suffix}"
    return path


def _names_in(file: Path) -> set[str]:
    if not file.exists():
        return set()
    with zipfile.ZipFile(file) as packed:
        return set(packed.namelist())


def _move_into_zip(file: Path, packed: Path) -> None:
    with zipfile.ZipFile(packed, "a", zipfile.ZIP_STORED) as stream:  # pictures do not get smaller
        stream.write(file, file.name)
    file.unlink()


async def _body(request: Request) -> dict[str, Any]:
    data = b""
    async for piece in request.stream():
        data += piece
        if len(data) > _MOST_REQUEST:
            raise Full("the request is too long")
    try:
        parsed = json.loads(data)
    except ValueError:
        parsed = None
    if not isinstance(parsed, dict):
        raise UsageError('send JSON: {"to": "zip", "photos": [{"id": ..., "options": {...}}]}')
    return parsed


def _parsed(desk: Desk, given: dict[str, Any]) -> tuple[Literal["zip", "folder"], list[tuple[Stored, Wanted]]]:
    to, photos = given.get("to"), given.get("photos")
    if to not in ("zip", "folder"):
        raise UsageError("'to' takes zip or folder")
    if to == "folder" and desk.settings.folder is None:
        raise UsageError("the page may not save to a folder: start it with --folder, or take the zip file")
    if not isinstance(photos, list) or not photos:
        raise UsageError("'photos' takes a list of photos, at least one")
    return to, [_one_of(desk, each) for each in photos]


def _one_of(desk: Desk, each: Any) -> tuple[Stored, Wanted]:
    options = each.get("options", {}) if isinstance(each, dict) else None
    if not isinstance(options, dict) or not all(isinstance(value, str) for value in options.values()):
        raise UsageError('each photo is {"id": ..., "options": {name: text}}')
    return desk.store.get(str(each.get("id"))), read(options, desk.path)


def _make_room(savings: dict[str, Saving]) -> None:
    """Forgets the oldest savings that are over.

    Raises:
        Busy: too many are at work.
    """
    over = [saving for saving in savings.values() if saving.state != "working"]
    for saving in over[: max(len(savings) - _MOST_KEPT + 1, 0)]:
        del savings[saving.id]
        if saving.to == "zip":
            shutil.rmtree(saving.folder, ignore_errors=True)
    if len(savings) >= _MOST_KEPT:
        raise Busy("too many photos are being saved at once: wait for one of these to end")


def _savings(request: Request) -> dict[str, Saving]:
    """All that are known, by their ids."""
    return request.app.state.savings


def _saving(request: Request) -> Saving:
    saving = _savings(request).get(request.path_params["id"])
    if saving is None:
        raise Missing("nothing is known of this: the program may have been started anew")
    return saving
