"""Request handlers for saving photos and clips: start a save, follow its progress, cancel it, download the result."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse

from unshutter.errors import UsageError
from unshutter.serve.answers import header_text
from unshutter.serve.desk import Desk, desk_of
from unshutter.serve.fields import read, read_clip
from unshutter.serve.savings import Item, Saving, To, savings_of
from unshutter.serve.store import Full, Missing

_MOST_REQUEST = 2_000_000  # bytes
_ALIVE_S = 15.0  # between keep-alive messages to the page


async def start(request: Request) -> Response:
    """``POST /api/saves``: photos and clips with their options -> the id of the saving."""
    to, items = _parsed(desk_of(request), await _body(request))
    return JSONResponse(savings_of(request).begin(to, items).as_json(), 202)


async def events(request: Request) -> Response:
    """``GET /api/saves/{id}/events``: its progress as server-sent events, until its end."""
    saving = _saving(request)

    async def lines() -> AsyncIterator[str]:
        while True:
            changed = saving.changed
            yield f"data: {json.dumps(saving.as_json())}\n\n"
            while saving.state == "working" and not changed.is_set():
                try:
                    await asyncio.wait_for(changed.wait(), _ALIVE_S)
                except TimeoutError:
                    yield ": still at work\n\n"
            if saving.state != "working" and not changed.is_set():
                return

    return StreamingResponse(lines(), media_type="text/event-stream")


async def cancel(request: Request) -> Response:
    """``DELETE /api/saves/{id}``: stops it, or deletes its results; files in a folder remain."""
    saving = _saving(request)
    await saving.cancel()
    return JSONResponse(saving.as_json())


async def download(request: Request) -> Response:
    """``GET /api/saves/{id}/file``: the zip file, or the one photo or clip."""
    result = _saving(request).result
    if result is None:
        raise Missing("there is no such file, or not yet")
    return FileResponse(result, filename=result.name, headers={"unshutter-name": header_text(result.name)})


def _saving(request: Request) -> Saving:
    return savings_of(request).get(request.path_params["id"])


async def _body(request: Request) -> dict[str, Any]:
    data = b""
    async for piece in request.stream():
        data += piece
        if len(data) > _MOST_REQUEST:
            raise Full("the request is too long")
    try:
        parsed = json.loads(data)
    except (ValueError, RecursionError):  # not JSON, or too deeply nested
        parsed = None
    if not isinstance(parsed, dict):
        raise UsageError('send JSON: {"to": "zip", "photos": [{"id": ..., "options": {...}}]}')
    return parsed


def _parsed(desk: Desk, body: dict[str, Any]) -> tuple[To, list[Item]]:
    to, photos = body.get("to"), body.get("photos")
    if to not in ("file", "zip", "folder"):
        raise UsageError("'to' takes file, zip or folder")
    if to == "folder" and desk.settings.folder is None:
        raise UsageError("the page may not save to a folder: start it with --folder, or take the zip file")
    if not isinstance(photos, list) or not photos:
        raise UsageError("'photos' takes a list of photos or clips, at least one")
    if to == "file" and len(photos) > 1:
        raise UsageError("'file' is for one photo or clip: choose zip for several")
    return to, [_item(desk, each) for each in photos]


def _item(desk: Desk, each: Any) -> Item:
    id, options = (each.get("id"), each.get("options", {})) if isinstance(each, dict) else (None, None)
    if not (isinstance(id, str) and isinstance(options, dict) and _are_texts(options)):
        raise UsageError('each photo is {"id": ..., "options": {name: text}}')
    open_file = desk.store.get(id)
    return open_file, read_clip(options) if open_file.kind == "clip" else read(options, desk.photo_path)


def _are_texts(options: dict[str, Any]) -> bool:
    """Returns whether all values are strings, and neither they nor the names contain a lone surrogate."""
    if not all(isinstance(value, str) for value in options.values()):
        return False
    try:
        "".join([*options, *options.values()]).encode()
    except UnicodeEncodeError:
        return False
    return True
