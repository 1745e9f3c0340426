"""For programs: a photo with its options in one request, and the result in the answer."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from pathlib import PurePosixPath

from starlette.background import BackgroundTask
from starlette.datastructures import FormData, UploadFile
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from unshutter.batch.job import Outcome
from unshutter.errors import UnshutterError, UsageError
from unshutter.options import Rectify
from unshutter.serve import work
from unshutter.serve.answers import told_header
from unshutter.serve.desk import Desk, desk_of
from unshutter.serve.fields import Wanted, read
from unshutter.serve.held import without_path
from unshutter.serve.incoming import form_of, stored_of, texts_of
from unshutter.serve.lanes import Urgency
from unshutter.serve.names import motion_name, photo_result
from unshutter.serve.store import Stored


async def rectify(request: Request) -> Response:
    """``POST /api/rectify``: multipart form -> the picture."""
    desk = desk_of(request)
    async with form_of(request) as form, stored_of(desk, form, "photo", "before", "after", keep=True) as stored:
        wanted = read(_options(form, stored), desk.photo_path).rectify
        given = form.get("motion")
        if isinstance(given, UploadFile):
            file = stored["photo"].path.with_name("given.json")
            file.write_bytes(await given.read())
            wanted = Rectify(wanted.find, file, wanted.undo, wanted.save, wanted.neighbours)
        return await picture(desk, stored["photo"], wanted, tuple(stored.values()))


async def estimate(request: Request) -> Response:
    """``POST /api/estimate``: multipart form -> the motion as JSON."""
    desk = desk_of(request)
    async with form_of(request) as form, stored_of(desk, form, "photo") as stored:
        return await motion(desk, stored["photo"], read(_options(form, stored), desk.photo_path))


async def picture(desk: Desk, stored: Stored, wanted: Rectify, closing: Sequence[Stored] = ()) -> Response:
    """The rectified photo as a file, as the command line would write it.

    Args:
        desk: of the server.
        stored: the photo.
        wanted: what is to be done to it.
        closing: photos that are closed when the answer was sent.
    """
    name = photo_result(stored.name, wanted.save.format)
    target = stored.path.with_name(f"result-{secrets.token_hex(6)}{PurePosixPath(name).suffix}")

    def sent() -> None:
        target.unlink(missing_ok=True)
        for each in closing:
            desk.store.remove(each)

    outcome = await desk.lanes.do(Urgency.NOW, work.saved, desk.held(stored), target, wanted)
    raise_if_failed(outcome, stored)
    headers = {"unshutter-result": told_header(outcome_told(outcome)), "unshutter-name": told_header(name)}
    return FileResponse(target, filename=name, headers=headers, background=BackgroundTask(sent))


async def motion(desk: Desk, stored: Stored, wanted: Wanted) -> Response:
    """The photo's motion as JSON, as ``unshutter estimate`` writes it."""
    if wanted.rectify.neighbours:
        raise UsageError("what is found from neighbours is no motion of the camera alone: leave them out")
    reference = wanted.undo.reference or "first"
    text = await desk.lanes.do(Urgency.NOW, work.estimated, desk.held(stored), wanted.find, reference)
    headers = {"unshutter-name": told_header(motion_name(stored.name))}
    return Response(text, media_type="application/json", headers=headers)


def raise_if_failed(outcome: Outcome, stored: Stored) -> None:
    """Raises UsageError or UnshutterError for an outcome with an error."""
    if outcome.error:
        line = without_path(outcome.error, stored.path)
        raise (UsageError if outcome.usage else UnshutterError)(line)


def outcome_told(outcome: Outcome) -> dict:
    """What is told of a picture beside it."""
    verdict = outcome.verdict.as_json() if outcome.verdict else {}
    return {**verdict, **({"note": outcome.note} if outcome.note else {})}


def _options(form: FormData, stored: dict[str, Stored]) -> dict[str, str]:
    """The form's options; photos of this form go by their ids."""
    return texts_of(form) | {name: one.id for name, one in stored.items() if name != "photo"}
