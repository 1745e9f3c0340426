"""The version is the same wherever it is written."""

import re
from pathlib import Path

import unshutter

ROOT = Path(__file__).parents[2]


def test_citation_and_changes_name_this_version() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", citation, re.MULTILINE) == [unshutter.__version__]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.findall(r"^## ([\d.]+)", changes, re.MULTILINE)[0]
    assert newest == unshutter.__version__
