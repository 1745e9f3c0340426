"""Whether what users read is plain English of a bearable length: ``python .ci/prose.py`` from the repository's root.

Three checks: no page of the documentation outside its reference is longer than MOST_WORDS; no page and no text of the
source has a phrase of phrases.toml; and codespell, where it is installed, finds no misspelt word.
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
MOST_WORDS = 1500
PAGE = "src/unshutter/page/web"  # of `unshutter serve`: its words are in two files
REFERENCE = ("docs/reference/", "docs/architecture.md")  # pages to look things up in may be long
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_GENERATED = re.compile(r"^<!-- (?:modules|measured):.*?^<!-- end.*?-->$", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`\n]+`")
_SETTINGS = tomllib.loads((Path(__file__).parent / "phrases.toml").read_text(encoding="utf-8"))
_PHRASES = [(re.compile(each["pattern"], re.IGNORECASE), each["instead"]) for each in _SETTINGS["phrase"]]
_BEGINNINGS = [(re.compile(each["pattern"]), each["instead"]) for each in _SETTINGS["docstring"]]
REMAINING: dict[str, int] = _SETTINGS["remaining"]
SPELLING = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs", "src", "lab/src"]
SPELLED = "Gool,ALPH,NED,ist,optio,fiel,indx"  # names, and keys of file formats
NO_TEXT = "*.json,*.svg,*.csv,*.jpg,*.png,*.npz,*.onnx,*.js.map"


def pages() -> list[Path]:
    """What is read as documentation."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def words_of_the_page() -> list[Path]:
    """Files with what users of ``unshutter serve`` read."""
    return [ROOT / PAGE / "words.js", ROOT / PAGE / "index.html"]


def words(text: str) -> int:
    """How many words a page has, tables included, blocks of code not."""
    return sum(any(map(str.isalnum, word)) for word in _FENCE.sub("", text).split())


def too_long(path: Path) -> bool:
    """Whether a page outside the reference has more than MOST_WORDS."""
    name = path.relative_to(ROOT).as_posix()
    return not name.startswith(REFERENCE) and words(path.read_text(encoding="utf-8")) > MOST_WORDS


def phrases_of_page(text: str) -> list[tuple[int, str, str]]:
    """(line, phrase, what to write instead) of each phrase outside code and generated tables."""
    for part in (_FENCE, _GENERATED, _CODE):
        text = part.sub(lambda found: "\n" * found[0].count("\n"), text)
    return list(_found(text, 1))


def phrases_of_source(path: Path) -> list[tuple[int, str, str]]:
    """The same of the texts of a Python file: docstrings, help, messages."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    texts = [each for each in ast.walk(tree) if isinstance(each, ast.Constant) and isinstance(each.value, str)]
    hits = [hit for each in texts for hit in _found(_CODE.sub("", each.value), each.lineno)]
    for each in ast.walk(tree):
        if isinstance(each, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(each)):
            hits += [(getattr(each, "lineno", 1), m[0], note) for one, note in _BEGINNINGS if (m := one.search(text))]
    return hits


def source_files(folder: str) -> list[Path]:
    """The Python files of a folder."""
    return sorted((ROOT / folder).rglob("*.py"))


def misspelt() -> str:
    """What codespell says; nothing where it is not installed."""
    program = shutil.which("codespell", path=str(Path(sys.executable).parent)) or shutil.which("codespell")
    if program is None:
        return ""
    command = [program, *SPELLING, f"--skip={NO_TEXT}", f"--ignore-words-list={SPELLED.lower()}"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout


def _found(text: str, line: int) -> Iterator[tuple[int, str, str]]:
    flat = text.replace("\n", " ")
    for pattern, instead in _PHRASES:
        for found in pattern.finditer(flat):
            yield line + text.count("\n", 0, found.start()), " ".join(found[0].split()), instead


def main() -> None:
    complaints = []
    for path in pages():
        name, text = path.relative_to(ROOT), path.read_text(encoding="utf-8")
        if too_long(path):
            complaints.append(f"{name}: {words(text)} words, at most {MOST_WORDS}: split it where its subject changes")
        complaints += [f"{name}:{line}: '{hit}': write: {instead}" for line, hit, instead in phrases_of_page(text)]
    for path in words_of_the_page():
        hits = _found(path.read_text(encoding="utf-8"), 1)
        complaints += [f"{path.relative_to(ROOT)}:{line}: '{hit}': write: {instead}" for line, hit, instead in hits]
    for folder, most in REMAINING.items():
        hits = [(path, *hit) for path in source_files(folder) for hit in phrases_of_source(path)]
        if len(hits) > most or "--source" in sys.argv:
            complaints += [f"{p.relative_to(ROOT)}:{line}: '{hit}': write: {note}" for p, line, hit, note in hits]
    complaints += misspelt().splitlines()
    print(*complaints, sep="\n")
    sys.exit(bool(complaints))


if __name__ == "__main__":
    main()
