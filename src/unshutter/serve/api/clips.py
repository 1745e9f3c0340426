"""For the page: a clip is opened once, and then shown at a few moments."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from unshutter.errors import UsageError
from unshutter.serve.answers import jpeg_answer
from unshutter.serve.desk import desk_of
from unshutter.serve.fields import read_clip
from unshutter.serve.jobs import clip as jobs
from unshutter.serve.jobs import moments
from unshutter.serve.lanes import Urgency
from unshutter.serve.requests import (
    body_closed,
    body_opened,
    check_clips_can_be_opened,
    item_of,
    longest_of,
    options_of,
    urgency_of,
)
from unshutter.video.options import RectifyClip


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
    return jpeg_answer(*await desk.lanes.do(urgency_of(request), moments.before, *job))


async def after(request: Request) -> Response:
    """``GET /api/clips/{id}/after``: the frame rectified, as a JPEG for the screen, with the result in a header."""
    desk = desk_of(request)
    job = item_of(request), _options(request), _moment(request), longest_of(request)
    return jpeg_answer(*await desk.lanes.do(Urgency.LATER, moments.after, *job))


async def readout(request: Request) -> Response:
    """``GET /api/clips/{id}/readout``: the readout time of its camera, given or found."""
    desk = desk_of(request)
    open_file = item_of(request)
    return JSONResponse(await desk.lanes.do(Urgency.LATER, jobs.readout, open_file, _options(request)))


def _options(request: Request) -> RectifyClip:
    return read_clip(options_of(request, "moment"))


def _moment(request: Request) -> int:
    text = request.query_params.get("moment", "0")
    if not (text.isdecimal() and len(text) == 1 and int(text) < moments.MOMENTS):
        raise UsageError(f"'moment' takes 0 to {moments.MOMENTS - 1}, got '{text:.40}'")
    return int(text)
