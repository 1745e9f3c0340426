"""Settings of ``unshutter serve``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from unshutter.errors import UnshutterError, UsageError
from unshutter.options import MAX_PIXELS, option

DEFAULT_PORT = 8720
LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")
_TOKEN = re.compile(r"[A-Za-z0-9_-]{8,200}")
_MOST_MB = 100_000
_PHOTO_MB, _CLIP_MB = 400, 4000  # one minute of 4K video from a phone takes about 400 MB


@dataclass(frozen=True)
class Settings:
    """How the page is served.

    Attributes:
        port: port to listen on; 0 picks a free port.
        open: whether to open the page in the browser.
        folder: folder to which the page may save, or None to allow downloads only.
        max_mb: largest photo or clip [MB], or None for the default of each.
        max_pixels: largest photo allowed [px].
        token: access token for the page, or None for a random one.
        host: address to listen on.
        i_know: whether the user accepts that others can reach an address that is not local.

    Raises:
        UsageError: a number or token is invalid, or others can reach the host and ``i_know`` is not set.
        UnshutterError: the folder does not exist.
    """

    port: int = option(DEFAULT_PORT, f"Port to listen on; 0 picks a free one. Default: {DEFAULT_PORT}.")
    open: bool = option(False, "Open the page in the browser.")
    folder: Path | None = option(None, "Folder that the page may save to. Default: downloads only.", names="output")
    max_mb: int | None = option(
        None, f"Refuse photos and clips above this size, in megabytes. Default: {_PHOTO_MB}; clips {_CLIP_MB}."
    )
    max_pixels: int = option(MAX_PIXELS, "Refuse photos with more pixels. Default: 1 000 000 000.")
    token: str | None = option(
        None,
        "Access token for browsers and programs, at least 8 letters and digits. Default: a new one every time.",
        names="word",
    )
    host: str = option("127.0.0.1", "Address to listen on. Default: 127.0.0.1, this machine only.", names="word")
    i_know: bool = option(
        False, "With --host: I know that everyone who reaches this address and sees the link can use the page."
    )

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65_535:
            raise UsageError(f"--port must lie between 0 and 65535, got {self.port}")
        if self.max_mb is not None and not 1 <= self.max_mb <= _MOST_MB:
            raise UsageError(f"--max-mb must lie between 1 and {_MOST_MB}, got {self.max_mb}")
        if self.max_pixels < 1:
            raise UsageError(f"--max-pixels must be at least 1, got {self.max_pixels}")
        if self.token is not None and not _TOKEN.fullmatch(self.token):
            raise UsageError("--token needs at least 8 characters, of letters, digits, - and _ only")
        if not self.is_local and not self.i_know:
            raise UsageError(
                f"--host {self.host} lets other machines use the page, and the photos travel there unencrypted: "
                "add --i-know if that is what you want"
            )
        if self.folder is not None and not self.folder.is_dir():
            raise UnshutterError(f"there is no folder {self.folder}: make it first, or name another with --folder")

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach the page."""
        return self.host in LOCAL_HOSTS

    @property
    def max_bytes(self) -> int:
        """Largest photo [bytes]."""
        return (self.max_mb or _PHOTO_MB) * 1_000_000

    @property
    def max_clip_bytes(self) -> int:
        """Largest clip [bytes]."""
        return (self.max_mb or _CLIP_MB) * 1_000_000
