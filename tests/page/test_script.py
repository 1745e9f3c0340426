"""The house of the page's script: its sizes, its states, and whether its types say what the program sends."""

import re
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page

from support import clips
from support.page_server import facts, opened

WEB = Path(__file__).parents[2] / "src" / "unshutter" / "page" / "web"

FILES = sorted(path for path in WEB.iterdir() if path.suffix in (".js", ".ts", ".css", ".html"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_files_and_lines_are_short(path: Path) -> None:
    lines = path.read_text("utf-8").splitlines()
    assert len(lines) <= 450
    assert [line for line in lines if len(line) > 120] == []


def test_a_state_leads_to_states_that_the_page_has_words_for(page: Page) -> None:
    """Each state can be reached from the first one, and be left."""
    table, at_work, wrong, words = page.evaluate(
        """async () => {
            const { TABLE, AT_WORK, WRONG } = await import("/page/states.js");
            const { words } = await import("/page/words.js");
            return [TABLE, AT_WORK, WRONG, Object.keys(words.state)];
        }"""
    )
    reached, new = set[str](), {"waiting"}
    while new:
        reached |= new
        new = {to for state in new for to in table[state].values()} - reached
    assert reached == set(table) and all(table.values())
    assert set(table) | {"changed", "alone"} == set(words)
    assert set(at_work) | set(wrong) | {"done"} == set(table)


def test_an_answer_to_what_was_asked_before_is_none(page: Page) -> None:
    """A photo that got other options while it was worked on waits for its turn again."""
    states = page.evaluate(
        """async () => {
            const { next } = await import("/page/states.js");
            const states = ["waiting"];
            for (const event of ["send", "look", "change", "answer", "look", "answer", "refuse", "change"])
                states.push(next(states.at(-1), event));
            return states;
        }"""
    )
    assert states == [*["waiting", "loading", "finding", "waiting", "waiting", "finding", "done", "failed", "failed"]]


def _fields(name: str) -> tuple[set[str], set[str]]:
    """The fields of one of the page's types that are always there, and those that may be."""
    types = (WEB / "types.d.ts").read_text("utf-8")
    (body,) = re.findall(rf"^export interface {name}(?: extends [^{{]*)? {{\n(.*?)^}}", types, re.MULTILINE | re.DOTALL)
    fields = re.findall(r"^  (\w+)(\??):", body, re.MULTILINE)
    return {field for field, mark in fields if not mark}, {field for field, mark in fields if mark}


def _agrees(name: str, sent: dict, unread: set[str] = frozenset()) -> None:
    always, sometimes = _fields(name)
    assert always <= set(sent) <= always | sometimes | unread, (name, set(sent) ^ (always | sometimes))


def test_types_say_what_the_program_sends_of_photos(client: httpx.Client, photo: Path) -> None:
    _agrees("About", client.get("/api/about").json(), {"version"})
    address = f"/api/photos/{opened(client, photo)}"
    _agrees("PhotoFacts", facts(client.get(f"{address}/before", params={"longest": 320})))
    unread = {"please_look", "left_px", "expected_error_px", "source", "not_upright", "cause", "figures"}
    for options in ({}, {"strength": "0"}, {"upright": "full"}):
        _agrees("PhotoResult", facts(client.get(f"{address}/after", params={"longest": 320, **options})), unread)
    for candidate in client.get(f"{address}/candidates").json():
        _agrees("Candidate", candidate)
    _agrees("Refusal", client.get(f"{address}/after", params={"strength": "9"}).json())


def test_types_say_what_the_program_sends_of_clips(client: httpx.Client, tmp_path: Path) -> None:
    walk = clips.write(tmp_path / "walk.mp4", clips.moving(12)[1])
    address = f"/api/clips/{opened(client, walk, 'clips')}"
    asked = {"longest": 320, "moment": 2, "readout-ratio": "0.6"}
    before, after = (facts(client.get(f"{address}/{which}", params=asked)) for which in ("before", "after"))
    _agrees("ClipFacts", before)
    _agrees("ClipResult", after, {"code", "figures"})
    _agrees("ReadoutTime", client.get(f"{address}/readout", params={"readout-ratio": "0.6"}).json(), {"reason"})
