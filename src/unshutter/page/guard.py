"""Middleware that rejects requests from other sites and strangers, and bodies that are too large or too slow.

Websites can make a browser send requests to 127.0.0.1. Three checks keep them out: the Host must be one of ours
(which rules out DNS rebinding), the Origin must be the page's own, and the API requires the access token, which other
sites cannot read.
"""

from __future__ import annotations

import asyncio
import ipaddress
import secrets
import time
from contextlib import suppress

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from unshutter.page.settings import LOCAL_HOSTS, Settings

_CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; media-src blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "content-security-policy": _CONTENT_POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}
_CLOSE = {"connection": "close"}  # the rest of the body will not be read
_LEAST_RATE = 20_000.0  # lowest speed of a body [bytes/s]
_HEADERS_S = 10.0  # from the connection to the end of its first request's headers


class Guard:
    """ASGI middleware that rejects unauthorised requests and adds security headers to every response.

    If the server listens on a host that is not local, any IP address is accepted as the Host, too.
    """

    def __init__(self, app: ASGIApp, token: str, port: int, host: str):
        self._app, self._token, self._port, self._host = app, token.encode(), port, host

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refusal = self._refusal(scope)
        await (refusal or self._app)(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> JSONResponse | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._is_ours(host):
            return _denial(403, "this is not the name of this server: open the link that `unshutter serve` printed")
        origin = headers.get("origin")
        site = headers.get("sec-fetch-site", "none")
        is_api = scope["path"].startswith("/api/")
        if (origin is not None and origin != f"http://{host}") or (is_api and site not in ("none", "same-origin")):
            return _denial(403, "only unshutter's own page may send this request")
        kind, _, token = headers.get("authorization", "").partition(" ")
        is_known = kind.lower() == "bearer" and secrets.compare_digest(token.strip().encode(), self._token)
        if is_api and not is_known:
            return _denial(401, "the token is missing or wrong: open the link that `unshutter serve` printed")
        return None

    def _is_ours(self, host: str) -> bool:
        name, _, port = host.rpartition(":")
        if port != str(self._port):  # browsers omit port 80, and only that one
            if self._port != 80 or (":" in host and not host.endswith("]")):
                return False
            name = host
        name = name.strip("[]").lower()
        if name in LOCAL_HOSTS or name == self._host.lower():
            return True
        return self._host not in LOCAL_HOSTS and _is_address(name)  # which cannot be rebound as a DNS name can


def _is_address(name: str) -> bool:
    with suppress(ValueError):
        return bool(ipaddress.ip_address(name))
    return False


def _denial(status: int, reason: str) -> JSONResponse:
    return JSONResponse({"error": reason}, status, headers=_CLOSE)


class Limits:
    """ASGI middleware that rejects bodies that are too large (413) or arrive too slowly (408).

    ``patience_s`` is the longest wait for the next piece of a body, and the time before its speed is checked.
    """

    def __init__(self, app: ASGIApp, settings: Settings, patience_s: float):
        self._app = app
        self._settings = settings
        self._patience_s = patience_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] == "http":
            most = self._settings.max_clip_bytes if scope["path"] == "/api/clips" else self._settings.max_bytes
            receive = self._watched(Headers(scope=scope).get("content-length", ""), most, receive)
        await self._app(scope, receive, send)

    def _watched(self, declared: str, most: int, receive: Receive) -> Receive:
        received = 0
        began = time.monotonic()
        finished = False

        async def watched() -> Message:
            nonlocal received, finished
            if finished:  # waits for the connection to end, however long that takes
                return await receive()
            if declared.isdigit() and int(declared) > most:
                raise _too_large(most)
            try:
                message = await asyncio.wait_for(receive(), self._patience_s)
            except TimeoutError:
                raise _too_slow() from None
            received += len(message.get("body", b""))
            finished = not message.get("more_body", False)
            if received > most:
                raise _too_large(most)
            elapsed_s = time.monotonic() - began
            if not finished and elapsed_s > self._patience_s and received < _LEAST_RATE * elapsed_s:
                raise _too_slow()
            return message

        return watched


class Connection(H11Protocol):
    """HTTP connection that closes if no request arrives, sooner if its place is needed; uvicorn's own would wait."""

    def connection_made(self, transport: asyncio.Transport) -> None:
        """See asyncio.Protocol."""
        super().connection_made(transport)
        loop = asyncio.get_running_loop()
        self._made_s = loop.time()
        loop.call_later(_HEADERS_S, lambda: self.cycle or self.transport.close())
        if self.limit_concurrency is not None and len(self.connections) >= self.limit_concurrency:
            idle = [each for each in self.connections if isinstance(each, Connection) and each.is_idle]
            for oldest in sorted(idle, key=lambda each: each._made_s)[:1]:  # so that silent ones keep nobody out
                oldest.transport.close()
                self.connections.discard(oldest)

    @property
    def is_idle(self) -> bool:
        """Whether no request has arrived that was not answered yet."""
        return self.cycle is None or self.cycle.response_complete


def _too_large(most: int) -> HTTPException:
    return HTTPException(413, f"the file has more than {most / 1e6:g} MB, the limit set by --max-mb", _CLOSE)


def _too_slow() -> HTTPException:
    return HTTPException(408, "the file arrived too slowly: the upload was cancelled", _CLOSE)
