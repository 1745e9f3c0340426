"""What others may build on: the names in ``unshutter.__all__``, the members of their classes, and how they are called.

A name that is renamed, dropped or called in another way breaks programs of others. Where that is meant, say it in
CHANGELOG.md and write the list again: ``python tests/house/test_api_surface.py --write``.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import griffe

ROOT = Path(__file__).parents[2]
SURFACE = Path(__file__).with_name("api_surface.json")


def surface() -> dict[str, str]:
    """Path of every public name -> what it is, as its source says it."""
    package = griffe.load("unshutter", search_paths=[ROOT / "src"])
    names = sorted(name for name in package.exports if name in package.members)
    return dict(entry for name in names for entry in described(f"unshutter.{name}", package[name]))


def described(path: str, item: griffe.Object | griffe.Alias) -> Iterator[tuple[str, str]]:
    """An object and, of a class, its public members, with what a class inherits; nothing imported."""
    item = item.final_target if isinstance(item, griffe.Alias) else item
    if isinstance(item, griffe.Class):
        yield path, " ".join(["class", *map(str, item.bases), called(item)]).strip()
    elif isinstance(item, griffe.Function):
        kind = [label for label in ("classmethod", "staticmethod") if label in item.labels]
        yield path, " ".join([*kind, called(item)])
    elif isinstance(item, griffe.Attribute):
        kind = ["property"] if "property" in item.labels else []
        said = f"{item.annotation}" if item.annotation else f"= {item.value}"
        yield path, " ".join([*kind, said])
    else:
        raise TypeError(f"{path} is neither a class, a function nor a value")
    inherited = item.inherited_members if isinstance(item, griffe.Class) else {}
    for name, member in {**item.members, **{name: each.final_target for name, each in inherited.items()}}.items():
        if not member.is_alias and member.is_public and not name.startswith("_"):
            yield from described(f"{path}.{name}", member)


def called(item: griffe.Class | griffe.Function) -> str:
    """Parameters and result, without the name."""
    return item.signature(return_type=True).removeprefix(item.name)


def test_the_public_api_is_what_is_written_down() -> None:
    written, found = json.loads(SURFACE.read_text()), surface()
    gone = [f"- {path}: {written[path]}" for path in written if found.get(path) != written[path]]
    new = [f"+ {path}: {found[path]}" for path in found if found[path] != written.get(path)]
    changes = "\n".join(sorted(gone + new, key=lambda line: (line[2:].partition(":")[0], line[0] == "+")))
    assert not changes, f"python tests/house/test_api_surface.py --write, where this is meant:\n{changes}"


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(__doc__)
    SURFACE.write_text(json.dumps(surface(), indent=1) + "\n")
