"""Pages are of a bearable length, in plain English, and found from the navigation."""

import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def prose() -> ModuleType:
    spec = spec_from_file_location("prose", ROOT / ".ci" / "prose.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_page_outside_the_reference_is_longer_than_1500_words(prose: ModuleType) -> None:
    assert [path.name for path in prose.pages() if prose.too_long(path)] == []
    assert prose.words("one two | three |\n```sh\nfour five\n```\n– six") == 4


def test_the_readme_can_be_read_in_five_minutes(prose: ModuleType) -> None:
    assert 400 <= prose.words((ROOT / "README.md").read_text(encoding="utf-8")) <= 600


def test_a_file_that_a_page_names_exists(prose: ModuleType) -> None:
    files = {
        path.name
        for room in ("src", "lab", "docs", "examples", "benchmarks", "tests")
        for path in (ROOT / room).rglob("*.py")
    }
    named = {
        (page.name, file)
        for page in prose.pages()
        for file in re.findall(r"`(?:\w+/)*(\w+\.py)", page.read_text("utf-8"))
    }
    assert {each for each in named if each[1] not in files} == set()


def test_no_page_has_a_banned_phrase(prose: ModuleType) -> None:
    read = [*prose.pages(), *prose.words_of_the_page()]
    found = {path.name: hits for path in read if (hits := prose.phrases_of_page(path.read_text("utf-8")))}
    assert found == {}


def test_phrases_are_found_in_text_and_not_in_code(prose: ModuleType) -> None:
    page = "The photo stays\nas it is. `left as it is`\n```\nleft as it is\n```\nIt is no photo; there is no photo.\n"
    assert [(line, hit) for line, hit, _ in prose.phrases_of_page(page)] == [(1, "stays as it is"), (6, "is no")]


def test_texts_of_the_source_have_no_more_banned_phrases_than_before(prose: ModuleType, tmp_path: Path) -> None:
    for folder, most in prose.REMAINING.items():
        hits = [hit for path in prose.source_files(folder) for hit in prose.phrases_of_source(path)]
        assert len(hits) <= most, f"{folder}: python .ci/prose.py --source lists them"
    source = tmp_path / "a.py"
    source.write_text('"""The same of a photo."""\nbeside = 1  # beside\nprint(f"{beside} lies beside it")\n')
    assert [hit for _, hit, _ in prose.phrases_of_source(source)] == ["beside", "The same"]


def test_words_are_spelt_correctly(prose: ModuleType) -> None:
    assert prose.misspelt() == ""


def test_every_page_is_in_the_navigation() -> None:
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(r"^ +- (?:.*: )?(\S+\.md)$", settings, re.MULTILINE)
    excluded = re.findall(r"^  (\S+\.md)$", settings, re.MULTILINE)
    there = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert sorted(listed) == sorted(there - set(excluded))


def test_links_of_pages_lead_to_files(prose: ModuleType) -> None:
    """MkDocs checks those between pages; README.md is not one of its pages. Source distributions have no pictures."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = [
        link.partition("#")[0]
        for link in re.findall(r"\]\(([^)\s]+)\)", text)
        if not link.endswith(".jpg") and "://" not in link
    ]
    assert [link for link in links if not (ROOT / link).exists()] == [] and len(links) > 5
