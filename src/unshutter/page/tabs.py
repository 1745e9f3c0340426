"""Browser tabs that show the page: they keep the server running, and receive files to open.

While a browser shows the page, one of its tabs holds a request open (web/tab.js), which ends however that tab ends.
Only seconds during which the server ran are counted: a laptop may sleep while a browser starts.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.page.instance import KEY, forget_link, write_link

if TYPE_CHECKING:
    from unshutter.page.settings import Settings

ALIVE_S = 15.0  # between keep-alive messages


@dataclass
class Tabs:
    """The tabs that show the page, and how long the server waits for one [s]."""

    folder: Path  # private folder for the files that lead the browser to the page
    link: str  # link of the page
    key: str  # secret of this user's programs, which may ask for a tab with files
    opening_s: float = 120.0  # a browser may take this long to start
    closed_s: float = 10.0  # a page that is loaded again was closed before
    tick_s: float = 0.25
    _files: dict[str, Sequence[Path]] = field(default_factory=dict, init=False)  # by id of the tab
    _held: int = field(default=0, init=False)  # number of requests that are held open
    _ended: asyncio.Event = field(default_factory=asyncio.Event, init=False)

    def __post_init__(self) -> None:
        self._left_s = self.opening_s

    @property
    def are_closed(self) -> bool:
        """Whether no tab is open or expected."""
        return not self._held and self._left_s <= 0

    def expect(self, id: str, files: Sequence[Path] = ()) -> Path:
        """Expects a tab, to be opened with files (absolute paths); returns the file that leads the browser to it."""
        self._files[id] = files
        self._left_s = self.opening_s
        return write_link(self.folder, id, f"{self.link}&open={id}")

    def arrived(self, id: str) -> Sequence[Path]:
        """Notes that a tab is there, and returns the files to open in it; empty if it is not known."""
        if id in self._files:
            forget_link(self.folder, id)
            self._left_s = self.closed_s
        return self._files.get(id, ())

    async def held(self) -> AsyncIterator[str]:
        """Yields keep-alive messages to a browser that shows the page, until either ends."""
        self._held += 1
        self._left_s = self.closed_s
        try:
            while not self._ended.is_set():
                yield ": unshutter is running\n\n"
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._ended.wait(), ALIVE_S)
        finally:
            self._held -= 1

    async def tick(self) -> None:
        """Waits for a moment, which counts if no tab is open."""
        await asyncio.sleep(self.tick_s)
        if not self._held:
            self._left_s -= self.tick_s

    def end(self) -> None:
        """Ends the requests that are held open, and removes files that no browser followed."""
        self._ended.set()
        for id in self._files:
            forget_link(self.folder, id)


def tab_routes(tabs: Tabs, settings: Settings) -> list[Route]:
    """Lists the addresses at which tabs are asked for, held open, and get their files."""
    tab = "/api/tabs/{id}"
    return [
        Route("/api/tabs", partial(_hold, tabs=tabs)),
        Route(tab, partial(_expect, tabs=tabs), methods=["POST"]),
        Route(f"{tab}/files", partial(_files, tabs=tabs)),
        Route(f"{tab}/files/{{number:int}}", partial(_file, tabs=tabs, settings=settings)),
    ]


async def _hold(request: Request, tabs: Tabs) -> Response:
    return StreamingResponse(tabs.held(), media_type="text/event-stream")


async def _expect(request: Request, tabs: Tabs) -> Response:
    """Expects a tab with files, whose paths are the body: only for programs of the user, never for the page itself."""
    if not secrets.compare_digest(request.headers.get(KEY, "").encode(), tabs.key.encode()):
        raise HTTPException(403, "only `unshutter open` may name files")
    tabs.expect(request.path_params["id"], [Path(name) for name in await request.json()])
    return Response(status_code=204)


async def _files(request: Request, tabs: Tabs) -> Response:
    """The names of the files with which the tab was opened."""
    return JSONResponse([path.name for path in tabs.arrived(request.path_params["id"])])


async def _file(request: Request, tabs: Tabs, settings: Settings) -> Response:
    """One of these files."""
    files = tabs.arrived(request.path_params["id"])
    number = request.path_params["number"]
    if number >= len(files) or not files[number].is_file():
        raise HTTPException(404, "this file is not there any more")
    path = files[number]
    most = settings.max_clip_bytes if PurePath(path.name).suffix.lower() in VIDEO_FORMATS else settings.max_bytes
    if path.stat().st_size > most:
        raise HTTPException(413, f"it has more than {most / 1e6:g} MB")
    return FileResponse(path)
