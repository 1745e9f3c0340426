"""The table of docs/reference/formats.md says what is measured."""

import pytest

from support import format_table

NEEDED = {"HEIC": ("pi_heif", "pillow_heif"), format_table.RAW: ("rawpy", "tifffile")}


@pytest.mark.parametrize("column", format_table.COLUMNS)
def test_the_page_says_what_is_measured(column: str) -> None:
    for package in NEEDED.get(column, ()):
        pytest.importorskip(package, reason=f"{column} is measured with {package}")
    assert format_table.measured(column) == format_table.written()[column]


def test_the_page_has_every_format_and_nothing_else() -> None:
    written = format_table.written()
    assert list(written) == list(format_table.COLUMNS)
    assert all(list(cells) == list(format_table.ROWS) for cells in written.values())
