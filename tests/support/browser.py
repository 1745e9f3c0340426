"""A real browser, where one is installed: Debian's chromium, or another that Playwright can drive."""

import asyncio
import os
import re
import shutil
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Error, Page, expect, sync_playwright

SLOW_MS = 60_000  # others may work beside the tests
# the first one has no window, and takes a tenth less time than the others, which prepare for one
_NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "chrome")
_ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--process-per-site",
    "--renderer-process-limit=1",
    "--in-process-gpu",
)  # a process for each tab takes long to start


@dataclass
class QuietBrowser:
    """A browser whose event loop asyncio knows only while the browser is in use.

    Playwright leaves its loop running in this thread, where no test could run another one.
    """

    started: Browser
    loop: asyncio.AbstractEventLoop | None

    @contextmanager
    def in_use(self) -> Iterator[Browser]:
        asyncio._set_running_loop(self.loop)
        try:
            yield self.started
        finally:
            asyncio._set_running_loop(None)


def path_of_browser() -> str | None:
    """The browser that tests drive; None if none is installed."""
    return os.environ.get("BROWSER_PATH") or next(filter(None, map(shutil.which, _NAMES)), None)


@contextmanager
def browser() -> Iterator[QuietBrowser]:
    """A browser without a window; skips the test where there is none."""
    path = path_of_browser()
    if path is None:
        pytest.skip("no browser is installed: apt-get install chromium-headless-shell")
    with sync_playwright() as playwright:
        try:
            started = playwright.chromium.launch(executable_path=path, args=_ARGUMENTS)
        except Error as error:
            pytest.skip(f"the browser {path} does not start: {error.message.splitlines()[0]}")
        loop = asyncio._get_running_loop()
        asyncio._set_running_loop(None)
        yield QuietBrowser(started, loop)
        asyncio._set_running_loop(loop)
        started.close()


def drop(page: Page, *photos: Path) -> None:
    """Drops files on the page, as a file manager does."""
    files = [{"name": photo.name, "data": b64encode(photo.read_bytes()).decode()} for photo in photos]
    transfer = page.evaluate_handle(
        """files => {
            const transfer = new DataTransfer();
            for (const { name, data } of files) {
                const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
                transfer.items.add(new File([bytes], name));
            }
            return transfer;
        }""",
        files,
    )
    page.dispatch_event("html", "drop", {"dataTransfer": transfer})


def saved(page: Page, button: str = "Save this photo") -> bytes:
    """Presses a button; returns the file that the browser then downloads."""
    with page.expect_download() as download:
        page.get_by_role("button", name=button).click()
    return Path(download.value.path()).read_bytes()


def enter(page: Page, selector: str, value: str) -> None:
    """Types a value into a field, and presses Enter."""
    page.locator(selector).fill(value)
    page.locator(selector).press("Enter")


def wait_for(page: Page, state: str = "changed", number: int = 1, timeout: float = SLOW_MS) -> None:
    """Waits until a thumbnail, counted from 1, is in a state, and the page at rest."""
    item = page.locator(f"#thumbnails li:nth-child({number}) .thumbnail")
    expect(item).to_have_attribute("data-state", re.compile(state), timeout=timeout)
    expect(page.locator("#working")).not_to_contain_text("…", timeout=timeout)
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")  # laid out
