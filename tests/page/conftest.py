"""One server and one browser for the tests that leave them as they were."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from support.browser import SLOW_MS, QuietBrowser, browser
from support.page_server import Server, served


@pytest.fixture(scope="session")
def server_home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the server's temporary files lie."""
    return tmp_path_factory.mktemp("server") / "home"


@pytest.fixture(scope="session")
def server(server_home: Path) -> Iterator[Server]:
    with served(server_home) as running:
        yield running


@pytest.fixture
def client(server: Server) -> Iterator[httpx.Client]:
    with server.client() as client:
        yield client


@pytest.fixture(scope="session")
def quiet_browser() -> Iterator[QuietBrowser]:
    with browser() as started:
        yield started


@pytest.fixture
def chromium(quiet_browser: QuietBrowser) -> Iterator[Browser]:
    with quiet_browser.in_use() as started:
        yield started


@pytest.fixture
def page(chromium: Browser, server: Server) -> Iterator[Page]:
    """The page as it is opened, for a test that leaves no error in the browser's console."""
    errors: list[str] = []
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, accept_downloads=True)
    context.set_default_timeout(SLOW_MS)
    expect.set_options(timeout=SLOW_MS)
    page = context.new_page()
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if "Content Security" in message.text else None)
    page.goto(server.link)
    yield page
    context.close()
    assert not errors
