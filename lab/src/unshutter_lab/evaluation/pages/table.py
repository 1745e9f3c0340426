"""A table of text cells: in full as Markdown or CSV, or short, with the most important figures."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass

# kind of a run -> titles of the figures in its short tables
SHORT = {
    "motion": ("EPE median", "improved"),
    "still": ("moved > 1 px",),
    "pairs": ("PSNR gain",),
    "sequences": ("EPE median",),
    "video": ("\\|R_F\\|",),
}
_UNKNOWN = "–"
_FIGURE = re.compile(r"(?P<number>[+-]?[\d.]+) ?(?P<unit>px|dB|°|%)?")


@dataclass(frozen=True)
class Table:
    """A table of text cells.

    Attributes:
        suite: suite on which the figures were measured.
        titles: titles of the columns; the first two are ``photos`` and ``estimator``.
        rows: the cells.
    """

    suite: str
    titles: list[str]
    rows: list[list[str]]

    @property
    def markdown(self) -> str:
        """The table in Markdown."""
        lines = [f"| {' | '.join(cells)} |" for cells in (self.titles, *self.rows)]
        return "\n".join([lines[0], "|---" * len(self.titles) + "|", *lines[1:]])


def short_tables(tables: list[Table], kind: str) -> str:
    """Returns tables of methods against photos, one per suite; against suites if photos are pooled."""
    tables = [table for table in tables if SHORT[kind][0] in table.titles]
    if all({row[0] for row in table.rows} == {"all"} for table in tables):
        return _matrix({table.suite: _figures(table, SHORT[kind])["all"] for table in tables})
    several = len(tables) > 1
    parts = []
    for table in tables:
        parts += [f"### {table.suite}"] if several else []
        parts.append(_matrix(_figures(table, SHORT[kind])))
    return "\n\n".join(parts)


def legend(kind: str) -> str:
    """Describes the cells of short tables."""
    return {
        "motion": "Median EPE in px of 256 rows, and the share of pictures improved.",
        "still": "Share of the photos in which `rectify` would move something by more than 1 px.",
        "pairs": "Mean gain in PSNR over the unchanged frame.",
        "sequences": "Median EPE in px of 256 rows.",
        "video": "Mean |R_F|.",
    }[kind]


def as_csv(tables: list[Table]) -> str:
    """Returns all figures as CSV: a line per suite, set of photos and method, with units in the headings only."""
    rows: dict[tuple[str, ...], dict[str, str]] = {}
    cells: dict[str, list[str]] = {}
    for table in tables:
        for row in table.rows:
            figures = dict(zip(table.titles[2:], row[2:], strict=True))
            rows.setdefault((table.suite, row[0], _plain(row[1])), {}).update(figures)
            for title, cell in figures.items():
                cells.setdefault(title, []).append(cell)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["suite", "photos", "estimator", *(_with_unit(title, texts) for title, texts in cells.items())])
    writer.writerows([*keys, *(_number(known.get(title, "")) for title in cells)] for keys, known in rows.items())
    return stream.getvalue()


def _figures(table: Table, titles: tuple[str, ...]) -> dict[str, dict[str, str]]:
    """Returns photos -> method -> its figures, as one text."""
    places = [table.titles.index(title) for title in titles]
    figures: dict[str, dict[str, str]] = {}
    for row in table.rows:
        figures.setdefault(row[0], {})[row[1]] = ", ".join(row[k] for k in places)
    return figures


def _matrix(columns: dict[str, dict[str, str]]) -> str:
    names = list(dict.fromkeys(name for figures in columns.values() for name in figures))
    rows = [[name, *(figures.get(name, _UNKNOWN) for figures in columns.values())] for name in names]
    return Table("", ["estimator", *columns], rows).markdown


def _plain(text: str) -> str:
    return text.replace("*", "").replace("\\", "")


def _number(cell: str) -> str:
    """Returns the number in a cell; empty if unknown, the text if it is not a number."""
    cell = _plain(cell)
    figure = _FIGURE.fullmatch(cell)
    return figure["number"] if figure else cell.replace(_UNKNOWN, "")


def _with_unit(title: str, cells: list[str]) -> str:
    units = {figure["unit"] for cell in cells if (figure := _FIGURE.fullmatch(_plain(cell))) and figure["unit"]}
    return f"{_plain(title)} [{units.pop()}]" if len(units) == 1 else _plain(title)
