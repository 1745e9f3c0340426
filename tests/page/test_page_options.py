"""The page's controls come from the program's description of options; its files have no words or styles to spare."""

import json
import re
from pathlib import Path

from playwright.sync_api import Page, Route, expect

from support.browser import drop, wait_for
from unshutter.options.clip_options import RectifyClip
from unshutter.page import sentences
from unshutter.page.app import PAGE
from unshutter.page.settings import PhotoOptions, fields, page_module


def _described() -> dict[str, dict[str, dict]]:
    """What the page knows of options, by kind and name."""
    return {
        word: json.loads(text)
        for word, text in re.findall(r"^export const (\w+) = (.*);$", page_module(), re.MULTILINE)
    }


def test_the_page_knows_every_option() -> None:
    described = _described()
    for word, kind in (("photo", PhotoOptions), ("clip", RectifyClip)):
        assert list(described[word]) == [option.name for option in fields(kind)]
    assert described["photo"]["strength"] == {
        "type": "number",
        "description": "How much of the motion to undo, 0 to 2; 1 is all of it.",
        "default": 1.0,
        "minimum": 0,
        "maximum": 2.0,
        "group": "undo",
        "examples": [],
    }


def test_an_option_appears_by_itself(page: Page, photo, server) -> None:
    """One that the page's files do not name has a control and is asked for; others have the program's limits."""
    described = _described()
    described["photo"]["softness"] = {"type": "number", "description": "How soft.", "group": "undo", "maximum": 3}
    described["photo"]["strength"]["maximum"] = 1.5
    script = "".join(f"export const {word} = {json.dumps(options)};\n" for word, options in described.items())
    page.route("**/page/options.js", lambda route: route.fulfill(body=script, content_type="text/javascript"))
    page.goto(server.link)
    drop(page, photo)
    wait_for(page)
    expect(page.locator("#strength")).to_have_attribute("max", "150")
    page.locator("#advanced summary").click()
    asked: list[str] = []

    def without(route: Route) -> None:
        asked.append(route.request.url)
        route.continue_(url=re.sub("softness=[^&]*&?", "", route.request.url))

    page.route("**/after?*softness=*", without)
    field = page.get_by_label("Softness")
    expect(page.locator("label:has(#option-softness)")).to_have_attribute("title", "How soft.")
    for typed in ("9", "2"):  # beyond its limit: the nearest that can be
        field.fill(typed)
        with page.expect_response("**/after?*"):
            field.press("Enter")
        wait_for(page)
    assert [url.split("softness=")[1][0] for url in asked] == ["3", "2"]


def test_every_option_has_a_control(page: Page) -> None:
    """All that the program takes can be set on the page, apart from what is drawn or dropped on it."""
    page.locator("body").wait_for()
    ids = set(page.evaluate("() => [...document.querySelectorAll('input, select')].map(node => node.id || node.name)"))
    own = {
        "moving",
        "strength",
        "upright",
        "edges",
        "format",
        "reference",
        "readout",
        "roll-deg",
        "tilt-deg",
        "model",
        "fallback",
        "at",
    }
    drawn = {"lines", "lean-deg", "bend-percent", "turn-deg", "candidate", "before", "after"}
    other_ids = {"min-confidence": "anyway", "readout-ratio": "ratio"}
    for name in _described()["photo"].keys() - drawn:
        assert other_ids.get(name, name if name in own else f"option-{name}") in ids, name
    for name in _described()["clip"].keys() - {"readout-ms", "readout-ratio"}:
        assert {f"clip-{name}", f"clip-option-{name}"} & ids, name


def test_methods_are_a_list(page: Page) -> None:
    methods = page.locator("select#option-estimator option")
    assert methods.count() > 2
    expect(methods.filter(has_text=_described()["photo"]["estimator"]["default"])).not_to_have_count(0)


def test_no_word_and_no_style_is_dead() -> None:
    scripts = {file.name: file.read_text("utf-8") for file in PAGE.glob("*.js")}
    html, styles = ((PAGE / name).read_text("utf-8") for name in ("index.html", "style.css"))
    words = scripts["words.js"].partition("export const words = ")[2].partition("\n};")[0]
    program = page_module() + Path(sentences.__file__).read_text("utf-8")  # which advises buttons by their names
    where = html + words + "".join(text for name, text in scripts.items() if name != "words.js") + program
    used = re.compile(r"words\.(\w+)|data-(?:word|label)=\"(\w+)\"|[\"']([\w-]+)[\"']")
    names = {name for match in used.finditer(where) for name in match.groups() if name}
    assert set(re.findall(r'^  "?([\w-]+)"?:', words, re.MULTILINE)) <= names
    selectors = re.sub(r"\{[^{}]*\}", " ", styles)
    everywhere = html + "".join(scripts.values())
    dead = [
        name
        for name in set(re.findall(r"[.#]([a-zA-Z][\w-]+)", selectors))
        if not re.search(rf"(?<![\w-]){name}(?![\w-])", everywhere)
    ]
    assert not dead
