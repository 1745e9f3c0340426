"""Starts and stops the web server of ``unshutter serve``."""

from __future__ import annotations

import asyncio
import logging
import os
import secrets
import signal
import socket
import threading
import webbrowser
from pathlib import Path
from typing import Any

from unshutter import errors
from unshutter.errors import UnshutterError
from unshutter.page.settings import Settings
from unshutter.page.store import Desk, temporary_folder

_MOST_CONNECTIONS = 100
_WAIT_S = 2  # grace period for open responses at shutdown


def serve(settings: Settings) -> int:
    """Serves the page until asked to stop, and returns the exit code."""
    try:
        import uvicorn.server

        from unshutter.page.app import application
        from unshutter.page.guard import Connection
    except ImportError as error:
        raise UnshutterError(f"the page needs the extra: {errors.extra('web')} ({error})") from None

    token = settings.token or secrets.token_urlsafe(18)
    logging.getLogger("uvicorn").setLevel(logging.CRITICAL)  # nobody needs a log of requests
    with _listening(settings.host, settings.port) as listener, temporary_folder() as folder:
        port = listener.getsockname()[1]
        desk = Desk.open(settings, folder)
        options: dict[str, Any] = {
            "log_config": None,
            "access_log": False,
            "server_header": False,
            "lifespan": "off",
            "ws": "none",
            "http": Connection,
            "limit_concurrency": _MOST_CONNECTIONS,
            "timeout_graceful_shutdown": _WAIT_S,
        }
        hangup = getattr(signal, "SIGHUP", None)  # not available on Windows
        if hangup is not None and signal.getsignal(hangup) not in (None, signal.SIG_IGN):
            uvicorn.server.HANDLED_SIGNALS += (hangup,)  # it stops the server as SIGTERM does
        server = uvicorn.Server(uvicorn.Config(application(desk, token, port), **options))
        _announce(settings, port, token, folder)
        try:
            asyncio.run(server.serve(sockets=[listener]))
        finally:
            desk.close()
    return 0


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        reason = " ".join((error.strerror or str(error)).split())
        raise UnshutterError(
            f"cannot listen on {host}, port {port}: {reason}; {{--port}} 0 takes a free port"
        ) from None
    listener.listen(_MOST_CONNECTIONS)
    return listener


def _announce(settings: Settings, port: int, token: str, folder: Path) -> None:
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    link = f"http://{host}:{port}/?token={token}"
    print(f"unshutter: {link}\nunshutter: open this link in a browser; Ctrl-C ends the page", flush=True)
    if settings.open:
        # other users see a browser's command line, which must not contain the token
        redirection = folder / "open.html"
        with open(os.open(redirection, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={link}"><title>unshutter</title>')
        threading.Thread(target=webbrowser.open, args=[redirection.as_uri()], daemon=True).start()
