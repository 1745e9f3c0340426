"""Access control: checks the Host, Origin and access token of each request.

Any website can make a browser send requests to 127.0.0.1. Three checks keep them out: the Host must be one of ours
(which rules out DNS rebinding), the Origin must be the page's own, and the API requires the access token, which other
sites cannot read.
"""

from __future__ import annotations

import ipaddress
import secrets
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from unshutter.serve.settings import LOCAL_HOSTS

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


class Guard:
    """ASGI middleware that rejects unauthorised requests and adds security headers to every response.

    Args:
        app: the wrapped application.
        token: access token that the API requires.
        port: port that the server listens on.
        host: host that the server listens on; if it is not local, any IP address is accepted as the Host, too.
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
        origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
        is_api = scope["path"].startswith("/api/")
        if (origin is not None and origin != f"http://{host}") or (is_api and site not in ("none", "same-origin")):
            return _denial(403, "only unshutter's own page may ask this")
        if is_api and not secrets.compare_digest(_token_of(headers, scope).encode(), self._token):
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
        return self._host not in LOCAL_HOSTS and _is_address(name)


def _is_address(name: str) -> bool:
    """Returns whether a host is an IP address, which cannot be rebound as a DNS name can."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _token_of(headers: Headers, scope: Scope) -> str:
    kind, _, word = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer":
        return word.strip()
    return parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]


def _denial(status: int, reason: str) -> JSONResponse:
    return JSONResponse({"error": reason}, status, headers={"connection": "close"})
