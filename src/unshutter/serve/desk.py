"""State shared by all requests: the open photos and clips, the worker processes, and the settings."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from starlette.requests import Request

from unshutter.errors import UsageError
from unshutter.serve.lanes import Lanes
from unshutter.serve.settings import Settings
from unshutter.serve.store import Store

LANES = min(max(os.cpu_count() or 1, 2), 4)
_MOST_FILES, _ROOM = 1000, 10  # open files at most; their total size, as a multiple of the largest file allowed
_MOST_WAITING, _TIMEOUT_S, _REST_S = 48, 600.0, 120.0
_MOST_CLIPS, _CLIP_TIMEOUT_S, _CLIP_REST_S = 8, 86_400.0, 5.0  # for whole clips


@dataclass
class Desk:
    """The server's shared state.

    Attributes:
        settings: the user's settings.
        store: the open photos and clips.
        lanes: workers for photos and for single moments of clips.
        long_lanes: worker for whole clips, one at a time, using all processors.
    """

    settings: Settings
    store: Store
    lanes: Lanes
    long_lanes: Lanes

    @classmethod
    def open(cls, settings: Settings, folder: Path) -> Desk:
        """Creates the state with no open files; ``folder`` is where they will be stored."""
        store = Store(
            folder, _MOST_FILES, _ROOM * max(settings.max_bytes, settings.max_clip_bytes), settings.max_pixels
        )
        lanes = Lanes(LANES, _TIMEOUT_S, _MOST_WAITING, _REST_S)
        return cls(settings, store, lanes, Lanes(1, _CLIP_TIMEOUT_S, _MOST_CLIPS, _CLIP_REST_S))

    def close(self) -> None:
        """Stops all workers."""
        self.lanes.close()
        self.long_lanes.close()

    def photo_path(self, id: str) -> Path:
        """Returns the path of the open photo with this id.

        Raises:
            Missing: the file is not open.
            UsageError: the file is a clip.
        """
        open_file = self.store.get(id)
        if open_file.kind != "photo":
            raise UsageError(f"{open_file.name} is a clip: the photos before and after a photo are photos, too")
        return open_file.path


def desk_of(request: Request) -> Desk:
    """Returns the server's shared state."""
    return request.app.state.desk
