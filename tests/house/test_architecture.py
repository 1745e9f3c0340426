"""The pages that are made from the code: options.md is up to date, and architecture.md finds every module."""

import re
import runpy
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def hook() -> dict[str, Any]:
    return runpy.run_path(str(DOCS / "architecture.py"))


def test_the_list_of_options_is_up_to_date() -> None:
    if find_spec("unshutter_lab") is None:
        pytest.skip("lists the commands of unshutter-lab, too")
    page = runpy.run_path(str(DOCS / "options.py"))["page"]
    assert (DOCS / "reference" / "options.md").read_text(encoding="utf-8") == page(), "run python docs/options.py"


@pytest.mark.parametrize("number", [0, 1], ids=["unshutter", "unshutter_lab"])
def test_every_module_is_listed_with_what_it_does(hook: dict[str, Any], number: int) -> None:
    package = hook["PACKAGES"][number]
    listed = list(hook["modules"](package))
    assert sorted(listed) == sorted(package.rglob("*.py"))
    assert [path for path in listed if not hook["first_line"](path)] == []


def test_the_page_gets_the_tables_where_it_asks_for_them(hook: dict[str, Any]) -> None:
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    assert text.count(hook["MARK"]) == 1
    made = hook["on_page_markdown"](text)
    assert hook["MARK"] not in made and "| **`motion/`** |" in made and "| `motion/warp.py` |" in made
    assert hook["on_page_markdown"]("another page") == "another page"


def test_the_rooms_of_the_page_are_those_of_the_package(hook: dict[str, Any]) -> None:
    package = hook["PACKAGES"][0]
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    rooms = re.findall(r"^\| `(\w+)` \|.*\| ((?:`[\w/]+\.py`(?:, )?)+) \|$", text, re.MULTILINE)
    assert len(rooms) == 9
    assert [name for name, _ in rooms if not (package / name / "__init__.py").exists()] == []
    files = [file for _, starts in rooms for file in re.findall(r"`([^`]+)`", starts)]
    assert [file for file in files if not (package / file).exists()] == []
    drawn = re.search(r"^## Who may import whom\n.*?^```\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert drawn is not None and {*drawn[1].split(), "__main__"} == {*hook["layers"](package.name)}
