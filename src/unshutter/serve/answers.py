"""Builds HTTP responses: pictures with metadata in a header, motions, files and one-line errors."""

from __future__ import annotations

import json
import os
import secrets
import sys
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

from starlette.background import BackgroundTask
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response

from unshutter.errors import UnknownRatioError, UnshutterError, UsageError, visible
from unshutter.options import Rectify
from unshutter.serve.desk import Desk
from unshutter.serve.fields import ByHand, PhotoOptions
from unshutter.serve.jobs import photo as photo_jobs
from unshutter.serve.lanes import Busy, Urgency
from unshutter.serve.names import motion_name, photo_result
from unshutter.serve.store import Full, Missing, OpenFile

# HTTP status for each type of error; the first matching type wins.
_STATUSES: dict[type[Exception], int] = {UsageError: 400, Missing: 404, Full: 413, Busy: 503, UnshutterError: 422}
_HEADERS: dict[int, dict[str, str]] = {503: {"retry-after": "1"}}


def header_text(value: Any) -> str:
    """Encodes a value as ASCII JSON for use in a header."""
    return json.dumps(value, separators=(",", ":"))


def jpeg_answer(jpeg: bytes, facts: dict[str, Any]) -> Response:
    """Returns a JPEG for the screen, with facts about it in a header."""
    return Response(jpeg, media_type="image/jpeg", headers={"unshutter-result": header_text(facts)})


async def picture_answer(
    desk: Desk, open_file: OpenFile, options: Rectify, hand: ByHand, closing: Sequence[OpenFile] = ()
) -> Response:
    """Returns the rectified photo as a file, exactly as the command line would write it.

    Args:
        desk: the server's shared state.
        open_file: the photo.
        options: the photo's options.
        hand: lines drawn and numbers set by hand.
        closing: photos to close once the response has been sent.
    """
    name = photo_result(open_file.name, options.save.format)
    target = open_file.path.with_name(f"result-{secrets.token_hex(6)}{PurePosixPath(name).suffix}")

    def clean_up() -> None:
        target.unlink(missing_ok=True)
        for each in closing:
            desk.store.remove(each)

    facts = await desk.lanes.do(Urgency.NOW, photo_jobs.saved, open_file, target, options, hand)
    headers = {"unshutter-result": header_text(facts), "unshutter-name": header_text(name)}
    return FileResponse(target, filename=name, headers=headers, background=BackgroundTask(clean_up))


async def motion_answer(desk: Desk, open_file: OpenFile, options: PhotoOptions, candidates: bool = False) -> Response:
    """Returns the photo's motion as JSON, in the format of ``unshutter estimate``.

    Args:
        desk: the server's shared state.
        open_file: the photo.
        options: how to estimate the motion.
        candidates: whether to list all motions that fit, as with ``--candidates``.

    Raises:
        UsageError: the options name neighbours, or cannot be combined with a list.
    """
    if options.rectify.neighbours:
        raise UsageError("neighbours show more than the motion of the camera: leave them out to get a motion")
    if candidates:
        if options.hand or options.find.camera.candidate is not None:
            raise UsageError("'candidates' lists all motions that fit: leave out 'candidate' and what is by hand")
        text = await desk.lanes.do(Urgency.NOW, photo_jobs.estimated_candidates, open_file, options.rectify)
    else:
        text = await desk.lanes.do(Urgency.NOW, photo_jobs.estimated, open_file, options.rectify, options.hand)
    headers = {"unshutter-name": header_text(motion_name(open_file.name))}
    return Response(text, media_type="application/json", headers=headers)


async def refusal(request: Request, error: Exception) -> Response:
    """Returns the response to a failed request: an HTTP status and ``{"error": one line}``."""
    if isinstance(error, HTTPException):
        return _refusal(error.detail, error.status_code, error.headers)
    if isinstance(error, UnshutterError):
        status = next(status for kind, status in _STATUSES.items() if isinstance(error, kind))
        about = error.reason.as_json() if isinstance(error, UnknownRatioError) else {}
        reason = {name: about[name] for name in ("code", "figures") if name in about}
        return JSONResponse({"error": str(error), **reason}, status, _HEADERS.get(status))
    if isinstance(error, OSError):  # for example, a full disc
        return _refusal(error.strerror or "the system refuses", 500)
    if os.environ.get("UNSHUTTER_DEBUG"):
        raise error
    print(f"unshutter: unexpected {type(error).__name__} (UNSHUTTER_DEBUG=1 shows more)", file=sys.stderr)
    return _refusal(f"unexpected {type(error).__name__}: please report it", 500)


def _refusal(line: str, status: int, headers: Mapping[str, str] | None = None) -> Response:
    return JSONResponse({"error": visible(line)}, status, headers)
