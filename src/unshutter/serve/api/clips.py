"""Request handlers for clips: one request per clip for programs; an open clip shown at a few moments for the page."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response

from unshutter.errors import UsageError
from unshutter.serve.answers import jpeg_answer
from unshutter.serve.desk import desk_of
from unshutter.serve.fields import read_clip
from unshutter.serve.jobs import clip as jobs
from unshutter.serve.jobs import clip_film
from unshutter.serve.lanes import Urgency
from unshutter.serve.requests import (
    body_closed,
    body_opened,
    check_clips_can_be_opened,
    files_of,
    form_of,
    item_of,
    longest_of,
    options_of,
    texts_of,
    urgency_of,
)
from unshutter.serve.savings import savings_of
from unshutter.video.options import RectifyClip


async def video(request: Request) -> Response:
    """``POST /api/video``: multipart form -> the id of a saving.

    ``/api/saves/{id}/events`` reports its progress, and ``/api/saves/{id}/file`` is the clip when its state is
    ``finished``.
    """
    check_clips_can_be_opened()
    async with form_of(request, "clip") as form, files_of(desk_of(request), form, "clip", keep=True) as files:
        item = files["clip"], read_clip(texts_of(form))
        saving = savings_of(request).begin("file", [item], tuple(files.values()))
        return JSONResponse(saving.as_json(), 202)


async def add(request: Request) -> Response:
    """``POST /api/clips``: the body is the clip, the header ``Unshutter-Name`` its name -> its id."""
    check_clips_can_be_opened()
    return await body_opened(request, "clip")


async def remove(request: Request) -> Response:
    """``DELETE /api/clips/{id}``: closes it."""
    return await body_closed(request)


async def before(request: Request) -> Response:
    """``GET /api/clips/{id}/before``: a frame as a JPEG for the screen, with facts from the clip's file in a header."""
    desk = desk_of(request)
    job = item_of(request), _options(request), _moment(request), longest_of(request)
    return jpeg_answer(*await desk.lanes.do(urgency_of(request), jobs.before, *job))


async def after(request: Request) -> Response:
    """``GET /api/clips/{id}/after``: the frame rectified, as a JPEG for the screen, with the result in a header."""
    desk = desk_of(request)
    job = item_of(request), _options(request), _moment(request), longest_of(request)
    return jpeg_answer(*await desk.lanes.do(Urgency.LATER, jobs.after, *job))


async def film(request: Request) -> Response:
    """``GET /api/clips/{id}/film``: a WebM film of a few seconds around a moment, each frame before and after."""
    job = item_of(request), _options(request), _moment(request)
    file = await desk_of(request).lanes.do(Urgency.LATER, clip_film.film, *job)
    return FileResponse(file, media_type="video/webm")


async def readout(request: Request) -> Response:
    """``GET /api/clips/{id}/readout``: the readout time of its camera, as stated or estimated."""
    desk = desk_of(request)
    open_file = item_of(request)
    return JSONResponse(await desk.lanes.do(Urgency.LATER, jobs.readout, open_file, _options(request)))


def _options(request: Request) -> RectifyClip:
    return read_clip(options_of(request, "moment"))


def _moment(request: Request) -> int:
    text = request.query_params.get("moment", "0")
    if not (text.isdecimal() and len(text) == 1 and int(text) < jobs.MOMENTS):
        raise UsageError(f"'moment' takes 0 to {jobs.MOMENTS - 1}, got '{text:.40}'")
    return int(text)
