"""The server as a process: what it bears."""

import asyncio
import json
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
import uvicorn
from starlette.types import Receive, Send

from support.page_server import becomes, opened, rss, served, temporary_folders
from unshutter.page import guard

MB = 1_000_000


def _picture(client: httpx.Client, name: str, content: bytes, **options: str) -> httpx.Response:
    """The answer to the first request that is refused, or the rectified photo."""
    answer = client.post("/api/photos", content=content, headers={"Unshutter-Name": name})
    if answer.status_code != 201:
        return answer
    return client.get(f"/api/photos/{answer.json()['id']}/picture", params=options)


@pytest.mark.parametrize("name", ["../../evil.jpg", "/tmp/evil.jpg", "..%2f..%2fevil.jpg", "a\\..\\evil.jpg"])
def test_names_lead_nowhere(client: httpx.Client, photo: Path, name: str) -> None:
    answer, bad = (_picture(client, name, content) for content in (photo.read_bytes(), b"no photo"))
    assert answer.status_code == 200
    assert "/" not in json.loads(answer.headers["unshutter-name"])
    assert bad.status_code == 422
    assert "unshutter-serve-" not in bad.json()["error"] and "\n" not in bad.json()["error"]


@pytest.mark.parametrize("id", ["../x", "%2e%2e", "x" * 5000, "0"])
def test_ids_lead_nowhere(client: httpx.Client, id: str) -> None:
    assert client.get(f"/api/photos/{id}/before").status_code == 404


def test_requests_that_are_refused(client: httpx.Client, photo: Path) -> None:
    asked = {
        "unknown field": _picture(client, "a.jpg", photo.read_bytes(), colour="red"),
        "is empty": _picture(client, "a.jpg", b""),
    }
    for told, answer in asked.items():
        assert answer.status_code in (400, 422) and told in answer.json()["error"], answer.text


def test_large_photos_are_refused_as_on_the_command_line(tmp_path: Path, photo: Path) -> None:
    with served(tmp_path / "home", "--max-pixels", 10_000) as server, server.client() as client:
        answer = _picture(client, "large.jpg", photo.read_bytes())
        assert answer.status_code == 422
        assert "more than the limit of 0.01 megapixels" in answer.json()["error"]


def test_a_crash_is_survived(client: httpx.Client, photo: Path) -> None:
    id = opened(client, photo)
    crashed = client.get(f"/api/photos/{id}/after", params={"estimator": "crashing"})
    assert crashed.status_code == 422
    assert crashed.json()["error"] == "its worker died: not enough memory, or a fault in a decoder"
    assert client.get(f"/api/photos/{id}/after").status_code == 200


@pytest.mark.thorough
def test_a_hundred_requests_at_once(tmp_path: Path, photo: Path) -> None:
    """Some are done, the others told to come again; memory stays bounded, and then all is as before."""
    data = photo.read_bytes() + bytes(2 * MB)  # what follows a JPEG's end is nobody's
    with served(tmp_path / "home") as server, server.client() as client:
        assert client.post("/api/wake").status_code == 204
        before = rss(server.process.pid)

        def ask(_: int) -> int:
            try:
                with server.client() as own:
                    return _picture(own, "a.jpg", data, estimator="none").status_code
            except httpx.HTTPError:  # refused before all of it was sent
                return 503

        with ThreadPoolExecutor(100) as threads:
            answers = [threads.submit(ask, k) for k in range(100)]
            most = before
            while not all(answer.done() for answer in answers):
                most = max(most, rss(server.process.pid))
                time.sleep(0.05)
        codes = [answer.result() for answer in answers]
        assert set(codes) <= {200, 503}
        assert codes.count(200) >= 20 and codes.count(503) >= 20
        assert most - before < 400 * MB
        assert _picture(client, "a.jpg", data).status_code == 200
        assert becomes(lambda: not list(temporary_folders(tmp_path / "home")[0].glob("*/result-*")))


def test_connections_without_a_request_are_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "_HEADERS_S", 0.3)

    async def answer(scope: dict, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def ask() -> tuple[bytes, bytes, bytes]:
        config = uvicorn.Config(answer, http=guard.Connection, lifespan="off", log_config=None, port=0)
        server = uvicorn.Server(config)
        serving = asyncio.create_task(server._serve())
        while not server.started:
            await asyncio.sleep(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        silent, halting, asking = [await asyncio.open_connection("127.0.0.1", port) for _ in range(3)]
        halting[1].write(b"GET / HTTP/1.1\r\nHost: 127")
        asking[1].write(b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
        got = await asyncio.gather(*(asyncio.wait_for(each[0].read(12), 30) for each in (silent, halting, asking)))
        server.should_exit = True
        for each in (silent, halting, asking):
            each[1].close()
        await serving
        return tuple(got)

    assert asyncio.run(ask()) == (b"", b"", b"HTTP/1.1 204")
