"""Bodies that are too large, or too slow."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator

import httpx
import pytest

from support.page_server import TOKEN, Asking, desk
from unshutter.page.app import application
from unshutter.page.settings import Settings
from unshutter.page.store import ServerState

KNOWN = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture
def small() -> Iterator[ServerState]:
    with desk(Settings(token=TOKEN, max_mb=2)) as one:
        yield one


async def _pieces() -> AsyncIterator[bytes]:
    for _ in range(40):
        yield bytes(100_000)


@pytest.mark.parametrize("body", [bytes(4_000_000), _pieces], ids=["declared", "undeclared"])
def test_a_body_that_is_too_large(small: ServerState, body: bytes | Callable[[], AsyncIterator[bytes]]) -> None:
    client = Asking(application(small, TOKEN, 80))
    answer = client.post("/api/photos", headers=KNOWN, content=body if isinstance(body, bytes) else body())
    assert answer.status_code == 413
    assert "more than 2 MB" in answer.json()["error"]
    assert not list(small.store.folder.glob("*/photo*"))


@pytest.mark.parametrize("pause_s", [0.02, 5.0])
def test_a_body_that_dribbles(small: ServerState, pause_s: float) -> None:
    """By single bytes, or with long pauses: given up, and nothing of it stays."""

    async def dribble():
        for _ in range(100):
            yield b"x"
            await asyncio.sleep(pause_s)

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(application(small, TOKEN, 80, patience_s=0.2))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await asyncio.wait_for(client.post("/api/photos", headers=KNOWN, content=dribble()), 4)

    answer = asyncio.run(ask())
    assert answer.status_code == 408
    assert answer.headers["connection"] == "close"
    assert not list(small.store.folder.glob("*/photo*"))


def test_room_for_so_many_photos_and_bytes(small: ServerState) -> None:
    small.store.most_files, small.store.most_bytes = 2, 1_000
    client = Asking(application(small, TOKEN, 80))
    answers = [client.post("/api/photos", headers=KNOWN, content=b"x") for _ in range(3)]
    assert [answer.status_code for answer in answers] == [201, 201, 413]
    client.request("DELETE", f"/api/photos/{answers[0].json()['id']}", headers=KNOWN)
    answer = client.post("/api/photos", headers=KNOWN, content=bytes(1_000))
    assert answer.status_code == 413 and "close some" in answer.json()["error"]
    assert client.post("/api/photos", headers=KNOWN, content=bytes(999)).status_code == 201
