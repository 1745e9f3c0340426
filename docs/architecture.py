"""Writes the tables of modules in architecture.md: ``python docs/architecture.py``.

What each does is the first line of its docstring; rooms are in the order of the layers that pyproject.toml demands.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = (ROOT / "src" / "unshutter", ROOT / "lab" / "src" / "unshutter_lab")
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- modules: docs/architecture.py writes them -->\n", "<!-- end of modules -->\n"


def page() -> str:
    """The page as it should be: what is there, with a new table between the marks."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    tables = [line for package in PACKAGES for line in ("| module | what it does |", "|---|---|", *rows(package), "")]
    return "\n".join([before + BEGIN, *tables, END + after])


def rows(package: Path) -> Iterator[str]:
    """A package's face, then every file and folder of its top, from the highest layer to the lowest."""
    yield row(package / "__init__.py", package)
    for name in layers(package.name):
        if (package / name).is_dir():
            yield from room(package / name, package)
        else:
            yield row(package / f"{name}.py", package)


def layers(package: str) -> list[str]:
    """What the contract of a package's layers names, the highest first."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    contract = next(c for c in contracts if c["type"] == "layers" and c["containers"] == [package])
    return [name for layer in contract["layers"] for name in re.findall(r"\w+", layer)]


def room(folder: Path, package: Path) -> Iterator[str]:
    """A folder, its files, and then the folders in it."""
    yield row(folder / "__init__.py", package)
    for path in sorted(folder.glob("*.py")):
        if path.name != "__init__.py":
            yield row(path, package)
    for inner in sorted(folder.glob("*/__init__.py")):
        yield from room(inner.parent, package)


def row(path: Path, package: Path) -> str:
    """One module in the table; folders in bold."""
    first_line = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]
    said = re.sub(r"(?::\w+:)?`+([^`]+)`+", r"`\1`", first_line).removesuffix(".").replace("|", r"\|")
    if path.name == "__init__.py" and path.parent != package:
        return f"| **`{path.parent.relative_to(package).as_posix()}/`** | **{said}** |"
    return f"| `{path.relative_to(package).as_posix()}` | {said} |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
