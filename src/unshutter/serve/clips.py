"""Clips: opened once, looked at in a few moments; and, for programs, made whole by one request."""

from __future__ import annotations

from importlib.util import find_spec

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from unshutter.errors import UnshutterError, UsageError
from unshutter.serve import clip_work, moments
from unshutter.serve.desk import desk_of
from unshutter.serve.fields import read_clip
from unshutter.serve.incoming import form_of, opened, stored_of, texts_of
from unshutter.serve.lanes import Urgency
from unshutter.serve.photos import jpeg_answer, longest_of, urgency_of
from unshutter.serve.saving import begun
from unshutter.video.options import RectifyClip

_OWN = ("token", "longest", "later", "moment")  # parameters that are no options


def can_be_opened() -> bool:
    """Whether the extra is installed."""
    return find_spec("av") is not None


async def add(request: Request) -> Response:
    """``POST /api/clips``: the body is the clip, the header ``Unshutter-Name`` its name -> its id."""
    _check_extra()
    return await opened(request, "clip")


async def before(request: Request) -> Response:
    """``GET /api/clips/{id}/before``: a moment as a JPEG for the screen, and in a header what the clip says."""
    desk = desk_of(request)
    asked = desk.held(desk.store.get(request.path_params["id"])), _wanted(request), _moment(request)
    return jpeg_answer(*await desk.lanes.do(urgency_of(request), moments.before, *asked, longest_of(request)))


async def after(request: Request) -> Response:
    """``GET /api/clips/{id}/after``: the same moment straightened, and in a header what was found and done."""
    desk = desk_of(request)
    asked = desk.held(desk.store.get(request.path_params["id"])), _wanted(request), _moment(request)
    return jpeg_answer(*await desk.lanes.do(Urgency.LATER, moments.after, *asked, longest_of(request)))


async def readout(request: Request) -> Response:
    """``GET /api/clips/{id}/readout``: the readout time of its camera, given or found."""
    desk = desk_of(request)
    held = desk.held(desk.store.get(request.path_params["id"]))
    return JSONResponse(await desk.lanes.do(Urgency.LATER, clip_work.readout, held, _wanted(request)))


async def video(request: Request) -> Response:
    """``POST /api/video``: multipart form -> the id of a saving, from which the whole clip is fetched."""
    _check_extra()
    desk = desk_of(request)
    async with form_of(request, "clip") as form, stored_of(desk, form, "clip", keep=True) as stored:
        return begun(request, "file", [(stored["clip"], read_clip(texts_of(form)))], tuple(stored.values()))


def _check_extra() -> None:
    if not can_be_opened():
        raise UnshutterError("clips need the extra: pip install 'unshutter[video]'")


def _wanted(request: Request) -> RectifyClip:
    return read_clip({name: value for name, value in request.query_params.items() if name not in _OWN})


def _moment(request: Request) -> int:
    text = request.query_params.get("moment", "0")
    if not (text.isdecimal() and len(text) == 1 and int(text) < moments.MOMENTS):
        raise UsageError(f"'moment' takes 0 to {moments.MOMENTS - 1}, got '{text:.40}'")
    return int(text)
