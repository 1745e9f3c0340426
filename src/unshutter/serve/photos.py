"""For the page: photos are opened once, and then looked at and asked about in many ways."""

from __future__ import annotations

from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from unshutter.errors import UsageError
from unshutter.serve import direct, screen
from unshutter.serve.answers import told_header
from unshutter.serve.desk import desk_of
from unshutter.serve.fields import Wanted, read
from unshutter.serve.incoming import opened
from unshutter.serve.lanes import Urgency

SCREEN_SIDES = (320, 1000, 1600, 2400)  # longer sides of copies for screens [px]
_FULL = "full"
_OWN = ("token", "longest", "later")  # parameters that are no options


async def add(request: Request) -> Response:
    """``POST /api/photos``: the body is the photo, the header ``Unshutter-Name`` its name -> its id."""
    return await opened(request, "photo")


async def remove(request: Request) -> Response:
    """``DELETE /api/photos/{id}``: closes it."""
    desk = desk_of(request)
    desk.store.remove(desk.store.get(request.path_params["id"]))
    return Response(status_code=204)


async def before(request: Request) -> Response:
    """``GET /api/photos/{id}/before``: a JPEG for the screen, and in a header what the photo's file says."""
    desk = desk_of(request)
    held = desk.held(desk.store.get(request.path_params["id"]))
    data, told = await desk.lanes.do(urgency_of(request), screen.before, held, longest_of(request))
    return jpeg_answer(data, told)


async def after(request: Request) -> Response:
    """``GET /api/photos/{id}/after``: a JPEG for the screen, and in a header what was found and done."""
    desk = desk_of(request)
    held, wanted = desk.held(desk.store.get(request.path_params["id"])), _wanted(request)
    data, told = await desk.lanes.do(urgency_of(request), screen.after, held, wanted.rectify, longest_of(request))
    return jpeg_answer(data, told)


async def segments(request: Request) -> Response:
    """``GET /api/photos/{id}/segments``: the lines that methods look at."""
    desk = desk_of(request)
    held, wanted = desk.held(desk.store.get(request.path_params["id"])), _wanted(request)
    return JSONResponse(await desk.lanes.do(Urgency.NOW, screen.segments, held, wanted.rectify))


async def picture(request: Request) -> Response:
    """``GET /api/photos/{id}/picture``: the rectified photo, whole."""
    desk = desk_of(request)
    stored = desk.store.get(request.path_params["id"])
    return await direct.picture(desk, stored, _wanted(request).rectify)


async def motion(request: Request) -> Response:
    """``GET /api/photos/{id}/motion``: its motion as JSON."""
    desk = desk_of(request)
    return await direct.motion(desk, desk.store.get(request.path_params["id"]), _wanted(request))


def _wanted(request: Request) -> Wanted:
    given = {name: value for name, value in request.query_params.items() if name not in _OWN}
    return read(given, desk_of(request).photo_path)


def urgency_of(request: Request) -> Urgency:
    """Whether somebody waits for the answer."""
    return Urgency.LATER if request.query_params.get("later") == "1" else Urgency.NOW


def longest_of(request: Request) -> int | None:
    """Longer side of the copy that is wanted [px]: one of a few, since each is kept; None: full size."""
    text = request.query_params.get("longest", str(SCREEN_SIDES[2]))
    if text == _FULL:
        return None
    if text not in map(str, SCREEN_SIDES):
        raise UsageError(f"'longest' takes {', '.join(map(str, SCREEN_SIDES))} or {_FULL}, got '{text:.40}'")
    return int(text)


def jpeg_answer(data: bytes, told: dict[str, Any]) -> Response:
    """A picture for the screen, and what is told of it."""
    return Response(data, media_type="image/jpeg", headers={"unshutter-result": told_header(told)})
