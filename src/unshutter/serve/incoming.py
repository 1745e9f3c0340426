"""Photos and clips on their way in: as the body of a request, or as parts of a form with what is wanted of them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from urllib.parse import unquote

from starlette.datastructures import FormData, UploadFile
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from unshutter.errors import UsageError
from unshutter.serve.desk import Desk, desk_of
from unshutter.serve.store import Kind, Stored

_MOST_FILES, _MOST_FIELDS, _MOST_TEXT = 4, 40, 10_000
_PIECE = 1 << 18


async def opened(request: Request, kind: Kind) -> Response:
    """The answer to a request whose body is a file, and whose header ``Unshutter-Name`` is its name: its id.

    Raises:
        Full: there is no room for it.
        UnshutterError: it is empty.
    """
    name = unquote(request.headers.get("unshutter-name", kind))
    said = request.headers.get("content-length", "")
    size = int(said) if said.isdigit() else 0
    try:
        stored = await desk_of(request).store.add(name, request.stream(), kind, size)
    except ClientDisconnect:
        return Response(status_code=400)
    return JSONResponse({"id": stored.id, "name": stored.name}, 201)


@asynccontextmanager
async def form_of(request: Request, kind: Kind = "photo") -> AsyncIterator[FormData]:
    """The form of a request.

    Args:
        request: the request.
        kind: what the form should bring.

    Raises:
        UsageError: it brings no form.
    """
    if not request.headers.get("content-type", "").startswith("multipart/form-data"):
        raise UsageError(f"send a form (multipart/form-data) with the {kind} as the part '{kind}'")
    async with request.form(max_files=_MOST_FILES, max_fields=_MOST_FIELDS, max_part_size=_MOST_TEXT) as form:
        yield form


@asynccontextmanager
async def stored_of(
    desk: Desk, form: FormData, kind: Kind, *others: str, keep: bool = False
) -> AsyncIterator[dict[str, Stored]]:
    """The form's files, by the names of their parts, open meanwhile.

    Args:
        desk: of the server.
        form: the form; its part called ``kind`` has to be there.
        kind: of all files.
        others: names of parts that may be there.
        keep: whether they stay open after that if all goes well.

    Raises:
        UsageError: the first part is missing.
        Full: there is no room for them.
    """
    stored: dict[str, Stored] = {}
    done = False
    try:
        if not isinstance(form.get(kind), UploadFile):
            raise UsageError(f"the {kind} is missing: send it as the part '{kind}', with a file name")
        for name in (kind, *others):
            given = form.get(name)
            if isinstance(given, UploadFile):
                stored[name] = await desk.store.add(given.filename or kind, _pieces(given), kind, given.size or 0)
        yield stored
        done = True
    finally:
        for each in () if done and keep else stored.values():
            desk.store.remove(each)


def texts_of(form: FormData) -> dict[str, str]:
    """The fields that are no files."""
    return {name: value for name, value in form.items() if isinstance(value, str)}


async def _pieces(given: UploadFile) -> AsyncIterator[bytes]:
    while piece := await given.read(_PIECE):
        yield piece
