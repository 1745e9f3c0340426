"""One server and one browser for the tests that leave them as they were."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from support.browser import SLOW_MS, QuietBrowser, browser, drop, wait_for
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


@pytest.fixture(scope="session")
def tabs(quiet_browser: QuietBrowser, server: Server) -> Iterator[BrowserContext]:
    """Tabs with what a browser keeps for them: one remains, since starting all of it again takes most of a second."""
    with quiet_browser.in_use() as started:
        context = started.new_context(viewport={"width": 1280, "height": 800}, accept_downloads=True)
        context.set_default_timeout(SLOW_MS)
        context.new_page().goto(f"{server.url}/sample.jpg")
    yield context
    with quiet_browser.in_use():
        context.close()


@pytest.fixture
def page(chromium: Browser, tabs: BrowserContext, server: Server) -> Iterator[Page]:
    """The page as it is opened in a new tab, for a test that leaves no error in the browser's console."""
    errors: list[str] = []
    expect.set_options(timeout=SLOW_MS)
    page = tabs.new_page()
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if "Content Security" in message.text else None)
    page.goto(server.link)
    yield page
    for tab in tabs.pages[1:]:
        tab.close()
    assert not errors


@pytest.fixture
def street(page: Page, photo: Path) -> Page:
    """The page with a photo that was straightened."""
    drop(page, photo)
    wait_for(page)
    return page


@pytest.fixture
def phone(chromium: Browser, server: Server) -> Iterator[Page]:
    """The page on a phone that is held upright."""
    page = chromium.new_page(viewport={"width": 390, "height": 844}, has_touch=True)
    page.set_default_timeout(SLOW_MS)
    expect.set_options(timeout=SLOW_MS)
    page.goto(server.link)
    yield page
    page.close()
