"""How much a request may bring, and how slowly."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_CLOSE = {"connection": "close"}  # what is left of the body will not be read
_BESIDE = 1_000_000  # bytes of a request beside its file


class Limits:
    """ASGI: refuses bodies that are too large (413) or come too slowly (408).

    Args:
        app: behind it.
        most_bytes: of the file that a path takes.
        patience_s: longest wait for the next piece of a body, and time before its speed counts [s].
        least_rate: speed of a body [bytes/s].
    """

    def __init__(self, app: ASGIApp, most_bytes: Callable[[str], int], patience_s: float, least_rate: float):
        self._app, self._most_bytes = app, most_bytes
        self._patience_s, self._least_rate = patience_s, least_rate

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] == "http":
            most = self._most_bytes(scope["path"])
            receive = self._watched(Headers(scope=scope).get("content-length", ""), most, receive)
        await self._app(scope, receive, send)

    def _watched(self, declared: str, most: int, receive: Receive) -> Receive:
        seen, began, finished = 0, time.monotonic(), False

        async def watched() -> Message:
            nonlocal seen, finished
            if finished:  # waits for the end of the connection, however long that takes
                return await receive()
            if declared.isdigit() and int(declared) > most + _BESIDE:
                raise _too_large(most)
            try:
                message = await asyncio.wait_for(receive(), self._patience_s)
            except TimeoutError:
                raise _too_slow() from None
            seen += len(message.get("body", b""))
            finished = not message.get("more_body", False)
            if seen > most + _BESIDE:
                raise _too_large(most)
            took_s = time.monotonic() - began
            if not finished and took_s > self._patience_s and seen < self._least_rate * took_s:
                raise _too_slow()
            return message

        return watched


def _too_large(most: int) -> HTTPException:
    return HTTPException(413, f"the file has more than {most / 1e6:g} MB, the limit set by --max-mb", _CLOSE)


def _too_slow() -> HTTPException:
    return HTTPException(408, "the file came too slowly, and was given up", _CLOSE)
