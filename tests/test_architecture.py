"""The pages that are made from the code are up to date."""

import runpy
from importlib.util import find_spec
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent / "docs"


@pytest.mark.parametrize(
    ("script", "name"), [("architecture.py", "architecture.md"), ("options.py", "reference/options.md")]
)
def test_what_is_made_from_the_code_is_up_to_date(script: str, name: str) -> None:
    if script == "options.py" and find_spec("unshutter_lab") is None:
        pytest.skip("lists the commands of unshutter-lab, too")
    page = runpy.run_path(str(DOCS / script))["page"]
    assert (DOCS / name).read_text(encoding="utf-8") == page(), f"run python docs/{script}"
