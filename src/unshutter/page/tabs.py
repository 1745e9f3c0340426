"""The browser's tabs that show the page: the server may end with the last of them, and they get files to open.

Browsers slow down the timers of hidden tabs, and stop those of frozen ones. Therefore a tab that falls silent counts as
open for an hour, and a tab reports that it is closed. Only seconds during which the server ran are counted: after a
laptop has slept, its tabs are still open.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.page.instance import files_for, forget_link

if TYPE_CHECKING:
    from unshutter.page.settings import Settings


@dataclass
class Tabs:
    """The tabs that show the page, and how long each counts as open without another word from it [s]."""

    home: Path | None = None  # folder of the running page; None: it is not the one that `unshutter open` finds
    proof: str = ""  # what shows `unshutter open` that it found this server, and not another program
    opening_s: float = 120.0  # a browser may take this long to start
    silent_s: float = 3600.0
    closed_s: float = 10.0  # a page that is loaded again was closed before
    tick_s: float = 1.0
    _left_s: dict[str, float] = field(default_factory=dict, init=False)
    _closed: set[str] = field(default_factory=set, init=False)

    def __post_init__(self) -> None:
        self._left_s[""] = self.opening_s  # the first tab, unless it never comes

    def announce(self, id: str) -> None:
        """Counts a tab as open while its browser starts."""
        self._left_s[id] = self.opening_s

    def report(self, id: str, again: bool = False) -> None:
        """Counts a tab as open; one that was closed only if it says that it is shown again.

        A tab's last report may arrive after the news that it was closed.
        """
        if id in self._closed and not again:
            return
        self._closed.discard(id)
        self._left_s.pop("", None)
        self._left_s[id] = self.silent_s
        forget_link(self.home, id)

    def close(self, id: str) -> None:
        """Notes that a tab was closed, or is loading the page again."""
        self._closed.add(id)
        self._left_s.pop("", None)
        self._left_s[id] = self.closed_s

    async def wait_until_closed(self) -> None:
        """Returns once no tab is open."""
        while self._left_s:
            await asyncio.sleep(self.tick_s)
            self._left_s = {id: left - self.tick_s for id, left in self._left_s.items() if left > self.tick_s}


def tab_routes(tabs: Tabs, settings: Settings) -> list[Route]:
    """Lists the addresses at which tabs report, and get the files with which they were opened."""
    tab = "/api/tabs/{id}"
    return [
        Route(tab, partial(_report, tabs=tabs), methods=["POST"]),
        Route(tab, partial(_close, tabs=tabs), methods=["DELETE"]),
        Route(f"{tab}/files", partial(_files, tabs=tabs)),
        Route(f"{tab}/files/{{number:int}}", partial(_file, tabs=tabs, settings=settings)),
    ]


async def _report(request: Request, tabs: Tabs) -> Response:
    id = request.path_params["id"]
    if request.query_params.get("opening") == "1":
        tabs.announce(id)
    else:
        tabs.report(id, request.query_params.get("again") == "1")
    return JSONResponse({"proof": tabs.proof})


async def _close(request: Request, tabs: Tabs) -> Response:
    tabs.close(request.path_params["id"])
    return Response(status_code=204)


async def _files(request: Request, tabs: Tabs) -> Response:
    """The names of the files with which the tab was opened."""
    return JSONResponse([path.name for path in files_for(tabs.home, request.path_params["id"])])


async def _file(request: Request, tabs: Tabs, settings: Settings) -> Response:
    """One of these files."""
    files = files_for(tabs.home, request.path_params["id"])
    number = request.path_params["number"]
    if number >= len(files) or not files[number].is_file():
        raise HTTPException(404, "this file is not there any more")
    path = files[number]
    most = settings.max_clip_bytes if PurePath(path.name).suffix.lower() in VIDEO_FORMATS else settings.max_bytes
    if path.stat().st_size > most:
        raise HTTPException(413, f"it has more than {most / 1e6:g} MB")
    return FileResponse(path)
