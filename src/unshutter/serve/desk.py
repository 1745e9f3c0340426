"""What all requests share: the open photos and clips, the lanes that work on them, the settings."""

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
_MOST_FILES, _ROOM = 1000, 10  # files that may be open; their bytes, in times of the largest photo and clip
_MOST_WAITING, _TIMEOUT_S, _REST_S = 48, 600.0, 120.0
_MOST_CLIPS, _CLIP_TIMEOUT_S, _CLIP_REST_S = 8, 86_400.0, 5.0  # of whole clips


@dataclass
class Desk:
    """The state of the server.

    Attributes:
        settings: of the user.
        store: the open photos and clips.
        lanes: who works on photos, and shows moments of clips.
        long_lanes: who makes whole clips: one at a time, with all processors.
    """

    settings: Settings
    store: Store
    lanes: Lanes
    long_lanes: Lanes

    @classmethod
    def open(cls, settings: Settings, folder: Path) -> Desk:
        """A desk with nothing on it; ``folder`` is for its files."""
        store = Store(
            folder, _MOST_FILES, _ROOM * max(settings.max_bytes, settings.max_clip_bytes), settings.max_pixels
        )
        lanes = Lanes(LANES, _TIMEOUT_S, _MOST_WAITING, _REST_S)
        return cls(settings, store, lanes, Lanes(1, _CLIP_TIMEOUT_S, _MOST_CLIPS, _CLIP_REST_S))

    def close(self) -> None:
        """Ends all processes."""
        self.lanes.close()
        self.long_lanes.close()

    def photo_path(self, id: str) -> Path:
        """The file of an open photo, which an option names.

        Raises:
            Missing: it is not open.
            UsageError: it is a clip.
        """
        open_file = self.store.get(id)
        if open_file.kind != "photo":
            raise UsageError(f"{open_file.name} is a clip: the photos before and after a photo are photos, too")
        return open_file.path


def desk_of(request: Request) -> Desk:
    """The server's desk."""
    return request.app.state.desk
