"""docs/architecture.md says of each module what the module says of itself."""

import runpy
from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs"


def test_the_table_of_modules_is_up_to_date() -> None:
    page = runpy.run_path(str(DOCS / "architecture.py"))["page"]
    assert (DOCS / "architecture.md").read_text(encoding="utf-8") == page(), "run python docs/architecture.py"
