"""``unshutter open``: a page that the next start finds, that is given files, and that ends after its last tab."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from support.browser import SLOW_MS, wait_for
from support.page_server import LONG_S, becomes, temporary_folders
from support.page_user import User, alive, user_in
from unshutter.page.instance import RunningPage, described_page, only_page, publish, state_folder

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="the folder of the running page is named by XDG_RUNTIME_DIR"
)


@pytest.fixture
def user(tmp_path: Path) -> Iterator[User]:
    with user_in(tmp_path / "user") as user:
        yield user


def test_a_second_start_finds_the_first(user: User, photo: Path) -> None:
    holiday = photo.parent / "holiday"
    (holiday / ".cache").mkdir(parents=True)
    for name in ("b.jpg", "a.mp4", "notes.txt", ".hidden.jpg", ".cache/c.jpg"):
        (holiday / name).write_bytes(photo.read_bytes())
    assert user.open(photo, holiday).returncode == 0
    first = user.page
    assert user.open().returncode == 0
    assert user.page == first
    assert user.folder.stat().st_mode & 0o077 == 0, "the description is for its user alone"
    given, empty = user.tabs
    assert all(link.startswith(f"http://127.0.0.1:{first.port}/?token={first.token}") for link in user.links)
    with user.client() as client:
        assert client.get(f"/api/tabs/{given}/files").json() == [photo.name, "a.mp4", "b.jpg"]
        assert client.get(f"/api/tabs/{given}/files/0").content == photo.read_bytes()
        assert client.get(f"/api/tabs/{empty}/files").json() == []
        assert not list(user.folder.glob("*.html")), "the link is needed no more once its tab is there"
    again = user.run(*user.program[:-1], "serve", "--until-closed", "--open", "--port", 0)
    assert again.returncode == 0 and f"the page runs already, as process {first.pid}" in again.stderr
    assert len(user.links) == 3


def test_two_starts_at_once_open_one_page(user: User) -> None:
    both = [subprocess.Popen(user.program, env=user.environment) for _ in range(2)]
    assert [each.wait(2 * LONG_S) for each in both] == [0, 0]
    assert len(user.links) == 2 and {link.partition("&")[0] for link in user.links} == {user.links[0].partition("&")[0]}


class Foreign(BaseHTTPRequestHandler):
    """Another program, which answers everything."""

    def do_POST(self) -> None:
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b"{}")

    def log_message(self, *_: object) -> None:
        pass


def test_a_page_that_was_killed_is_replaced_and_what_took_its_port_gets_no_visit(user: User) -> None:
    assert user.open().returncode == 0
    killed = user.page
    os.kill(killed.pid, signal.SIGKILL)
    assert becomes(lambda: not alive(killed.pid)) and user.page == killed
    with HTTPServer(("127.0.0.1", killed.port), Foreign) as foreign:
        threading.Thread(target=foreign.serve_forever, daemon=True).start()
        assert user.open().returncode == 0
        foreign.shutdown()
    assert user.page.pid != killed.pid and user.page.port != killed.port
    assert str(user.page.port) in user.links[-1]
    assert len(list(user.folder.glob("open-*.html"))) == 1, "the link to the page that was killed is gone"


@pytest.mark.parametrize("harm", ["foreign mode", "link", "file"])
def test_a_folder_that_others_could_use_is_refused(user: User, tmp_path: Path, harm: str) -> None:
    match harm:
        case "foreign mode":
            user.folder.mkdir()
            user.folder.chmod(0o777)
        case "link":
            user.folder.symlink_to(tmp_path)
        case "file":
            user.folder.write_text("")
    refused = user.open()
    assert refused.returncode == 1 and str(user.folder) in refused.stderr and refused.stderr.count("\n") == 1


def test_what_cannot_be_opened_is_said_and_nothing_starts(user: User, tmp_path: Path) -> None:
    refused = user.open(tmp_path / "no.jpg")
    assert refused.returncode == 1 and "there is no file" in refused.stderr and refused.stderr.count("\n") == 1
    assert not user.folder.exists()
    refused = user.run(*user.program[:-1], "serve", "--until-closed", "--host", "0.0.0.0", "--i-know")
    assert refused.returncode == 2 and "leave out --host" in refused.stderr


def test_a_start_without_a_browser_says_the_link(user: User) -> None:
    user.browser.write_text("#!/bin/sh\nexit 1\n")
    told = user.open(PATH="/nowhere", DISPLAY="", WAYLAND_DISPLAY="")
    assert told.returncode == 1 and f"open http://127.0.0.1:{user.page.port}/?token=" in told.stderr


def test_files_are_dropped_onto_the_page_and_the_last_tab_ends_it(user: User, photo: Path, chromium: Browser) -> None:
    assert user.open(photo, photo.parent).returncode == 0
    context = chromium.new_context()
    page = context.new_page()
    expect.set_options(timeout=SLOW_MS)
    page.goto(user.links[0])
    wait_for(page)
    wait_for(page, number=2)
    assert "open=" not in page.url and "token" not in page.url
    page.reload()  # which starts empty, and does not end the server
    expect(page.locator("#empty")).to_be_visible()
    pid = user.page.pid
    second = context.new_page()
    second.goto(user.page.link("another"))
    held = "navigator.locks.query().then(({ held, pending }) => [held.length, pending.length].join())"
    second.wait_for_function(f"{held}.then((now) => now === '1,1')")  # the first stands for both, until it is closed
    page.close()
    second.wait_for_function(f"{held}.then((now) => now === '1,0')")
    context.close()
    assert becomes(lambda: not alive(pid))
    assert described_page(user.folder) is None and not temporary_folders(user.home)


def test_only_one_process_claims_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    folder = state_folder()
    assert folder == tmp_path / "unshutter" and folder.stat().st_mode & 0o777 == 0o700
    page = RunningPage(1, "token", "key", os.getpid())
    with only_page(folder) as first, only_page(folder) as second:
        assert (first, second) == (True, False)
        publish(folder, page)
        assert described_page(folder) == page
    assert described_page(folder) is None


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"port": "x", "token": 1, "key": 2, "pid": 3}', "\0"])
def test_a_damaged_description_is_none(tmp_path: Path, content: str) -> None:
    (tmp_path / "page.json").write_text(content)
    assert described_page(tmp_path) is None


@pytest.mark.parametrize("runtime", ["", "relative", "/nowhere"])
def test_without_a_runtime_folder_the_users_own_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runtime: str
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert state_folder() == tmp_path / "state" / "unshutter"
