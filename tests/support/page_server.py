"""`unshutter serve` in a process of its own, as users start it."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import quote
from zipfile import ZipFile

import httpx
from starlette.types import ASGIApp

from support.installed import install
from unshutter.cli import main
from unshutter.page.settings import Settings
from unshutter.page.store import ServerState, temporary_folder

TOKEN = "test-token"
LONG_S = 60  # for what takes a moment, unless others work beside the tests
TESTS = Path(__file__).parent.parent


@dataclass
class Server:
    """A running server.

    Attributes:
        process: its process.
        url: of its page, without the token.
    """

    process: subprocess.Popen
    url: str

    @property
    def port(self) -> int:
        return int(self.url.rpartition(":")[2])

    @property
    def link(self) -> str:
        return f"{self.url}/?token={TOKEN}"

    def client(self, **more) -> httpx.Client:
        headers = {"Authorization": f"Bearer {TOKEN}"}
        quick = {"timeout": 60, "verify": False}  # certificates, of which http needs none, take 20 ms to load
        return httpx.Client(base_url=self.url, headers=headers, **quick, **more)

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(LONG_S)


@contextmanager
def served(home: Path, *arguments: object, port: int = 0, token: str | None = TOKEN) -> Iterator[Server]:
    """A server that knows the estimators `crashing` and `hanging`; its temporary folder lies in ``home``."""
    with start(home, "--port", port, *(("--token", token) if token else ()), *arguments) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert "http://" in line, line + process.stdout.read()
            yield Server(process, line.split()[1].partition("/?")[0])
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
            process.wait(LONG_S)


def start(home: Path, *arguments: object, **environment: str) -> subprocess.Popen:
    """The command, with all its output in one stream."""
    home.mkdir(exist_ok=True)
    package = home / "package"
    if not package.exists():
        package.mkdir()
        brought = {name: f"support.crashing_estimator:{name.upper()}" for name in ("crashing", "hanging")}
        install(package, "broken", brought)
    path = os.pathsep.join([str(TESTS), str(package), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.Popen(
        [sys.executable, "-m", "unshutter", "serve", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONPATH": path, "TMPDIR": str(home)} | environment,
    )


def run_command(*arguments: object) -> None:
    """The command line, in this process: conftest.py has NumPy multiply on one thread, as the command does."""
    assert main([*map(str, arguments)]) == 0


@contextmanager
def desk(settings: Settings | None = None) -> Iterator[ServerState]:
    """A desk in this process; its lanes start their processes when they are used."""
    with temporary_folder() as folder:
        made = ServerState.open(settings or Settings(token=TOKEN), folder)
        try:
            yield made
        finally:
            made.close()


def temporary_folders(home: Path) -> list[Path]:
    return sorted(home.glob("unshutter-serve-*"))


class Asking:
    """Asks an ASGI application in this process, one request after the other.

    Args:
        app: the application.
        base_url: by which it is called.
    """

    def __init__(self, app: ASGIApp, base_url: str = "http://127.0.0.1"):
        self._app, self._base_url = app, base_url

    def request(self, method: str, path: str, **more: Any) -> httpx.Response:
        async def asked() -> httpx.Response:
            transport = httpx.ASGITransport(self._app)
            async with httpx.AsyncClient(transport=transport, base_url=self._base_url) as client:
                return await client.request(method, path, **more)

        return asyncio.run(asked())

    def get(self, path: str, **more: Any) -> httpx.Response:
        return self.request("GET", path, **more)

    def post(self, path: str, **more: Any) -> httpx.Response:
        return self.request("POST", path, **more)


def rss(pid: int) -> int:
    """Resident memory [bytes] of a process and those that it started."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    own = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS"))
    return 1024 * int(own.split()[1]) + sum(rss(int(child)) for child in children)


def becomes(true: Callable[[], bool], within_s: float = LONG_S) -> bool:
    deadline = time.monotonic() + within_s
    while not true() and time.monotonic() < deadline:
        time.sleep(0.02)
    return true()


def sent(client: httpx.Client, name: str, data: bytes, kind: str = "photos") -> str:
    """Opens a photo or clip; returns its id."""
    answer = client.post(f"/api/{kind}", content=data, headers={"Unshutter-Name": quote(name)})
    assert answer.status_code == 201
    return answer.json()["id"]


def opened(client: httpx.Client, path: Path, kind: str = "photos") -> str:
    return sent(client, path.name, path.read_bytes(), kind)


def facts(answer: httpx.Response) -> dict[str, Any]:
    """What the header of a picture says about it."""
    assert answer.status_code == 200, answer.text
    return json.loads(answer.headers["unshutter-result"])


def saving(client: httpx.Client, items: list[dict[str, Any]], to: str = "zip", **more: object) -> str:
    """Begins to save photos and clips; returns the id of the task."""
    answer = client.post("/api/saves", json={"to": to, "photos": items, **more})
    assert answer.status_code == 202
    return answer.json()["id"]


def zipped(client: httpx.Client, items: list[dict[str, Any]], **more: object) -> tuple[list[dict], ZipFile]:
    """Saves photos and clips; returns what is told of each, and the zip file."""
    id = saving(client, items, **more)
    told = list(events(client, id))[-1]
    assert told["state"] == "finished", told
    return told["done"], ZipFile(BytesIO(client.get(f"/api/saves/{id}/file").content))


def events(client: httpx.Client, id: str) -> Iterator[dict[str, Any]]:
    """How far a saving is, again and again until its end."""
    with client.stream("GET", f"/api/saves/{id}/events") as stream:
        yield from (json.loads(line[6:]) for line in stream.iter_lines() if line.startswith("data: "))
