"""docs/guide/install.md lists what can be installed."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOR_DEVELOPERS = {"app", "dev", "docs"}


def test_all_are_in_one_extra_but_an_example_and_what_brings_torch() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (named,) = extras["all"]
    assert set(re.findall(r"\w+", named)) == extras.keys() - FOR_DEVELOPERS - {"all", "colmap", "ncore"} | {"unshutter"}


def test_every_extra_is_listed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    page = (ROOT / "docs" / "guide" / "install.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    assert listed == set(project["optional-dependencies"]) - FOR_DEVELOPERS
