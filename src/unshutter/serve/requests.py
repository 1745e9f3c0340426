"""Request parsing shared by handlers: uploaded files, as a body or in a form, and query parameters."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.util import find_spec
from urllib.parse import unquote

from starlette.datastructures import FormData, UploadFile
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from unshutter import installation
from unshutter.errors import UnshutterError, UsageError
from unshutter.serve.desk import Desk, desk_of
from unshutter.serve.jobs.cache import Kind
from unshutter.serve.lanes import Urgency
from unshutter.serve.store import OpenFile

SCREEN_SIDES = (320, 1000, 1600, 2400)  # longer sides of copies for screens [px]
_FULL = "full"
_NOT_OPTIONS = ("token", "longest", "later", "draft")  # query parameters
_MOST_FILES, _MOST_FIELDS, _MOST_TEXT = 4, 40, 10_000
_PIECE = 1 << 18


# ---- queries about open files --------------------------------------------------------------------------------


def item_of(request: Request) -> OpenFile:
    """Returns the open photo or clip whose id is in the address.

    Raises:
        Missing: the file is not open.
    """
    return desk_of(request).store.get(request.path_params["id"])


def options_of(request: Request, *others: str) -> dict[str, str]:
    """Returns the options in the query as text; ``others`` are parameters of this address that are not options."""
    return {name: value for name, value in request.query_params.items() if name not in (*_NOT_OPTIONS, *others)}


def urgency_of(request: Request) -> Urgency:
    """Returns the urgency of a request: LATER if the query contains ``later=1``, otherwise NOW."""
    return Urgency.LATER if request.query_params.get("later") == "1" else Urgency.NOW


def is_draft(request: Request) -> bool:
    """Returns whether the response should be fast rather than complete."""
    return request.query_params.get("draft") == "1"


def longest_of(request: Request) -> int | None:
    """Returns the longer side of the copy to send [px], or None for full size; few are allowed, as each is cached.

    Raises:
        UsageError: the size is not one of those allowed.
    """
    text = request.query_params.get("longest", str(SCREEN_SIDES[2]))
    if text == _FULL:
        return None
    if text not in map(str, SCREEN_SIDES):
        raise UsageError(f"'longest' takes {', '.join(map(str, SCREEN_SIDES))} or {_FULL}, got '{text:.40}'")
    return int(text)


# ---- uploaded files ------------------------------------------------------------------------------------------


def clips_can_be_opened() -> bool:
    """Returns whether the extra for clips is installed."""
    return find_spec("av") is not None


def check_clips_can_be_opened() -> None:
    """Raises UnshutterError if the extra for clips is missing."""
    if not clips_can_be_opened():
        raise UnshutterError(f"clips need the extra: {installation.extra('video')}")


async def body_opened(request: Request, kind: Kind) -> Response:
    """Opens the file in the request's body, named by the header ``Unshutter-Name``, and responds with its id.

    Raises:
        Full: there is no room for the file.
        UnshutterError: the file is empty.
    """
    name = unquote(request.headers.get("unshutter-name", kind))
    length = request.headers.get("content-length", "")
    size = int(length) if length.isdigit() else 0
    try:
        open_file = await desk_of(request).store.add(name, request.stream(), kind, size)
    except ClientDisconnect:
        return Response(status_code=400)
    return JSONResponse({"id": open_file.id, "name": open_file.name}, 201)


async def body_closed(request: Request) -> Response:
    """Closes the photo or clip whose id is in the address."""
    desk_of(request).store.remove(item_of(request))
    return Response(status_code=204)


@asynccontextmanager
async def form_of(request: Request, kind: Kind = "photo") -> AsyncIterator[FormData]:
    """Parses the form of a request.

    Args:
        request: the request.
        kind: type of file that the form should contain.

    Raises:
        UsageError: the request has no form.
    """
    if not request.headers.get("content-type", "").startswith("multipart/form-data"):
        raise UsageError(f"send a form (multipart/form-data) with the {kind} as the part '{kind}'")
    async with request.form(max_files=_MOST_FILES, max_fields=_MOST_FIELDS, max_part_size=_MOST_TEXT) as form:
        yield form


@asynccontextmanager
async def files_of(
    desk: Desk, form: FormData, kind: Kind, *others: str, keep: bool = False
) -> AsyncIterator[dict[str, OpenFile]]:
    """Opens the form's files inside the context, keyed by the names of their parts.

    Args:
        desk: the server's shared state.
        form: the form; its part called ``kind`` is required.
        kind: type of all files.
        others: names of optional parts.
        keep: whether to leave the files open after the context if there was no error.

    Raises:
        UsageError: the required part is missing.
        Full: there is no room for the files.
    """
    files: dict[str, OpenFile] = {}
    done = False
    try:
        if not isinstance(form.get(kind), UploadFile):
            raise UsageError(f"the {kind} is missing: send it as the part '{kind}', with a file name")
        for name in (kind, *others):
            part = form.get(name)
            if isinstance(part, UploadFile):
                files[name] = await desk.store.add(part.filename or kind, _pieces(part), kind, part.size or 0)
        yield files
        done = True
    finally:
        for each in () if done and keep else files.values():
            desk.store.remove(each)


def texts_of(form: FormData) -> dict[str, str]:
    """Returns the fields of a form that are not files."""
    return {name: value for name, value in form.items() if isinstance(value, str)}


async def _pieces(part: UploadFile) -> AsyncIterator[bytes]:
    while piece := await part.read(_PIECE):
        yield piece
