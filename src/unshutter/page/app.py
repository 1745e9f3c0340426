"""The page's server as an ASGI application: routes and request handlers."""

from __future__ import annotations

import asyncio
import json
import os
import secrets
from collections.abc import AsyncIterator, Callable, Mapping
from functools import partial
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from typing import TypeVar
from urllib.parse import unquote

from starlette.applications import Starlette
from starlette.background import BackgroundTask
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from unshutter import version
from unshutter.errors import UnknownRatioError, UnshutterError, UsageError, shortened, visible
from unshutter.options.clip_options import RectifyClip
from unshutter.page.guard import Guard, Limits
from unshutter.page.jobs import clip_jobs, photo_jobs
from unshutter.page.opened import MOMENTS, Kind, progress_of
from unshutter.page.saves import Destination, Item, SaveTasks, Saving, photo_result
from unshutter.page.sentences import OTHER_NEIGHBOURS, advice, reason_json
from unshutter.page.settings import PhotoOptions, page_module, read, read_clip, refusal
from unshutter.page.store import OpenFile, Refused, ServerState, Urgency
from unshutter.page.tabs import ALIVE_S, Tabs, tab_routes
from unshutter.progress import tell
from unshutter.reasons import JsonObject
from unshutter.run.inputs import motion_name, unchanged_name
from unshutter.version import __version__

R = TypeVar("R")

PAGE = Path(__file__).parent / "web"
_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".jpg": "image/jpeg",
}
_SCREEN_SIDES = ("320", "1000", "1600", "2400")  # longer sides of copies for screens [px]; few, as each is cached
_FULL = "full"
_NOT_OPTIONS = ("longest", "later", "draft", "moment", "usual")  # query parameters


def application(
    state: ServerState, token: str, port: int, tabs: Tabs | None = None, patience_s: float = 10.0
) -> ASGIApp:
    """Builds the ASGI application for the whole server."""
    photo = "/api/photos/{id}"
    clip = "/api/clips/{id}"
    save = "/api/saves/{id}"
    routes = [
        *_files(),
        Route("/api/about", _about),
        Route("/api/wake", _wake, methods=["POST"]),
        Route("/api/photos", partial(_open, kind="photo"), methods=["POST"]),
        Route(photo, _close, methods=["DELETE"]),
        Route("/api/bursts", _bursts, methods=["POST"]),
        Route(f"{photo}/before", _before_photo),
        Route(f"{photo}/after", _after_photo),
        Route(f"{photo}/candidates", _candidates),
        Route(f"{photo}/segments", _segments),
        Route(f"{photo}/picture", _picture),
        Route(f"{photo}/motion", _motion),
        Route("/api/clips", partial(_open, kind="clip"), methods=["POST"]),
        Route(clip, _close, methods=["DELETE"]),
        Route(f"{clip}/before", _before_clip),
        Route(f"{clip}/after", _after_clip),
        Route(f"{clip}/film", _excerpt),
        Route(f"{clip}/readout", _readout),
        Route(f"{clip}/progress", _progress),
        Route("/api/saves", _save, methods=["POST"]),
        Route(f"{save}/events", _events),
        Route(save, _cancel, methods=["DELETE"]),
        Route(f"{save}/file", _download),
        *(tab_routes(tabs, state.settings) if tabs else []),
    ]
    limits = Middleware(Limits, state.settings, patience_s)
    kinds = (HTTPException, UnshutterError, OSError, Exception)
    app = Starlette(routes=routes, middleware=[limits], exception_handlers=dict.fromkeys(kinds, _refusal))
    app.state.desk, app.state.savings = state, SaveTasks(state)
    return Guard(app, token, port, state.settings.host)


