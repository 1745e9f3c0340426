"""The ASGI application: the server's addresses and their request handlers."""

from __future__ import annotations

import asyncio
from pathlib import Path

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from unshutter import installation
from unshutter.errors import UnshutterError
from unshutter.serve.answers import refusal
from unshutter.serve.api import clips, photos, saves
from unshutter.serve.desk import Desk, desk_of
from unshutter.serve.guard import Guard
from unshutter.serve.jobs.photo import warm
from unshutter.serve.lanes import Urgency
from unshutter.serve.limits import Limits
from unshutter.serve.openapi import description
from unshutter.serve.requests import clips_can_be_opened
from unshutter.serve.savings import Savings
from unshutter.serve.schemas import page_module
from unshutter.version import __version__

PAGE = Path(__file__).parent / "page"
_PATIENCE_S, _LEAST_RATE = 10.0, 20_000.0  # for request bodies: seconds without a byte, bytes per second
_CLIP_PATHS = ("/api/clips", "/api/video")


def application(desk: Desk, token: str, port: int, patience_s: float = _PATIENCE_S) -> ASGIApp:
    """Builds the ASGI application for the whole server.

    Args:
        desk: the state shared by all requests.
        token: access token.
        port: port that the server listens on.
        patience_s: see :class:`Limits`.
    """
    settings = desk.settings

    def most_bytes(path: str) -> int:
        return settings.max_clip_bytes if path in _CLIP_PATHS else settings.max_bytes

    limits = Middleware(Limits, most_bytes, patience_s, _LEAST_RATE)
    kinds = (HTTPException, UnshutterError, OSError, Exception)
    app = Starlette(routes=routes(), middleware=[limits], exception_handlers=dict.fromkeys(kinds, refusal))
    app.state.desk, app.state.savings = desk, Savings(desk)
    return Guard(app, token, port, settings.host)


def routes() -> list[Route]:
    """Lists all routes: the page's files, the public API, and the addresses that only the page uses."""
    photo, clip, save = "/api/photos/{id}", "/api/clips/{id}", "/api/saves/{id}"
    return [
        Route("/", _page),
        *_files(),
        Route("/api/openapi.json", _openapi),
        Route("/api/about", _about),
        Route("/api/wake", _wake, methods=["POST"]),
        Route("/api/rectify", photos.rectify, methods=["POST"]),
        Route("/api/estimate", photos.estimate, methods=["POST"]),
        Route("/api/photos", photos.add, methods=["POST"]),
        Route(photo, photos.remove, methods=["DELETE"]),
        Route(f"{photo}/before", photos.before),
        Route(f"{photo}/after", photos.after),
        Route(f"{photo}/candidates", photos.candidates),
        Route(f"{photo}/segments", photos.segments),
        Route(f"{photo}/picture", photos.picture),
        Route(f"{photo}/motion", photos.motion),
        Route("/api/video", clips.video, methods=["POST"]),
        Route("/api/clips", clips.add, methods=["POST"]),
        Route(clip, clips.remove, methods=["DELETE"]),
        Route(f"{clip}/before", clips.before),
        Route(f"{clip}/after", clips.after),
        Route(f"{clip}/film", clips.film),
        Route(f"{clip}/readout", clips.readout),
        Route("/api/saves", saves.start, methods=["POST"]),
        Route(f"{save}/events", saves.events),
        Route(save, saves.cancel, methods=["DELETE"]),
        Route(f"{save}/file", saves.download),
    ]


def _files() -> list[Route]:
    """Lists routes for the page's files; subfolders and paths outside their folder are not served."""
    served = StaticFiles(directory=PAGE)

    async def file(request: Request) -> Response:
        return await served.get_response(request.path_params["name"], request.scope)

    return [Route("/page/options.js", _options), Route("/page/{name}", file)]


async def _page(request: Request) -> Response:
    return FileResponse(PAGE / "index.html")


async def _options(request: Request) -> Response:
    return Response(page_module(), media_type="text/javascript")


async def _openapi(request: Request) -> Response:
    return JSONResponse(description(routes()))


async def _about(request: Request) -> Response:
    """``GET /api/about``: version, largest photo and clip [bytes], folder to save to, and how to get clips."""
    settings = desk_of(request).settings
    folder = str(settings.folder) if settings.folder is not None else None
    limits = {"max_bytes": settings.max_bytes, "max_clip_bytes": settings.max_clip_bytes}
    clips = {"clips": clips_can_be_opened(), "install_clips": installation.extra("video")}
    return JSONResponse({"version": __version__, "folder": folder, **clips, **limits})


async def _wake(request: Request) -> Response:
    """``POST /api/wake``: loads the libraries that the first photo needs.

    Warms up two workers: one to show the photo, the other to estimate its motion.
    """
    lanes = desk_of(request).lanes
    await asyncio.gather(*(lanes.do(Urgency.NOW, warm) for _ in range(2)))
    return Response(status_code=204)
