"""Lists what users read that no page lists: errors, reasons, report lines, help and the words of the browser page.

    python docs/messages.py > messages.txt

To be read aloud from top to bottom. Names in braces are filled in when the program runs.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
WEB = ROOT / "src" / "unshutter" / "page" / "web"


def sentences(path: Path) -> Iterator[tuple[int, str]]:
    """(line, text) of each text of a Python file with at least two words, without docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    for each in ast.walk(tree):
        if isinstance(each, ast.JoinedStr):
            skipped |= {id(part) for part in ast.walk(each)} - {id(each)}
    for each in ast.walk(tree):
        if isinstance(each, ast.JoinedStr | ast.Constant) and id(each) not in skipped:
            text = each.value if isinstance(each, ast.Constant) else _filled(each)
            if isinstance(text, str) and re.search(r"[a-z}] [a-z{(\d]", text):
                yield each.lineno, " ".join(text.split())


def _filled(each: ast.JoinedStr) -> str:
    parts = (p.value if isinstance(p, ast.Constant) else "{" + ast.unparse(p.value) + "}" for p in each.values)
    return "".join(map(str, parts))


def words_of_the_page() -> Iterator[str]:
    """The lines of the page with text that is shown."""
    for path in (WEB / "words.js", WEB / "index.html"):
        yield from (line.strip() for line in path.read_text(encoding="utf-8").splitlines() if re.search(r"\w \w", line))


if __name__ == "__main__":
    for folder in ("src", "lab/src"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if found := sorted(set(sentences(path))):
                print(f"\n{path.relative_to(ROOT).as_posix()}")
                print(*(f"{line}: {text}" for line, text in found), sep="\n")
    print("\nthe page", *words_of_the_page(), sep="\n")
