"""Opens files on the page in a browser, and starts the page if it is not running."""

from __future__ import annotations

import secrets
import subprocess
import sys
import time
import webbrowser
from collections.abc import Iterable, Sequence
from pathlib import Path

from unshutter.errors import MissingFileError, UnshutterError
from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.options.picture_formats import SUFFIXES
from unshutter.page.instance import RunningPage, described_page, state_folder
from unshutter.progress import tell
from unshutter.storage.files import check_plain

# flags on Windows of a process that a closed terminal does not end
_ON_ITS_OWN = subprocess.DETACHED_PROCESS | subprocess.CREATE_NEW_PROCESS_GROUP if sys.platform == "win32" else 0


def open_page(paths: Iterable[Path]) -> int:
    """Opens the page with photos, clips and folders of them; returns the exit code."""
    files = [file for path in paths for file in _files_at(path)]
    folder = state_folder()
    id = secrets.token_urlsafe(9)
    page = described_page(folder)
    tab = page and page.new_tab(folder, id, files)
    if page is None or tab is None:
        page, tab = _started_page(folder, id, files)
    if not webbrowser.open(tab.as_uri()):
        tell(f"no browser was found: open {page.link(id)}")
        return 1
    return 0


def _files_at(path: Path) -> list[Path]:
    """Returns the file, or the photos and clips of a folder; raises UnshutterError if there are none."""
    check_plain(path)
    if path.is_dir():
        known = {*SUFFIXES, *VIDEO_FORMATS}
        named = [file for file in sorted(path.rglob("*")) if file.suffix.lower() in known and file.is_file()]
        shown = (file for file in named if not any(part.startswith(".") for part in file.relative_to(path).parts))
        files = [file.absolute() for file in shown]
        if not files:
            raise UnshutterError("there are no photos or clips in {folder}", folder=path)
        return files
    if not path.is_file():
        raise MissingFileError("there is no file {file}", file=path)
    if not path.stat().st_size:
        raise UnshutterError("{file} is empty (0 bytes)", file=path)
    return [path.absolute()]


def _started_page(folder: Path, id: str, files: Sequence[Path]) -> tuple[RunningPage, Path]:
    """Starts a server that outlives this process; returns it, and its tab with files, once it answers."""
    program = [sys.executable] if getattr(sys, "frozen", False) else [sys.executable, "-m", "unshutter"]
    log = folder / "page.log"
    with log.open("w", encoding="utf-8") as errors:
        process = subprocess.Popen(
            [*program, "serve", "--until-closed", "--port", "0"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            cwd=folder,  # so that no disc is kept from being unmounted
            creationflags=_ON_ITS_OWN,
            start_new_session=True,  # where these flags do not exist
        )
    deadline = time.monotonic() + 60  # a slow disc may need seconds to load the program
    while time.monotonic() < deadline:
        page = described_page(folder)
        tab = page and page.new_tab(folder, id, files)
        if page is not None and tab is not None:
            return page, tab
        if process.poll():  # 0: another start was faster, and its page is about to answer
            break
        time.sleep(0.05)
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    raise UnshutterError(lines[-1].removeprefix("unshutter: ") if lines else "the page did not start in time")
