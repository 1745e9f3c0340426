"""Request handlers for photos: one request per photo for programs; an open photo shown many times for the page."""

from __future__ import annotations

from starlette.datastructures import FormData, UploadFile
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from unshutter.options import Rectify
from unshutter.serve.answers import jpeg_answer, motion_answer, picture_answer
from unshutter.serve.desk import desk_of
from unshutter.serve.fields import CANDIDATES, PhotoOptions, read, truth
from unshutter.serve.jobs import photo as jobs
from unshutter.serve.lanes import Urgency
from unshutter.serve.requests import (
    body_closed,
    body_opened,
    files_of,
    form_of,
    is_draft,
    item_of,
    longest_of,
    options_of,
    texts_of,
    urgency_of,
)
from unshutter.serve.store import OpenFile


async def rectify(request: Request) -> Response:
    """``POST /api/rectify``: multipart form -> the picture."""
    desk = desk_of(request)
    async with form_of(request) as form, files_of(desk, form, "photo", "before", "after", keep=True) as files:
        fields = read(_fields(form, files), desk.photo_path)
        options = fields.rectify
        motion = form.get("motion")
        if isinstance(motion, UploadFile):
            file = files["photo"].path.with_name("motion.json")
            file.write_bytes(await motion.read())
            options = Rectify.of(options.find, file, options.undo, options.save, options.neighbours)
        return await picture_answer(desk, files["photo"], options, fields.hand, tuple(files.values()))


async def estimate(request: Request) -> Response:
    """``POST /api/estimate``: multipart form -> the motion as JSON, or all that fit the photo."""
    desk = desk_of(request)
    async with form_of(request) as form, files_of(desk, form, "photo") as files:
        fields = _fields(form, files)
        candidates = truth(CANDIDATES, fields.pop(CANDIDATES, ""))
        return await motion_answer(desk, files["photo"], read(fields, desk.photo_path), candidates)


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
    open_file, options = item_of(request), _options(request)
    job = open_file, options.rectify, longest_of(request), options.hand, is_draft(request)
    return jpeg_answer(*await desk.lanes.do(urgency_of(request), jobs.after, *job))


async def candidates(request: Request) -> Response:
    """``GET /api/photos/{id}/candidates``: the motions that fit the photo, in the order that ``candidate`` counts."""
    desk = desk_of(request)
    open_file, options = item_of(request), _options(request)
    return JSONResponse(await desk.lanes.do(urgency_of(request), jobs.candidates, open_file, options.rectify))


async def segments(request: Request) -> Response:
    """``GET /api/photos/{id}/segments``: the line segments that are found in the photo."""
    desk = desk_of(request)
    open_file, options = item_of(request), _options(request)
    return JSONResponse(await desk.lanes.do(Urgency.NOW, jobs.segments, open_file, options.rectify, options.hand))


async def picture(request: Request) -> Response:
    """``GET /api/photos/{id}/picture``: the rectified photo as a file, in full size."""
    options = _options(request)
    return await picture_answer(desk_of(request), item_of(request), options.rectify, options.hand)


async def motion(request: Request) -> Response:
    """``GET /api/photos/{id}/motion``: its motion as JSON."""
    return await motion_answer(desk_of(request), item_of(request), _options(request))


def _options(request: Request) -> PhotoOptions:
    return read(options_of(request), desk_of(request).photo_path)


def _fields(form: FormData, files: dict[str, OpenFile]) -> dict[str, str]:
    """Returns the form's options; neighbours uploaded with the form are named by their ids."""
    return texts_of(form) | {name: file.id for name, file in files.items() if name != "photo"}
