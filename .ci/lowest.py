"""Prints a constraint, name==version, for the oldest version of each library that pyproject.toml allows.

Tools of the tests (extras dev and docs) are left out, and torch: its old builds need another Python.
"""

import re
import tomllib
from pathlib import Path

TOOLS = {"dev", "docs"}
NEWEST_ONLY = {"torch"}

project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = project["optional-dependencies"]
libraries = project["dependencies"] + [each for name in sorted(extras.keys() - TOOLS) for each in extras[name]]
for library in libraries:
    name, lowest = re.fullmatch(r"([\w.-]+)(?:\[\w+\])?>=([\d.]+).*", library).groups()
    if name not in NEWEST_ONLY:
        print(f"{name}=={lowest}")