def _files() -> list[Route]:
    """Lists routes for the page's files, which are read now: an update may replace them while the server runs."""
    files = {path.name: path.read_bytes() for path in PAGE.iterdir() if path.suffix in _TYPES}
    files["options.js"] = page_module().encode()

    async def file(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in files:
            raise HTTPException(404)
        return Response(files[name], media_type=_TYPES[PurePosixPath(name).suffix])

    return [Route("/", file), Route("/page/{name}", file)]


async def _about(request: Request) -> Response:
    """Version, largest photo and clip [bytes], and how to get clips."""
    settings = _desk(request).settings
    limits = {"max_bytes": settings.max_bytes, "max_clip_bytes": settings.max_clip_bytes}
    clips = {"clips": _clips_can_be_opened(), "install_clips": version.extra("video")}
    return JSONResponse({"version": __version__, **clips, **limits})


async def _wake(request: Request) -> Response:
    """Loads what the first photo needs, in two workers: one to show the photo, the other to estimate its motion."""
    workers = _desk(request).workers
    await asyncio.gather(*(workers.do(Urgency.NOW, photo_jobs.warm) for _ in range(2)))
    return Response(status_code=204)


# ---- photos ----------------------------------------------------------------------------------------------------


async def _open(request: Request, kind: Kind) -> Response:
    """Opens the file in the request's body, named by the header ``Unshutter-Name``, and responds with its id."""
    if kind == "clip" and not _clips_can_be_opened():
        raise UnshutterError(f"clips need the extra: {version.extra('video')}")
    name = unquote(request.headers.get("unshutter-name", kind))
    length = request.headers.get("content-length", "")
    size = int(length) if length.isdigit() else 0
    try:
        open_file = await _desk(request).store.add(name, request.stream(), kind, size)
    except ClientDisconnect:
        return Response(status_code=400)
    return JSONResponse({"id": open_file.id, "name": open_file.name}, 201)


async def _close(request: Request) -> Response:
    _desk(request).store.remove(_open_file(request))
    return Response(status_code=204)


async def _before_photo(request: Request) -> Response:
    return _shown(*await _do(request, _urgency(request), photo_jobs.before, _longest(request)))


async def _after_photo(request: Request) -> Response:
    options = _photo_options(request)
    is_draft = request.query_params.get("draft") == "1"
    return _shown(*await _do(request, _urgency(request), photo_jobs.after, options, _longest(request), is_draft))


async def _candidates(request: Request) -> Response:
    """The motions that fit the photo, in the order that option ``candidate`` counts."""
    return JSONResponse(await _do(request, _urgency(request), photo_jobs.candidates, _photo_options(request)))


async def _bursts(request: Request) -> Response:
    """The bursts among photos that came together: ``{"photos": [id, ...]}``, in order."""
    ids = (await _json(request)).get("photos")
    if not isinstance(ids, list) or not all(isinstance(id, str) for id in ids):
        raise UsageError("'photos' takes a list of ids of photos")
    state = _desk(request)
    photos = [photo for id in dict.fromkeys(ids) if (photo := state.store.get(id)).kind == "photo"]
    with state.store.used(photos):
        return JSONResponse(await state.workers.do(Urgency.LATER, photo_jobs.bursts, photos))


async def _segments(request: Request) -> Response:
    return JSONResponse(await _do(request, Urgency.NOW, photo_jobs.segments, _photo_options(request)))


async def _picture(request: Request) -> Response:
    """The rectified photo as a file, exactly as the command line would write it."""
    open_file = _open_file(request)
    options = _photo_options(request)
    name = open_file.name
    format = options.save.format
    names = [photo_result(open_file, format), unchanged_name(PurePosixPath(name), format)]
    token = secrets.token_hex(6)
    targets = [
        open_file.path.with_name(f"{what}-{token}{PurePosixPath(name).suffix}")
        for what, name in zip(("result", "copy"), names, strict=True)
    ]
    report = await _do(request, Urgency.NOW, photo_jobs.save, *targets, options)
    target = open_file.path.with_name(report.pop("result"))
    name = names[[each.name for each in targets].index(target.name)]
    headers = {"unshutter-result": _header(report), "unshutter-name": _header(name)}
    clean_up = BackgroundTask(target.unlink, missing_ok=True)
    return FileResponse(target, filename=name, headers=headers, background=clean_up)


async def _motion(request: Request) -> Response:
    """The photo's motion as JSON, in the format of ``unshutter estimate``."""
    open_file = _open_file(request)
    options = _photo_options(request)
    if options.neighbours:
        raise UsageError("with neighbours, there may be no single motion: leave them out to save one")
    text = await _do(request, Urgency.NOW, photo_jobs.estimate, options)
    name = _header(motion_name(PurePosixPath(open_file.name).stem))
    return Response(text, media_type="application/json", headers={"unshutter-name": name})


# ---- clips -----------------------------------------------------------------------------------------------------


def _clips_can_be_opened() -> bool:
    return find_spec("av") is not None


async def _before_clip(request: Request) -> Response:
    job = clip_jobs.before, _clip_options(request), _moment(request), _longest(request)
    return _shown(*await _do(request, _urgency(request), *job))


async def _after_clip(request: Request) -> Response:
    usual = request.query_params.get("usual") == "1"
    job = clip_jobs.after, _clip_options(request), _moment(request), _longest(request), usual
    return _shown(*await _do_while_wanted(request, Urgency.NOW if usual else Urgency.LATER, *job))


async def _excerpt(request: Request) -> Response:
    """A WebM video of a few seconds around a moment, each frame before and after."""
    file = await _do_while_wanted(request, Urgency.LATER, clip_jobs.excerpt, _clip_options(request), _moment(request))
    return FileResponse(file, media_type="video/webm")


async def _readout(request: Request) -> Response:
    """The readout time of the clip's camera, as stated or estimated."""
    return JSONResponse(
        await _do_while_wanted(request, Urgency.LATER, clip_jobs.measure_readout_time, _clip_options(request))
    )


async def _progress(request: Request) -> Response:
    """How far the search for the readout time is, or the video; ``{}`` before either begins."""
    return JSONResponse(progress_of(_open_file(request)).read() or {})


# ---- saving ----------------------------------------------------------------------------------------------------


async def _save(request: Request) -> Response:
    """Starts to save photos and clips with their options, and responds with the id of the task."""
    body = await _json(request)
    to, items = _wishes(_desk(request), body)
    only_changed = to == "zip" and body.get("only_changed") is True
    return JSONResponse(request.app.state.savings.begin(to, items, only_changed).as_json(), 202)


async def _json(request: Request) -> JsonObject:
    data = b""
    async for piece in request.stream():
        data += piece
        if len(data) > 2_000_000:
            raise Refused("the request is too long", 413)
    try:
        parsed = json.loads(data)
    except (ValueError, RecursionError):  # not JSON, or too deeply nested
        parsed = None
    if not isinstance(parsed, dict):
        raise UsageError('send JSON: {"to": "zip", "photos": [{"id": ..., "options": {...}}]}')
    return parsed


def _wishes(state: ServerState, body: JsonObject) -> tuple[Destination, list[Item]]:
    to = body.get("to")
    photos = body.get("photos")
    if to not in ("file", "zip"):
        raise UsageError("'to' takes file or zip")
    if not isinstance(photos, list) or not photos:
        raise UsageError("'photos' takes a list of photos or clips, at least one")
    if to == "file" and len(photos) > 1:
        raise UsageError("'file' is for one photo or clip: choose zip for several")
    return to, [_item(state, each) for each in photos]


def _item(state: ServerState, each: object) -> Item:
    id, options = (each.get("id"), each.get("options", {})) if isinstance(each, dict) else (None, None)
    if not (isinstance(id, str) and isinstance(options, dict) and _are_texts(options)):
        raise UsageError('each photo is {"id": ..., "options": {name: text}}')
    open_file = state.store.get(id)
    return open_file, read_clip(options) if open_file.kind == "clip" else read(options, state.photo_path)


def _are_texts(options: JsonObject) -> bool:
    """Returns whether all values are strings, and neither they nor the names contain a lone surrogate."""
    try:
        "".join([*options, *options.values()]).encode()
    except (TypeError, UnicodeEncodeError):
        return False
    return True


async def _events(request: Request) -> Response:
    """The task's progress as server-sent events, until its end."""
    saving = _saving(request)

    async def lines() -> AsyncIterator[str]:
        while True:
            changed = saving.changed
            yield f"data: {json.dumps(saving.as_json())}\n\n"
            while saving.state == "working" and not changed.is_set():
                try:
                    await asyncio.wait_for(changed.wait(), ALIVE_S)
                except TimeoutError:
                    yield ": still being processed\n\n"
            if saving.state != "working" and not changed.is_set():
                return

    return StreamingResponse(lines(), media_type="text/event-stream")


async def _cancel(request: Request) -> Response:
    saving = _saving(request)
    await saving.cancel()
    return JSONResponse(saving.as_json())


async def _download(request: Request) -> Response:
    """The zip file, or the one photo or clip."""
    result = _saving(request).result
    if result is None:
        raise Refused("this file does not exist, or is not finished", 404)
    return FileResponse(result, filename=result.name, headers={"unshutter-name": _header(result.name)})


def _saving(request: Request) -> Saving:
    return request.app.state.savings.get(request.path_params["id"])


# ---- requests and responses --------------------------------------------------------------------------------------


def _desk(request: Request) -> ServerState:
    return request.app.state.desk


def _open_file(request: Request) -> OpenFile:
    return _desk(request).store.get(request.path_params["id"])


async def _do(request: Request, urgency: Urgency, job: Callable[..., R], *arguments: object) -> R:
    """Runs a job on the open photo or clip whose id is in the address."""
    return await _desk(request).workers.do(urgency, job, _open_file(request), *arguments)


async def _do_while_wanted(request: Request, urgency: Urgency, job: Callable[..., R], *arguments: object) -> R:
    """Runs a long job, and stops it once nobody waits for its answer any more."""
    work = asyncio.create_task(_do(request, urgency, job, *arguments))
    gone = asyncio.ensure_future(request.receive())
    while not work.done():
        await asyncio.wait({work, gone}, return_when=asyncio.FIRST_COMPLETED)
        if gone.done() and gone.result()["type"] == "http.disconnect":
            work.cancel()
            raise HTTPException(400)
        gone = asyncio.ensure_future(request.receive()) if gone.done() else gone
    gone.cancel()
    return work.result()


def _photo_options(request: Request) -> PhotoOptions:
    return read(_fields(request), _desk(request).photo_path)


def _clip_options(request: Request) -> RectifyClip:
    return read_clip(_fields(request))


def _fields(request: Request) -> dict[str, str]:
    return {name: value for name, value in request.query_params.items() if name not in _NOT_OPTIONS}


def _moment(request: Request) -> int:
    text = request.query_params.get("moment", "0")
    if not (text.isdecimal() and len(text) == 1 and int(text) < MOMENTS):
        raise UsageError(f"'moment' takes 0 to {MOMENTS - 1}, got '{shortened(text)}'")
    return int(text)


def _longest(request: Request) -> int | None:
    """Returns the longer side of the copy to send [px], or None for full size."""
    text = request.query_params.get("longest", "1600")
    if text not in (*_SCREEN_SIDES, _FULL):
        raise UsageError(f"'longest' takes {', '.join(_SCREEN_SIDES)} or {_FULL}, got '{shortened(text)}'")
    return None if text == _FULL else int(text)


def _urgency(request: Request) -> Urgency:
    return Urgency.LATER if request.query_params.get("later") == "1" else Urgency.NOW


def _shown(jpeg: bytes, facts: JsonObject) -> Response:
    """Returns a JPEG for the screen, with facts about it in a header."""
    return Response(jpeg, media_type="image/jpeg", headers={"unshutter-result": _header(facts)})


def _header(value: object) -> str:
    """Encodes a value as ASCII JSON for use in a header."""
    return json.dumps(value, separators=(",", ":"))


async def _refusal(request: Request, error: Exception) -> Response:
    """Returns the response to a failed request: an HTTP status and ``{"error": one line}``."""
    if isinstance(error, HTTPException):
        return _line(error.detail, error.status_code, error.headers)
    if isinstance(error, UnshutterError):
        status = error.status if isinstance(error, Refused) else 400 if isinstance(error, UsageError) else 422
        headers = {"retry-after": "1"} if status == 503 else None
        return JSONResponse({**refusal(error), **_help_with(request, error)}, status, headers)
    if isinstance(error, OSError):  # for example, a full disc
        return _line(error.strerror or "the system refuses", 500)
    if os.environ.get("UNSHUTTER_DEBUG"):
        raise error
    tell(f"unshutter: unexpected {type(error).__name__} (UNSHUTTER_DEBUG=1 shows more)")
    return _line(f"unexpected {type(error).__name__}: please report it", 500)


def _help_with(request: Request, error: UnshutterError) -> JsonObject:
    """Returns what the page says instead of the error, where that is a reason, and its buttons that may help."""
    if isinstance(error, UnknownRatioError):
        return {**reason_json(error.reason), "advice": advice(error.reason)}
    with_neighbours = request.query_params.keys() & {"before", "after"}
    return {"advice": OTHER_NEIGHBOURS} if with_neighbours else {}


def _line(line: str, status: int, headers: Mapping[str, str] | None = None) -> Response:
    return JSONResponse({"error": visible(line)}, status, headers)
