"""The tutorial shows what its commands print. (tests/test_commands_in_docs.py runs the commands of all other pages.)"""

import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from unshutter.cli import main
from unshutter.photo import Photo

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: Path) -> Iterator[tuple[str, list[str]]]:
    """(language, lines) of each block of code; lines that end in a backslash are joined to the next."""
    for language, text in _BLOCK.findall(page.read_text(encoding="utf-8")):
        yield language, text.replace("\\\n", " ").splitlines()


def commands(lines: list[str]) -> list[list[str]]:
    """The words of each line that calls unshutter, without comments."""
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("unshutter ")]


def commands_of(page: Path) -> list[list[str]]:
    """The words of each call of unshutter on a page."""
    return [words for language, lines in blocks(page) if language == "sh" for words in commands(lines)]


PAGES = [page for page in sorted((ROOT / "docs" / "tutorial").glob("*.md")) if commands_of(page)]


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photos, frames and a clip under the names that the pages give them."""
    folder = tmp_path_factory.mktemp("material")
    shutil.copy(EXAMPLES / "demo.jpg", folder / "street.jpg")
    Photo.open(EXAMPLES / "original" / "basilica.webp").save(folder / "house.jpg")
    for name in "abc":
        shutil.copy(EXAMPLES / "burst" / f"{name}.jpg", folder)
    for several, names in (("frames", ["a.jpg", "b.jpg", "c.jpg"]), ("holiday", ["street.jpg", "house.jpg"])):
        (folder / several).mkdir()
        for name in names:
            shutil.copy(folder / name, folder / several)
    shutil.copy(EXAMPLES / "walk.mp4", folder)
    return folder


def test_pages_with_commands_are_found() -> None:
    assert {"first-photo", "burst", "clip", "no-change"} <= {page.stem for page in PAGES}


@pytest.mark.thorough
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_print_what_the_page_shows(
    page: Path, material: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "work"
    shutil.copytree(material, folder)
    monkeypatch.chdir(folder)
    printed = ""
    for words in commands_of(page):
        code = main(words)
        printed += "".join(capsys.readouterr())
        assert code == 0, f"{shlex.join(words)}\n{printed}"
    for line in (line for language, lines in blocks(page) if language == "text" for line in lines):
        assert re.search(shape(line), printed, re.MULTILINE), f"{line}\nis not in\n{printed}"
    assert printed
    for photo in ("street.jpg", "b.jpg", "walk.mp4"):
        assert (folder / photo).read_bytes() == (material / photo).read_bytes()


def shape(line: str) -> str:
    """A pattern for a line of output with other figures, and other reasons in a count."""
    figures = re.sub(r"\d+(\\\.\d+)?", r"[\\d.]+", re.escape(line))
    return re.sub(r"\\\(\[\\d\.\]\+\\ no.*", ".*", figures)
