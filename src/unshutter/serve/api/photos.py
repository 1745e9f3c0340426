"""For the page: a photo is opened once, and then shown and asked about many times."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from unshutter.serve.answers import jpeg_answer, motion_answer, picture_answer
from unshutter.serve.desk import desk_of
from unshutter.serve.fields import PhotoOptions, read
from unshutter.serve.jobs import photo as jobs
from unshutter.serve.lanes import Urgency
from unshutter.serve.requests import body_closed, body_opened, item_of, longest_of, options_of, urgency_of


async def add(request: Request) -> Response:
    """``POST /api/photos``: the body is the photo, the header ``Unshutter-Name`` its name -> its id."""
    return await body_opened(request, "photo")


async def remove(request: Request) -> Response:
    """``DELETE /api/photos/{id}``: closes it."""
    return await body_closed(request)


async def before(request: Request) -> Response:
    """``GET /api/photos/{id}/before``: a JPEG for the screen, with facts from the photo's file in a header."""
    desk = desk_of(request)
    open_file = item_of(request)
    return jpeg_answer(*await desk.lanes.do(urgency_of(request), jobs.before, open_file, longest_of(request)))


async def after(request: Request) -> Response:
    """``GET /api/photos/{id}/after``: the rectified photo as a JPEG for the screen, with the result in a header."""
    desk = desk_of(request)
    open_file, wanted = item_of(request), _options(request)
    return jpeg_answer(
        *await desk.lanes.do(urgency_of(request), jobs.after, open_file, wanted.rectify, longest_of(request))
    )


async def segments(request: Request) -> Response:
    """``GET /api/photos/{id}/segments``: the lines that estimators look at."""
    desk = desk_of(request)
    open_file, wanted = item_of(request), _options(request)
    return JSONResponse(await desk.lanes.do(Urgency.NOW, jobs.segments, open_file, wanted.rectify))


async def picture(request: Request) -> Response:
    """``GET /api/photos/{id}/picture``: the rectified photo as a file, in full size."""
    return await picture_answer(desk_of(request), item_of(request), _options(request).rectify)


async def motion(request: Request) -> Response:
    """``GET /api/photos/{id}/motion``: its motion as JSON."""
    return await motion_answer(desk_of(request), item_of(request), _options(request))


def _options(request: Request) -> PhotoOptions:
    return read(options_of(request), desk_of(request).photo_path)
