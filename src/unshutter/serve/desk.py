"""What all requests share: the open photos, the lanes that work on them, and what the page was told at its start."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from starlette.requests import Request

from unshutter.serve.held import Held
from unshutter.serve.lanes import Lanes
from unshutter.serve.settings import Settings
from unshutter.serve.store import Store, Stored

LANES = min(max(os.cpu_count() or 1, 2), 4)
_MOST_PHOTOS, _ROOM = 1000, 10  # photos that may be open; their bytes, in times of the largest allowed
_MOST_WAITING, _TIMEOUT_S, _REST_S = 48, 600.0, 120.0


@dataclass
class Desk:
    """The state of the server.

    Attributes:
        settings: of the user.
        store: the open photos.
        lanes: who works on them.
    """

    settings: Settings
    store: Store
    lanes: Lanes

    @classmethod
    def made(cls, settings: Settings, folder: Path) -> Desk:
        """A desk with nothing on it; ``folder`` is for its photos."""
        store = Store(folder, _MOST_PHOTOS, _ROOM * settings.max_bytes)
        return cls(settings, store, Lanes(LANES, _TIMEOUT_S, _MOST_WAITING, _REST_S))

    def path(self, id: str) -> Path:
        """The file of an open photo; Missing where it is not open."""
        return self.store.get(id).path

    def held(self, stored: Stored) -> Held:
        """A photo as lanes take it."""
        return Held(stored.path, self.settings.max_pixels)


def desk_of(request: Request) -> Desk:
    """The server's desk."""
    return request.app.state.desk
