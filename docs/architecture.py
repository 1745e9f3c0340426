"""A hook of MkDocs (mkdocs.yml): lists all modules on the site's page "Architecture", where the page has ``MARK``.

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
MARK = "<!-- modules: the site lists them here, by docs/architecture.py -->"


def on_page_markdown(markdown: str, **_: object) -> str:
    """The page, with the tables where it asks for them."""
    return markdown.replace(MARK, tables()) if MARK in markdown else markdown


def tables() -> str:
    """A table for each package."""
    head = "| module | what it does |\n|---|---|\n"
    return "\n\n".join(head + "\n".join(row(path, package) for path in modules(package)) for package in PACKAGES)


def modules(package: Path) -> Iterator[Path]:
    """A package's face, then every file and folder of its top, from the highest layer to the lowest."""
    yield package / "__init__.py"
    for name in layers(package.name):
        if (package / name).is_dir():
            yield from room(package / name)
        else:
            yield package / f"{name}.py"


def layers(package: str) -> list[str]:
    """What the contract of a package's layers names, the highest first."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    contract = next(c for c in contracts if c["type"] == "layers" and c["containers"] == [package])
    return [name for layer in contract["layers"] for name in re.findall(r"\w+", layer)]


def room(folder: Path) -> Iterator[Path]:
    """A folder, its files, and then the folders in it."""
    yield folder / "__init__.py"
    for path in sorted(folder.glob("*.py")):
        if path.name != "__init__.py":
            yield path
    for inner in sorted(folder.glob("*/__init__.py")):
        yield from room(inner.parent)


def first_line(path: Path) -> str:
    """The first line of a module's docstring; empty if it has none."""
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def row(path: Path, package: Path) -> str:
    """One module in the table; folders in bold."""
    said = re.sub(r"(?::\w+:)?`+([^`]+)`+", r"`\1`", first_line(path)).removesuffix(".").replace("|", r"\|")
    if path.name == "__init__.py" and path.parent != package:
        return f"| **`{path.parent.relative_to(package).as_posix()}/`** | **{said}** |"
    return f"| `{path.relative_to(package).as_posix()}` | {said} |"
