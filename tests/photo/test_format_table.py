"""The table of docs/reference/formats.md says what is measured."""

import pytest

from support import format_table

NEEDED = {"HEIC": ("pi_heif", "pillow_heif"), format_table.RAW: ("rawpy", "tifffile")}


@pytest.mark.parametrize("column", format_table.COLUMNS)
def test_the_page_says_what_is_measured(column: str) -> None:
    for package in NEEDED.get(column, ()):
        pytest.importorskip(package, reason=f"{column} is measured with {package}")
    assert format_table.measured(column) == format_table.written()[column]


@pytest.mark.parametrize("output", format_table.OUTPUTS)
def test_the_page_says_what_becomes_of_hdr(output: str) -> None:
    for package in NEEDED["HEIC"]:
        pytest.importorskip(package, reason=f"HEIC is measured with {package}")
    told = format_table.written(format_table.HDR_BEGIN)
    assert format_table.measured(output, format_table.HDR_ROWS) == told[output]
    assert list(told) == list(format_table.OUTPUTS)


def test_the_page_has_every_format_and_nothing_else() -> None:
    written = format_table.written()
    assert list(written) == list(format_table.COLUMNS)
    assert all(list(cells) == list(format_table.ROWS) for cells in written.values())
