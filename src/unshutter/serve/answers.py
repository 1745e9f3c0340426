"""How answers are put: facts beside a picture, and refusals in one line."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from unshutter.errors import UnshutterError, UsageError, visible
from unshutter.serve.lanes import Busy
from unshutter.serve.store import Full, Missing


def told_header(told: Any) -> str:
    """Facts for a header, as JSON in ASCII."""
    return json.dumps(told, separators=(",", ":"))


async def refused(request: Request, error: Exception) -> Response:
    """The answer to a request that came to nothing: its status, and ``{"error": one line}``."""
    if isinstance(error, HTTPException):
        return _refusal(error.detail, error.status_code, error.headers)
    if isinstance(error, Busy):
        return _refusal(str(error), 503, {"retry-after": "1"})
    if isinstance(error, UnshutterError):
        return _refusal(str(error), _status_of(error))
    if isinstance(error, OSError):  # a full disc, say
        return _refusal(error.strerror or "the system refuses", 500)
    if os.environ.get("UNSHUTTER_DEBUG"):
        raise error
    print(f"unshutter: unexpected {type(error).__name__} (UNSHUTTER_DEBUG=1 shows more)", file=sys.stderr)
    return _refusal(f"unexpected {type(error).__name__}: please report it", 500)


def _refusal(line: str, status: int, headers: Mapping[str, str] | None = None) -> Response:
    return JSONResponse({"error": visible(line)}, status, headers)


def _status_of(error: UnshutterError) -> int:
    if isinstance(error, UsageError):
        return 400
    return {Missing: 404, Full: 413}.get(type(error), 422)
