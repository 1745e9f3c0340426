"""Lists what is installed beside this interpreter, with licences, as Markdown; refuses what is under the (A)GPL.

    /path/to/python .ci/licences.py

The licence is what a package says of itself. What its wheel carries besides, libraries of others, is told by the names
of its files: encoders that are under the GPL are refused, too, unless KNOWN says where that is documented.
"""

from __future__ import annotations

import re
import sys
from importlib.metadata import Distribution, distributions

TOOLS = {"pip", "setuptools", "wheel"}  # of the environment, not asked for by unshutter
GPL_LIBRARIES = re.compile(r"lib(x264|x265|xvidcore|postproc)\b", re.IGNORECASE)
KNOWN = {"av": "extra `video` only; docs/guide/install.md says so"}
SILENT = {"OpenEXR": "BSD-3-Clause"}  # packages that leave it to their licence file, which has been read
_STRONG = re.compile(r"(?<![A-Za-z])A?GPL|GNU (Affero )?General Public", re.IGNORECASE)


def licence(package: Distribution) -> str:
    """What a package says of itself: its SPDX expression, else its classifiers, else the first line of its text."""
    about = package.metadata
    if about["License-Expression"]:
        return about["License-Expression"]
    kinds = [each.split(" :: ")[-1] for each in about.get_all("Classifier", []) if each.startswith("License ::")]
    kinds = [each for each in kinds if each != "OSI Approved"]
    text = (about["License"] or "").strip().partition("\n")[0]
    return "; ".join(kinds) or text or SILENT.get(package.name, "?")


def is_strong(terms: str) -> bool:
    """Whether terms leave no choice but the GPL or AGPL. The LGPL is none, nor is the GPL with an exception."""
    choices = re.split(r"\bOR\b", terms)
    return all(any(_STRONG.search(part) and " WITH " not in part for part in _all_of(each)) for each in choices)


def _all_of(choice: str) -> list[str]:
    return re.split(r"\bAND\b|;", choice)


def carried(package: Distribution) -> list[str]:
    """Libraries under the GPL among a package's files."""
    return sorted({found[0].lower() for file in package.files or () if (found := GPL_LIBRARIES.search(file.name))})


def main() -> None:
    refused = []
    print("| package | version | licence |\n|---|---|---|")
    for package in sorted(distributions(), key=lambda each: each.name.lower()):
        if package.name in TOOLS:
            continue
        terms, libraries = licence(package), carried(package)
        beside = f"; carries {', '.join(libraries)} (GPL)" if libraries else ""
        print(f"| {package.name} | {package.version} | {terms}{beside} |")
        if is_strong(terms) or terms == "?" or (libraries and package.name not in KNOWN):
            refused.append(package.name)
    if refused:
        sys.exit(f"licences: not to be shipped with, or unknown: {', '.join(refused)}")


if __name__ == "__main__":
    main()
