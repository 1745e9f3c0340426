"""How long the page lasts that ends with its last tab, and what a tab is given to open."""

import asyncio
import time
from pathlib import Path

import pytest

from support.page_server import TOKEN, Asking, desk
from unshutter.page.app import application
from unshutter.page.settings import Settings
from unshutter.page.tabs import Tabs

HEADERS = {"Authorization": f"Bearer {TOKEN}"}
ID = "tab-1234"


def lasted(folder: Path, *events: tuple[float, str], opening_s: float = 0.3) -> float:
    """How long [s] the page lasts with events: when [s], and what: a tab ``opens``, one ``closes``, one ``arrives``."""
    tabs = Tabs(folder, "http://127.0.0.1", "key", opening_s=opening_s, closed_s=0.1, tick_s=0.01)
    shown: list[asyncio.Task[None]] = []

    async def show() -> None:
        async for _ in tabs.held():
            pass

    happens = {
        "opens": lambda: shown.append(asyncio.ensure_future(show())),
        "closes": lambda: shown.pop(0).cancel(),
        "expected": lambda: tabs.expect(ID),
        "arrives": lambda: tabs.arrived(ID),
    }

    async def run() -> float:
        began = time.monotonic()
        for at_s, what in events:
            asyncio.get_running_loop().call_later(at_s, happens[what])
        while not tabs.are_closed:
            await tabs.tick()
        tabs.end()
        return time.monotonic() - began

    return asyncio.run(asyncio.wait_for(run(), 20))


def test_it_waits_for_the_first_tab_but_not_without_end(tmp_path: Path) -> None:
    assert lasted(tmp_path) >= 0.3


def test_it_ends_after_its_last_tab(tmp_path: Path) -> None:
    both = [(0.0, "opens"), (0.0, "opens"), (0.1, "closes"), (0.5, "closes")]
    assert 0.6 <= lasted(tmp_path, *both, opening_s=30) < 10


def test_a_page_that_is_loaded_again_goes_on(tmp_path: Path) -> None:
    again = [(0.0, "opens"), (0.05, "closes"), (0.1, "opens"), (0.5, "closes")]
    assert lasted(tmp_path, *again) >= 0.6


def test_a_tab_that_is_about_to_open_counts_until_it_is_there(tmp_path: Path) -> None:
    events = [(0.0, "opens"), (0.05, "expected"), (0.1, "closes")]
    assert lasted(tmp_path, *events, opening_s=0.5) >= 0.6
    assert lasted(tmp_path, *events, (0.15, "arrives"), opening_s=30) < 10
    assert not list(tmp_path.rglob("*.html"))


def test_a_tab_gets_its_files_and_no_others(tmp_path: Path, photo: Path) -> None:
    tabs = Tabs(tmp_path, "http://127.0.0.1:80/?token=t", "key")
    wanted = [str(photo), str(tmp_path / "gone.jpg")]
    with desk() as one:
        client = Asking(application(one, TOKEN, 80, tabs))
        files = f"/api/tabs/{ID}/files"
        for key in ({}, {"unshutter-key": "KEY"}):  # the page itself cannot name files
            assert client.post(f"/api/tabs/{ID}", headers=HEADERS | key, json=wanted).status_code == 403
        assert client.get(files, headers=HEADERS).json() == []
        answer = client.post(f"/api/tabs/{ID}", headers=HEADERS | {"unshutter-key": "key"}, json=wanted)
        assert answer.status_code == 204 and f"token=t&open={ID}" in (tmp_path / f"open-{ID}.html").read_text()
        assert client.get(files, headers=HEADERS).json() == ["street.jpg", "gone.jpg"]
        assert not list(tmp_path.glob("*.html")), "the link is needed no more once its tab is there"
        assert client.get(f"{files}/0", headers=HEADERS).content == photo.read_bytes()
        assert [client.get(f"{files}/{k}", headers=HEADERS).status_code for k in (1, 2, 99)] == [404] * 3
        assert client.get(files).status_code == 401
        assert client.get("/api/tabs/another/files", headers=HEADERS).json() == []


@pytest.mark.parametrize(("name", "code"), [("street.jpg", 413), ("street.mp4", 413), ("small.jpg", 200)])
def test_a_file_that_is_too_large_is_not_sent(tmp_path: Path, name: str, code: int) -> None:
    file = tmp_path / name
    with file.open("wb") as stream:
        stream.truncate(2_000_000 if code == 413 else 1000)
    tabs = Tabs(tmp_path, "http://127.0.0.1:80", "key")
    tabs.expect(ID, [file])
    with desk(Settings(token=TOKEN, max_mb=1)) as one:
        answer = Asking(application(one, TOKEN, 80, tabs)).get(f"/api/tabs/{ID}/files/0", headers=HEADERS)
    assert answer.status_code == code and (code == 200 or answer.json()["error"] == "it has more than 1 MB")
