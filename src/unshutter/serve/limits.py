"""Limits on the size of requests and on the time that the server waits for them."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

_CLOSE = {"connection": "close"}  # the rest of the body will not be read
_OVERHEAD = 1_000_000  # bytes of a request in addition to its file
_HEADERS_S = 10.0  # from the connection, or the first bytes of a request, to the end of its headers


class Limits:
    """ASGI middleware that rejects bodies that are too large (413) or arrive too slowly (408).

    Args:
        app: the wrapped application.
        most_bytes: returns the largest file size for a path [bytes].
        patience_s: longest wait for the next piece of a body, and time before its speed is checked [s].
        least_rate: lowest speed of a body [bytes/s].
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
        received, began, finished = 0, time.monotonic(), False

        async def watched() -> Message:
            nonlocal received, finished
            if finished:  # waits for the connection to end, however long that takes
                return await receive()
            if declared.isdigit() and int(declared) > most + _OVERHEAD:
                raise _too_large(most)
            try:
                message = await asyncio.wait_for(receive(), self._patience_s)
            except TimeoutError:
                raise _too_slow() from None
            received += len(message.get("body", b""))
            finished = not message.get("more_body", False)
            if received > most + _OVERHEAD:
                raise _too_large(most)
            elapsed_s = time.monotonic() - began
            if not finished and elapsed_s > self._patience_s and received < self._least_rate * elapsed_s:
                raise _too_slow()
            return message

        return watched


class Connection(H11Protocol):
    """HTTP connection that closes if no request arrives; uvicorn's own would wait for headers indefinitely."""

    def __init__(self, *arguments: Any, **options: Any):
        super().__init__(*arguments, **options)
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """See asyncio.Protocol."""
        super().connection_made(transport)
        self._expect_headers()

    def data_received(self, data: bytes) -> None:
        """See asyncio.Protocol."""
        if self._deadline is None and (self.cycle is None or self.cycle.response_complete):
            self._expect_headers()
        super().data_received(data)
        if self.cycle is not None and not self.cycle.response_complete:
            self._forget()

    def connection_lost(self, exc: Exception | None) -> None:
        """See asyncio.Protocol."""
        self._forget()
        super().connection_lost(exc)

    def _expect_headers(self) -> None:
        self._deadline = asyncio.get_running_loop().call_later(_HEADERS_S, self._give_up)

    def _give_up(self) -> None:
        self._deadline = None
        if self.transport is not None and (self.cycle is None or self.cycle.response_complete):
            self.transport.close()

    def _forget(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


def _too_large(most: int) -> HTTPException:
    return HTTPException(413, f"the file has more than {most / 1e6:g} MB, the limit set by --max-mb", _CLOSE)


def _too_slow() -> HTTPException:
    return HTTPException(408, "the file came too slowly, and was given up", _CLOSE)
