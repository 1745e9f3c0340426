"""For programs: a photo with its options in one request, and the result in the answer."""

from __future__ import annotations

import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import PurePosixPath

from starlette.background import BackgroundTask
from starlette.datastructures import FormData, UploadFile
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from unshutter.batch.job import Outcome
from unshutter.batch.targets import picture_name
from unshutter.errors import UnshutterError, UsageError
from unshutter.options import Rectify
from unshutter.photo.formats import of_suffix
from unshutter.serve import work
from unshutter.serve.answers import told_header
from unshutter.serve.desk import Desk, desk_of
from unshutter.serve.fields import Wanted, read
from unshutter.serve.lanes import Urgency
from unshutter.serve.store import Stored

_MOST_FIELDS, _MOST_TEXT = 40, 10_000
_PIECE = 1 << 18


async def rectify(request: Request) -> Response:
    """``POST /api/rectify``: multipart form -> the picture."""
    desk = desk_of(request)
    async with _form(request) as form:
        wanted = read(_texts(form)).rectify
        stored = await _stored(desk, form)
        given = form.get("motion")
        try:
            if isinstance(given, UploadFile):
                file = stored.path.with_name("given.json")
                file.write_bytes(await given.read())
                wanted = Rectify(wanted.find, file, wanted.undo, wanted.save)
            return await picture(desk, stored, wanted, remove=True)
        except BaseException:
            desk.store.remove(stored)
            raise


async def estimate(request: Request) -> Response:
    """``POST /api/estimate``: multipart form -> the motion as JSON."""
    desk = desk_of(request)
    async with _form(request) as form:
        wanted = read(_texts(form))
        stored = await _stored(desk, form)
    try:
        return await motion(desk, stored, wanted)
    finally:
        desk.store.remove(stored)


async def picture(desk: Desk, stored: Stored, wanted: Rectify, remove: bool) -> Response:
    """The rectified photo as a file, as the command line would write it.

    Args:
        desk: of the server.
        stored: the photo.
        wanted: what is to be done to it.
        remove: whether the photo is closed when its answer was sent.
    """
    name = result_name(stored, wanted.save.format)
    target = stored.path.with_name(f"result-{secrets.token_hex(6)}{PurePosixPath(name).suffix}")

    def sent() -> None:
        target.unlink(missing_ok=True)
        if remove:
            desk.store.remove(stored)

    outcome = await desk.lanes.do(Urgency.NOW, work.saved, desk.held(stored), target, wanted)
    raise_if_failed(outcome, stored)
    headers = {"unshutter-result": told_header(outcome_told(outcome)), "unshutter-name": told_header(name)}
    return FileResponse(target, filename=name, headers=headers, background=BackgroundTask(sent))


async def motion(desk: Desk, stored: Stored, wanted: Wanted) -> Response:
    """The photo's motion as JSON, as ``unshutter estimate`` writes it."""
    reference = wanted.undo.reference or "first"
    text = await desk.lanes.do(Urgency.NOW, work.estimated, desk.held(stored), wanted.find, reference)
    name = f"{PurePosixPath(stored.name).stem}.json"
    return Response(text, media_type="application/json", headers={"unshutter-name": told_header(name)})


def result_name(stored: Stored, format: str | None) -> str:
    """What the result of a photo is called, as on the command line: ``street.rectified.jpg``.

    Raises:
        UsageError: the photo's name does not tell its format.
    """
    name = PurePosixPath(stored.name)
    if of_suffix(name.suffix) is None and format is None:
        raise UsageError(f"the name '{name}' does not say the picture's format: choose one for the result")
    return picture_name(name, format)  # pyright: ignore[reportArgumentType]


def raise_if_failed(outcome: Outcome, stored: Stored) -> None:
    """Raises UsageError or UnshutterError for an outcome with an error."""
    if outcome.error:
        line = work.without_path(outcome.error, stored.path)
        raise (UsageError if outcome.usage else UnshutterError)(line)


def outcome_told(outcome: Outcome) -> dict:
    """What is told of a picture beside it."""
    verdict = outcome.verdict.as_json() if outcome.verdict else {}
    return {**verdict, **({"note": outcome.note} if outcome.note else {})}


@asynccontextmanager
async def _form(request: Request) -> AsyncIterator[FormData]:
    if not request.headers.get("content-type", "").startswith("multipart/form-data"):
        raise UsageError("send a form (multipart/form-data) with the photo as the part 'photo'")
    async with request.form(max_files=2, max_fields=_MOST_FIELDS, max_part_size=_MOST_TEXT) as form:
        yield form


def _texts(form: FormData) -> dict[str, str]:
    return {name: value for name, value in form.items() if isinstance(value, str)}


async def _stored(desk: Desk, form: FormData) -> Stored:
    given = form.get("photo")
    if not isinstance(given, UploadFile):
        raise UsageError("the photo is missing: send it as the part 'photo', with a file name")

    async def pieces() -> AsyncIterator[bytes]:
        while piece := await given.read(_PIECE):
            yield piece

    return await desk.store.add(given.filename or "photo", pieces())
