"""Lets a second start find the running page, and leads browsers to it.

All of it lies in a folder that only its user can read. The running server holds the lock there, however it ends. A
second start asks it to write a link there: neither an old file nor another program on the same port is taken for it.
"""

from __future__ import annotations

import http.client
import json
import os
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from unshutter.errors import UnshutterError
from unshutter.storage.files import NEVER_FOLLOW, lock, written_whole

KEY = "unshutter-key"  # header of a request for a tab
_LOCK = "lock"
_PAGE = "page.json"


@dataclass(frozen=True)
class RunningPage:
    """A server that runs, as it describes itself to the next start."""

    port: int
    token: str
    key: str
    pid: int

    def new_tab(self, folder: Path, id: str, files: Sequence[Path]) -> Path | None:
        """Asks the server for a tab with files (absolute paths).

        Returns:
            The file in its folder that leads the browser to the tab; None if it is not this server that answers, since
            only it could write there.
        """
        headers = {"Authorization": f"Bearer {self.token}", KEY: self.key}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)
        with suppress(OSError, http.client.HTTPException), closing(connection):
            connection.request("POST", f"/api/tabs/{id}", json.dumps([str(path) for path in files]), headers)
            connection.getresponse().read()
        file = _link_file(folder, id)
        return file if file.is_file() else None

    def link(self, id: str) -> str:
        """Returns the link of a tab."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}&open={id}"


def state_folder() -> Path:
    """Returns the folder of the running page, created if missing; raises UnshutterError if others could use it."""
    folder = _parent() / "unshutter"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
    except OSError as error:
        raise UnshutterError(f"cannot create the folder {folder}: {error.strerror}") from None
    if sys.platform != "win32":  # where the user's folders are private by themselves
        own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
        if not own or status.st_mode & 0o077:
            raise UnshutterError(f"other users could read or replace {folder}: remove it, or make it yours (chmod 700)")
    return folder


def _parent() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support"
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    with suppress(OSError):
        if os.path.isabs(runtime) and os.stat(runtime).st_uid == os.getuid():
            return Path(runtime)
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")


@contextmanager
def only_page(folder: Path) -> Iterator[bool]:
    """Claims the folder for this process until the block ends; yields whether no other one has claimed it."""
    descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | NEVER_FOLLOW, 0o600)
    is_ours = False
    try:
        is_ours = lock(descriptor) is not False
        if is_ours:
            _clear(folder)  # after a page that was killed
        yield is_ours
    finally:
        if is_ours:
            _clear(folder)
        os.close(descriptor)


def _clear(folder: Path) -> None:
    links = _link_file(folder, "*")
    for file in (folder / _PAGE, *links.parent.glob(links.name)):
        with suppress(OSError):
            file.unlink(missing_ok=True)


def publish(folder: Path, page: RunningPage) -> None:
    """Describes this process to the next start."""
    with written_whole(folder / _PAGE) as part:
        part.write_text(json.dumps(asdict(page)), encoding="utf-8")


def described_page(folder: Path) -> RunningPage | None:
    """Returns the page that the file describes, whether or not it still runs."""
    with suppress(OSError, ValueError, TypeError):
        page = RunningPage(**json.loads((folder / _PAGE).read_text(encoding="utf-8")))
        return page if isinstance(page.port, int) and isinstance(page.token, str) else None
    return None


# ---- files that lead the browser to the page -----------------------------------------------------------------------


def write_link(folder: Path, id: str, link: str) -> Path:
    """Writes a file that leads the browser to the page: other users could read the token on its command line."""
    file = _link_file(folder, id)
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as stream:
        stream.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={link}"><title>unshutter</title>')
    return file


def forget_link(folder: Path, id: str) -> None:
    """Removes the file that led the browser to a tab."""
    with suppress(OSError):
        _link_file(folder, id).unlink(missing_ok=True)


def _link_file(folder: Path, id: str) -> Path:
    if Path("/snap/bin").is_dir():  # a browser in a snap sees neither hidden folders nor /tmp
        return Path.home() / f"unshutter-tab-{id}.html"
    return folder / f"open-{id}.html"
