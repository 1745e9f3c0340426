"""Prints constraints, name==version, for the tests with the oldest versions that both pyproject.toml allow.

    lowest.py libraries    the oldest version of each library of the product and the laboratory
    lowest.py tools        the versions in constraints.txt of all that is no such library

torch keeps its version of constraints.txt: older builds are for other Pythons.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
OF_TOOLS = {"all", "app", "dev", "docs"}  # extras that add no library of the product
PINNED = {"torch", "unshutter"}
# what the libraries ask for in turn: pip chooses
CHOSEN_BY_PIP = {"anyio", "dask", "h11"}


def lowest() -> dict[str, str]:
    """Library -> oldest version allowed."""
    required = []
    for folder in (ROOT / "lab", ROOT):
        project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        extras = project["optional-dependencies"]
        required += project["dependencies"] + [each for name in extras.keys() - OF_TOOLS for each in extras[name]]
    pairs = (re.fullmatch(r"([\w.-]+)(?:\[[\w,]+\])?>=([\d.]+).*", each).groups() for each in required)
    return {name: version for name, version in pairs if name not in PINNED}


def tools() -> dict[str, str]:
    """Everything else in constraints.txt -> its version there."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = dict(line.split("==") for line in lines if line and not line.startswith("#"))
    return {name: pinned[name] for name in pinned.keys() - lowest().keys() - CHOSEN_BY_PIP}


for name, version in sorted({"libraries": lowest, "tools": tools}[sys.argv[1]]().items()):
    print(f"{name}=={version}")
