"""How long the page lasts that ends with its last tab, and what a tab is given to open."""

import asyncio
import json
import time
from pathlib import Path

import pytest

from support.page_server import TOKEN, Asking, desk
from unshutter.page.app import application
from unshutter.page.instance import leave_files
from unshutter.page.settings import Settings
from unshutter.page.tabs import Tabs

HEADERS = {"Authorization": f"Bearer {TOKEN}"}


def lasted(tabs: Tabs, *events: tuple[float, str, str]) -> float:
    """How long [s] the tabs last with events: when [s], what, and the tab's id."""

    async def run() -> float:
        began = time.monotonic()
        loop = asyncio.get_running_loop()
        for at_s, what, id in events:
            loop.call_later(at_s, getattr(tabs, what), id)
        await asyncio.wait_for(tabs.wait_until_closed(), 20)
        return time.monotonic() - began

    return asyncio.run(run())


def quick(opening_s: float = 1.0, silent_s: float = 1.0) -> Tabs:
    return Tabs(opening_s=opening_s, silent_s=silent_s, closed_s=0.1, tick_s=0.01)


def test_it_waits_for_the_first_tab_but_not_without_end() -> None:
    assert lasted(quick(opening_s=0.3)) >= 0.3


def test_it_ends_after_its_last_tab() -> None:
    both = [(0.0, "report", "one"), (0.0, "report", "two"), (0.1, "close", "one"), (0.6, "close", "two")]
    assert 0.7 <= lasted(quick(opening_s=30, silent_s=30), *both) < 10


def test_a_page_that_is_loaded_again_goes_on() -> None:
    again = [(0.0, "report", "one"), (0.05, "close", "one"), (0.1, "report", "two"), (0.6, "close", "two")]
    assert lasted(quick(silent_s=30), *again) >= 0.7


def test_a_report_that_comes_after_the_end_of_its_tab_opens_nothing() -> None:
    assert lasted(quick(opening_s=30, silent_s=30), (0.0, "close", "one"), (0.05, "report", "one")) < 10


def test_a_tab_that_is_shown_again_counts() -> None:
    tabs = quick(silent_s=0.5)
    tabs.report("one")
    tabs.close("one")
    tabs.report("one", again=True)
    assert lasted(tabs) >= 0.5


def test_a_tab_that_falls_silent_is_forgotten() -> None:
    assert 0.4 <= lasted(quick(silent_s=0.4), (0.0, "report", "one")) < 10


def test_a_tab_that_is_about_to_open_counts() -> None:
    events = [(0.0, "report", "one"), (0.05, "close", "one"), (0.1, "announce", "two")]
    assert lasted(quick(opening_s=0.5), *events) >= 0.6


def test_a_tab_gets_its_files_and_no_others(tmp_path: Path, photo: Path) -> None:
    secret = tmp_path / "secret.txt"
    secret.write_text("secret")
    home = tmp_path / "home"
    home.mkdir()
    (home / "open-notes.json").write_text(json.dumps([str(secret)]))
    id = "tab-1234"
    leave_files(home, id, [photo, tmp_path / "gone.jpg"])
    with desk() as one:
        client = Asking(application(one, TOKEN, 80, Tabs(home, "proof")))
        files = f"/api/tabs/{id}/files"
        assert client.get(files, headers=HEADERS).json() == ["street.jpg", "gone.jpg"]
        assert client.get(f"{files}/0", headers=HEADERS).content == photo.read_bytes()
        assert [client.get(f"{files}/{k}", headers=HEADERS).status_code for k in (1, 2, 99)] == [404] * 3
        assert client.get(files).status_code == 401
        for foreign in ("notes", "..%2Fhome%2Fopen-notes", "x" * 12):
            assert client.get(f"/api/tabs/{foreign}/files/0", headers=HEADERS).status_code == 404
        assert client.post("/api/tabs/some-tab", headers=HEADERS).json() == {"proof": "proof"}


@pytest.mark.parametrize(("name", "code"), [("street.jpg", 413), ("street.mp4", 413), ("small.jpg", 200)])
def test_a_file_that_is_too_large_is_not_sent(tmp_path: Path, name: str, code: int) -> None:
    file = tmp_path / name
    with file.open("wb") as stream:
        stream.truncate(2_000_000 if code == 413 else 1000)
    id = "tab-1234"
    leave_files(tmp_path, id, [file])
    with desk(Settings(token=TOKEN, max_mb=1)) as one:
        answer = Asking(application(one, TOKEN, 80, Tabs(tmp_path))).get(f"/api/tabs/{id}/files/0", headers=HEADERS)
    assert answer.status_code == code and (code == 200 or answer.json()["error"] == "it has more than 1 MB")


def test_a_page_that_is_merely_served_has_no_files(tmp_path: Path) -> None:
    with desk() as one:
        assert Asking(application(one, TOKEN, 80)).get("/api/tabs/12345678/files", headers=HEADERS).json() == []
