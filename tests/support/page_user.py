"""Somebody who opens the page, with a browser that only keeps the links that it is told to open."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from support.page_server import LONG_S, becomes
from unshutter.page.instance import RunningPage, described_page

BROWSER = """#!/bin/sh
file=${1#file://}
/bin/cp "$file" "${file%.html}.seen"
echo "LD_LIBRARY_PATH=$LD_LIBRARY_PATH" > "${0%/*}/environment"
echo "$1" >> "${0%/*}/opened"
"""


@dataclass
class User:
    """A user.

    Attributes:
        home: their folder, which has all that the page needs.
        program: how they start the program.
        others: variables of the environment that the program gets, besides its own.
    """

    home: Path
    program: Sequence[str] = (sys.executable, "-m", "unshutter", "open")
    others: dict[str, str] = field(default_factory=lambda: dict(os.environ))

    @property
    def folder(self) -> Path:
        """Where the running page describes itself."""
        return self.home / "unshutter"

    @property
    def browser(self) -> Path:
        return self.home / "browser"

    @property
    def environment(self) -> dict[str, str]:
        home = str(self.home)
        return self.others | {"XDG_RUNTIME_DIR": home, "TMPDIR": home, "HOME": home, "BROWSER": str(self.browser)}

    def open(self, *arguments: object, **more: str) -> subprocess.CompletedProcess[str]:
        """Starts the program with files, or other words, and waits for its end."""
        return self.run(*self.program, *arguments, **more)

    def run(self, *words: object, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(word) for word in words],
            env=self.environment | more,
            capture_output=True,
            text=True,
            timeout=2 * LONG_S,
            check=False,
        )

    @property
    def links(self) -> list[str]:
        """What the browser was led to, so far."""
        opened = self.home / "opened"
        files = opened.read_text().split() if opened.exists() else []
        pages = [Path(file.removeprefix("file://")).with_suffix(".seen").read_text() for file in files]
        return [page.partition("url=")[2].partition('"')[0] for page in pages]

    @property
    def tabs(self) -> list[str]:
        """The ids of the tabs that the browser was led to."""
        return [link.partition("&open=")[2] for link in self.links]

    @property
    def page(self) -> RunningPage:
        page = described_page(self.folder)
        assert page is not None
        return page

    def client(self) -> httpx.Client:
        headers = {"Authorization": f"Bearer {self.page.token}"}
        return httpx.Client(
            base_url=f"http://127.0.0.1:{self.page.port}", headers=headers, verify=False, timeout=LONG_S
        )


@contextmanager
def user_in(home: Path, **more) -> Iterator[User]:
    """A user whose page, if it still runs, is ended afterwards."""
    home.mkdir(mode=0o700)
    user = User(home, **more)
    user.browser.write_text(BROWSER)
    user.browser.chmod(0o755)
    yield user
    page = described_page(user.folder)
    if page is not None:
        with suppress(ProcessLookupError):
            os.kill(page.pid, signal.SIGTERM)
        assert becomes(lambda: not alive(page.pid))


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended, but whose parent has not asked for its end, does not."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False
