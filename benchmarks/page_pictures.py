"""The pictures of docs/guide/page: the page of ``unshutter serve`` in three windows, as a browser shows it.

    python benchmarks/page_pictures.py [--browser /usr/bin/chromium]

Shown are the photos and the clip that the repository ships (examples/README.md says where they are from).
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

ROOT = Path(__file__).parent.parent
CLIP = ROOT / "examples" / "walk.mp4"
PHOTOS = [ROOT / "src" / "unshutter" / "page" / "web" / "sample.jpg", ROOT / "examples" / "original" / "basilica.webp"]
FIGURES = ROOT / "docs" / "figures"


def opened(browser: Browser, link: str, width: int, height: int, scheme: str) -> Page:
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)  # type: ignore
    page = context.new_page()
    page.goto(link)
    page.set_input_files("#choose", PHOTOS)
    for number in range(1, len(PHOTOS) + 1):
        item = f"#thumbnails li:nth-child({number})"
        page.wait_for_selector(f"{item} [data-state=changed], {item} [data-state=alone]")
    page.wait_for_function("() => [...document.querySelectorAll('#candidates canvas')].every(node => node.width > 1)")
    page.wait_for_timeout(500)
    return page


def opened_clip(browser: Browser, link: str, width: int, height: int) -> Page:
    page = browser.new_context(viewport={"width": width, "height": height}).new_page()
    page.goto(link)
    page.set_input_files("#choose", [CLIP, *PHOTOS])
    page.select_option("#clip-readout-unit", "ms")
    page.fill("#clip-readout", "20")
    page.press("#clip-readout", "Enter")
    page.wait_for_selector("#thumbnails [data-state=done]", timeout=180_000)
    page.wait_for_selector("#thumbnails li:nth-child(3) :is([data-state=changed], [data-state=alone])")
    page.wait_for_timeout(3000)  # the small pictures
    page.click("#play")
    page.wait_for_function("() => Number(document.querySelector('#play-at').value) > 0.3", timeout=180_000)
    page.click("#play")
    return page


def draw_uprights(page: Page) -> None:
    """Two lines along edges of the tower."""
    page.click("#by-hand summary")
    with page.expect_response("**/segments*"):
        page.click("#tool-upright")
    box = page.locator(".compare").bounding_box()
    assert box is not None
    for begin, end in (((0.67, 0.1), (0.595, 0.9)), ((0.814, 0.45), (0.744, 0.94))):
        (x1, y1), (x2, y2) = ((box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in (begin, end))
        page.mouse.move(x1, y1)
        page.mouse.down()
        page.mouse.move(x2, y2, steps=4)
        with page.expect_response("**/after*"):
            page.mouse.up()


def save(page: Page, name: str) -> None:
    page.mouse.move(0, 0)
    page.wait_for_timeout(500)
    page.screenshot(path=FIGURES / f"{name}.jpg", type="jpeg", quality=82)
    page.context.close()


def draw_all(browser: Browser, server: subprocess.Popen[str]) -> None:
    assert server.stdout is not None
    link = server.stdout.readline().split()[1]
    save(opened(browser, link, 1440, 900, "light"), "page")
    tablet = opened(browser, link, 1024, 768, "dark")
    draw_uprights(tablet)
    save(tablet, "page_by_hand")
    save(opened(browser, link, 390, 844, "light"), "page_phone")
    save(opened_clip(browser, link, 1280, 860), "page_clip")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--browser", default=shutil.which("chromium") or shutil.which("chromium-headless-shell"))
    given = parser.parse_args()
    command = [sys.executable, "-m", "unshutter", "serve", "--port", "0"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=given.browser, args=["--no-sandbox"])
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            draw_all(browser, server)
        finally:
            server.terminate()
            browser.close()


if __name__ == "__main__":
    main()
