"""The addresses by which photos and clips are saved: begun, watched, cancelled, fetched."""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import AsyncIterator, Sequence
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse

from unshutter.errors import UsageError
from unshutter.serve.answers import told_header
from unshutter.serve.desk import Desk, desk_of
from unshutter.serve.fields import Wanted, read, read_clip
from unshutter.serve.lanes import Busy
from unshutter.serve.saves import Saving, To
from unshutter.serve.store import Full, Missing, Stored
from unshutter.video.options import RectifyClip

_MOST_KEPT = 8  # savings whose files lie ready, or that are at work
_MOST_REQUEST = 2_000_000  # bytes
_ALIVE_S = 15.0  # between signs of life to the page


async def start(request: Request) -> Response:
    """``POST /api/saves``: photos and clips with their options -> the id of the saving."""
    to, items = _parsed(desk_of(request), await _body(request))
    return begun(request, to, items)


def begun(
    request: Request,
    to: To,
    items: list[tuple[Stored, Wanted | RectifyClip]],
    closing: Sequence[Stored] = (),
) -> Response:
    """The answer to a request that begins a saving: its id.

    Raises:
        Busy: too many are at work.
    """
    desk, savings = desk_of(request), _savings(request)
    _make_room(savings)
    id = secrets.token_urlsafe(9)
    folder = desk.settings.folder
    if to != "folder" or folder is None:
        folder = desk.store.folder / f"saving-{id}"
        folder.mkdir()
    saving = savings[id] = Saving(id, to, folder, items, closing)
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
    """``DELETE /api/saves/{id}``: stops it, or forgets what it has made; what is in a folder stays there."""
    saving = _saving(request)
    if saving.task is not None and not saving.task.done():
        saving.task.cancel()
        await asyncio.wait([saving.task])
    else:
        saving.forget()
    return JSONResponse(saving.told())


async def download(request: Request) -> Response:
    """``GET /api/saves/{id}/file``: the zip file, or the one photo or clip."""
    result = _saving(request).result
    if result is None:
        raise Missing("there is no such file, or not yet")
    return FileResponse(result, filename=result.name, headers={"unshutter-name": told_header(result.name)})


async def _body(request: Request) -> dict[str, Any]:
    data = b""
    async for piece in request.stream():
        data += piece
        if len(data) > _MOST_REQUEST:
            raise Full("the request is too long")
    try:
        parsed = json.loads(data)
    except (ValueError, RecursionError):  # not JSON, or nested too deep
        parsed = None
    if not isinstance(parsed, dict):
        raise UsageError('send JSON: {"to": "zip", "photos": [{"id": ..., "options": {...}}]}')
    return parsed


def _parsed(desk: Desk, given: dict[str, Any]) -> tuple[To, list[tuple[Stored, Wanted | RectifyClip]]]:
    to, photos = given.get("to"), given.get("photos")
    if to not in ("file", "zip", "folder"):
        raise UsageError("'to' takes file, zip or folder")
    if to == "folder" and desk.settings.folder is None:
        raise UsageError("the page may not save to a folder: start it with --folder, or take the zip file")
    if not isinstance(photos, list) or not photos:
        raise UsageError("'photos' takes a list of photos or clips, at least one")
    if to == "file" and len(photos) > 1:
        raise UsageError("'file' is for one photo or clip: choose zip for several")
    return to, [_one_of(desk, each) for each in photos]


def _one_of(desk: Desk, each: Any) -> tuple[Stored, Wanted | RectifyClip]:
    id, options = (each.get("id"), each.get("options", {})) if isinstance(each, dict) else (None, None)
    if not (isinstance(id, str) and isinstance(options, dict) and _are_texts(options)):
        raise UsageError('each photo is {"id": ..., "options": {name: text}}')
    stored = desk.store.get(id)
    return stored, read_clip(options) if stored.kind == "clip" else read(options, desk.photo_path)


def _are_texts(options: dict[str, Any]) -> bool:
    """Whether all values are texts, and no half of a character is in them or the names, as JSON allows."""
    if not all(isinstance(value, str) for value in options.values()):
        return False
    try:
        "".join([*options, *options.values()]).encode()
    except UnicodeEncodeError:
        return False
    return True


def _make_room(savings: dict[str, Saving]) -> None:
    """Forgets the oldest savings that are over.

    Raises:
        Busy: too many are at work.
    """
    over = [saving for saving in savings.values() if saving.state != "working"]
    for saving in over[: max(len(savings) - _MOST_KEPT + 1, 0)]:
        del savings[saving.id]
        saving.forget()
    if len(savings) >= _MOST_KEPT:
        raise Busy("too many files are being saved at once: wait for one of these to end")


def _savings(request: Request) -> dict[str, Saving]:
    """All that are known, by their ids."""
    return request.app.state.savings


def _saving(request: Request) -> Saving:
    saving = _savings(request).get(request.path_params["id"])
    if saving is None:
        raise Missing("nothing is known of this: the program may have been started anew")
    return saving
