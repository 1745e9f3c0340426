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

import uvicorn.server

from unshutter.errors import UnshutterError
from unshutter.page.app import application
from unshutter.page.guard import Connection
from unshutter.page.instance import RunningPage, described_page, only_page, publish, state_folder
from unshutter.page.launch import open_page
from unshutter.page.settings import Settings
from unshutter.page.store import ServerState, temporary_folder
from unshutter.page.tabs import Tabs
from unshutter.progress import tell

_MOST_CONNECTIONS = 100


def serve(settings: Settings) -> int:
    """Serves the page until asked to stop, and returns the exit code."""
    if not settings.until_closed:
        return _serve(settings)
    home = state_folder()
    with only_page(home) as is_ours:
        if is_ours:
            return _serve(settings, home)
    page = described_page(home)
    tell(f"unshutter: the page runs already{f', as process {page.pid}' if page else ''}")
    return open_page([]) if settings.open else 0


def _serve(settings: Settings, home: Path | None = None) -> int:
    """Serves the page; with a folder, as the one that ``unshutter open`` finds, and until its last tab is closed."""
    token = settings.token or secrets.token_urlsafe(18)
    logging.getLogger("uvicorn").setLevel(logging.CRITICAL)  # nobody needs a log of requests
    with _listening(settings.host, settings.port) as listener, temporary_folder() as folder:
        port = listener.getsockname()[1]
        host = f"[{settings.host}]" if ":" in settings.host else settings.host
        tabs = Tabs(home or folder, f"http://{host}:{port}/?token={token}", secrets.token_urlsafe(18))
        state = ServerState.open(settings, folder)
        config = uvicorn.Config(
            application(state, token, port, tabs),
            log_config=None,
            access_log=False,
            server_header=False,
            lifespan="off",
            ws="none",
            http=Connection,
            limit_concurrency=_MOST_CONNECTIONS,
            timeout_graceful_shutdown=2,
        )
        hangup = getattr(signal, "SIGHUP", None)  # not available on Windows
        if hangup is not None and signal.getsignal(hangup) not in (None, signal.SIG_IGN):
            uvicorn.server.HANDLED_SIGNALS += (hangup,)  # it stops the server as SIGTERM does
        server = uvicorn.Server(config)
        if home is not None:
            publish(home, RunningPage(port, token, tabs.key, os.getpid()))
        print(f"unshutter: {tabs.link}\nunshutter: open this link in a browser; Ctrl-C ends the page", flush=True)
        if settings.open:
            tab = tabs.expect(secrets.token_urlsafe(9))
            threading.Thread(target=webbrowser.open, args=[tab.as_uri()], daemon=True).start()
        try:
            asyncio.run(_until_asked_to_stop(server, listener, tabs, settings.until_closed))
        finally:
            state.close()
    return 0


async def _until_asked_to_stop(server: uvicorn.Server, listener: socket.socket, tabs: Tabs, until_closed: bool) -> None:
    async def watch() -> None:
        while not server.should_exit:
            await tabs.tick()
            server.should_exit |= until_closed and tabs.are_closed
        tabs.end()

    watching = asyncio.create_task(watch())
    await server.serve(sockets=[listener])
    await watching


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
