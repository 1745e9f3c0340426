"""How much a request may bring, and how slowly."""

from __future__ import annotations

import asyncio
import time

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_CLOSE = {"connection": "close"}  # what is left of the body will not be read
_BESIDE = 1_000_000  # bytes of a request beside its photo


class Limits:
    """ASGI: refuses bodies that are too large (413) or come too slowly (408).

    Args:
        app: behind it.
        most_bytes: of a photo.
        patience_s: longest wait for the next piece of a body, and time before its speed counts [s].
        least_rate: speed of a body [bytes/s].
    """

    def __init__(self, app: ASGIApp, most_bytes: int, patience_s: float, least_rate: float):
        self._app, self._most = app, most_bytes + _BESIDE
        self._patience_s, self._least_rate = patience_s, least_rate

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] == "http":
            receive = self._watched(Headers(scope=scope).get("content-length", ""), receive)
        await self._app(scope, receive, send)

    def _watched(self, declared: str, receive: Receive) -> Receive:
        seen, began, finished = 0, time.monotonic(), False

        async def watched() -> Message:
            nonlocal seen, finished
            if finished:  # waits for the end of the connection, however long that takes
                return await receive()
            if declared.isdigit() and int(declared) > self._most:
                raise self._too_large()
            try:
                message = await asyncio.wait_for(receive(), self._patience_s)
            except TimeoutError:
                raise _too_slow() from None
            seen += len(message.get("body", b""))
            finished = not message.get("more_body", False)
            if seen > self._most:
                raise self._too_large()
            took_s = time.monotonic() - began
            if not finished and took_s > self._patience_s and seen < self._least_rate * took_s:
                raise _too_slow()
            return message

        return watched

    def _too_large(self) -> HTTPException:
        most = (self._most - _BESIDE) / 1e6
        return HTTPException(413, f"the photo has more than {most:g} MB, the limit set by --max-mb", _CLOSE)


def _too_slow() -> HTTPException:
    return HTTPException(408, "the photo came too slowly, and was given up", _CLOSE)
