"""The page that runs already: where a second start finds it, and leaves the files that a tab is to open.

All of it lies in a folder that only its user can read. The running server holds the lock there, however it ends, and a
second start asks it for a proof: neither an old file nor another user's program on the same port is taken for it.
"""

from __future__ import annotations

import http.client
import json
import os
import re
import secrets
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from unshutter.errors import UnshutterError
from unshutter.storage.files import NEVER_FOLLOW, lock, written_whole

_LOCK = "lock"
_PAGE = "page.json"
_ID = re.compile(r"[A-Za-z0-9_-]{8,40}")
_PATIENCE_S = 5.0  # for the answer of a running page


@dataclass(frozen=True)
class RunningPage:
    """A server that runs, as it describes itself to the next start."""

    port: int
    token: str
    proof: str
    pid: int

    def announce(self, id: str) -> bool:
        """Tells the server that a tab is about to be opened; returns whether it is this server that answers."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=_PATIENCE_S)
        with suppress(OSError, http.client.HTTPException, ValueError, AttributeError):
            try:
                connection.request(
                    "POST", f"/api/tabs/{id}?opening=1", headers={"Authorization": f"Bearer {self.token}"}
                )
                answer = json.loads(connection.getresponse().read())
                return secrets.compare_digest(str(answer.get("proof")).encode(), self.proof.encode())
            finally:
                connection.close()
        return False

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
    for file in (folder / _PAGE, *folder.glob("open-*.json")):
        with suppress(OSError):
            file.unlink(missing_ok=True)
            forget_link(folder, file.stem.removeprefix("open-"))


def publish(folder: Path, page: RunningPage) -> None:
    """Describes this process to the next start."""
    with written_whole(folder / _PAGE) as part:
        part.write_text(json.dumps(asdict(page)), encoding="utf-8")


def described_page(folder: Path) -> RunningPage | None:
    """Returns the page that is said to run, whether or not it does."""
    with suppress(OSError, ValueError, TypeError):
        page = RunningPage(**json.loads((folder / _PAGE).read_text(encoding="utf-8")))
        return page if isinstance(page.port, int) and isinstance(page.token, str) else None
    return None


# ---- tabs that are about to be opened ----------------------------------------------------------------------------


def leave_files(folder: Path, id: str, files: Sequence[Path]) -> None:
    """Leaves the files (absolute paths) that a tab is to open, for the server."""
    with written_whole(folder / f"open-{id}.json") as part:
        part.write_text(json.dumps([str(path) for path in files]), encoding="utf-8")


def files_for(folder: Path | None, id: str) -> list[Path]:
    """Returns the files with which a tab was opened; empty if there are none."""
    if folder is None or not _ID.fullmatch(id):
        return []
    with suppress(OSError, ValueError):
        return [Path(name) for name in json.loads((folder / f"open-{id}.json").read_text(encoding="utf-8"))]
    return []


def write_link(folder: Path, id: str, link: str) -> Path:
    """Writes a file that leads the browser to the page: other users could read the token on its command line."""
    file = _link_file(folder, id)
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as stream:
        stream.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={link}"><title>unshutter</title>')
    return file


def forget_link(folder: Path | None, id: str) -> None:
    """Removes the file that led the browser to a tab, which is there now."""
    if folder is not None and _ID.fullmatch(id):
        with suppress(OSError):
            _link_file(folder, id).unlink(missing_ok=True)


def _link_file(folder: Path, id: str) -> Path:
    if Path("/snap/bin").is_dir():  # a browser in a snap sees neither hidden folders nor /tmp
        return Path.home() / f"unshutter-{id}.html"
    return folder / f"open-{id}.html"
