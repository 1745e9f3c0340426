"""Results as Markdown tables, based on the records alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from unshutter_lab.evaluation.cases.case import Record
from unshutter_lab.evaluation.cases.protocols import PROTOCOLS
from unshutter_lab.evaluation.cases.sequence import PUBLISHED
from unshutter_lab.evaluation.pages.table import Table
from unshutter_lab.evaluation.results import Results, values

_HARM = (1.0, 3.0)  # px at 256 rows: a measurable change of an undistorted photo, and a clearly visible one
_UNKNOWN = "–"


@dataclass(frozen=True)
class Column:
    """One column: heading, function for the cell of a row's records, and which direction is better (0: neither).

    With ``of``, the cell is divided by that of the row with this name.
    """

    title: str
    cell: Callable[[list[Record]], float]
    form: str = "{:.2f}"
    better: int = 0
    of: str | None = None

    def of_row(self, name: str, rows: dict[str, list[Record]]) -> float:
        """Returns the figure of a row, relative to another row if ``of`` is set."""
        value = self.cell(rows[name])
        if self.of is None:
            return value
        whole = self.cell(rows[self.of]) if self.of in rows else np.nan
        return value / whole if whole > 0 else np.nan

    def text(self, value: float) -> str:
        """Returns the figure as printed."""
        return self.form.format(value) if np.isfinite(value) else _UNKNOWN


def _median(key: str) -> Callable[[list[Record]], float]:
    return lambda records: float(np.median(v)) if len(v := values(records, key)) else np.nan


def _mean(key: str) -> Callable[[list[Record]], float]:
    return lambda records: float(v.mean()) if len(v := values(records, key)) else np.nan


def _p90(key: str) -> Callable[[list[Record]], float]:
    return lambda records: float(np.percentile(v, 90)) if len(v := values(records, key)) else np.nan


def _gain(key: str) -> Callable[[list[Record]], float]:
    """Returns the mean over pictures of the estimator's gain over the input on the same pixels."""

    def gain(records: list[Record]) -> float:
        both = [r for r in records if r.get(key) is not None and r.get(f"{key}_input") is not None]
        return float(np.mean([r[key] - r[f"{key}_input"] for r in both])) if both else np.nan

    return gain


def _better(key: str) -> Callable[[list[Record]], float]:
    """Returns the share of pictures that are better than the input, which excludes those left unchanged."""

    def better(records: list[Record]) -> float:
        both = [r for r in records if r.get(key) is not None and r.get(f"{key}_input") is not None]
        return float(np.mean([r[key] > r[f"{key}_input"] for r in both])) if both else np.nan

    return better


def _improved(record: Record) -> bool:
    return record["epe"] < record["epe_nothing"]


def _share(holds: Callable[[Record], bool]) -> Callable[[list[Record]], float]:
    return lambda records: float(np.mean([holds(r) for r in records]))


def _wrong(record: Record, px: float) -> bool:
    return record["epe"] > px


def _moved(record: Record, px: float) -> bool:
    """Whether any part of the picture moved by more than ``px``; None for the farthest means not finite."""
    return record["farthest"] is None or record["farthest"] > px


def _by_rectify(holds: Callable[[Record], bool]) -> Callable[[list[Record]], float]:
    """Returns the share of pictures that satisfy ``holds`` and that ``rectify`` would change; NaN for old records."""

    def share(records: list[Record]) -> float:
        known = all("left_alone" in r for r in records)
        return float(np.mean([not r["left_alone"] and holds(r) for r in records])) if known else np.nan

    return share


_PICTURES = Column("pictures", len, "{:.0f}")
_DECLINED = Column("declined", _share(lambda r: bool(r["declined"])), "{:.0%}")
_FAILED = Column("failed", _share(lambda r: bool(r["failed"])), "{:.0%}")
_LEFT_ALONE = Column("left alone", lambda records: 1 - _by_rectify(lambda r: True)(records), "{:.0%}")
_QUALITY = [
    Column("PSNR", _mean("psnr"), "{:.2f} dB", +1),
    Column("PSNR of the input", _mean("psnr_input"), "{:.2f} dB"),
    Column("PSNR gain", _gain("psnr"), "{:+.2f} dB", +1),
    Column("SSIM", _mean("ssim"), "{:.3f}", +1),
    Column("SSIM of the input", _mean("ssim_input"), "{:.3f}"),
]
COLUMNS: dict[str, list[list[Column]]] = {
    "motion": [
        [
            _PICTURES,
            Column("EPE median", _median("epe"), "{:.2f}", -1),
            Column("EPE mean", _mean("epe"), "{:.2f}", -1),
            Column("EPE p90", _p90("epe"), "{:.2f}", -1),
            Column("improved", _share(_improved), "{:.0%}", +1),
            Column("curvature EPE", _median("curvature_epe"), "{:.2f}", -1),
            Column("t_x RMSE", _median("tx_rmse"), "{:.2f} px", -1),
            Column("r_z RMSE", _median("rz_rmse"), "{:.2f}°", -1),
            _LEFT_ALONE,
            Column("improved by rectify", _by_rectify(_improved), "{:.0%}", +1),
            _DECLINED,
            _FAILED,
        ],
        [
            *_QUALITY[:3],
            Column("PSNR, true motion", _mean("psnr_oracle"), "{:.2f} dB"),
            *_QUALITY[3:],
            Column("SSIM, true motion", _mean("ssim_oracle"), "{:.3f}"),
        ],
    ],
    "still": [
        [
            _PICTURES,
            Column("max\\|t_x\\| median", _median("most_tx"), "{:.2f} px", -1),
            Column("max\\|t_x\\| p90", _p90("most_tx"), "{:.2f} px", -1),
            Column("max\\|r_z\\| median", _median("most_rz"), "{:.2f}°", -1),
            Column("max\\|r_z\\| p90", _p90("most_rz"), "{:.2f}°", -1),
            Column("EPE median", _median("epe"), "{:.2f}", -1),
            *(Column(f"EPE > {px:g} px", _share(partial(_wrong, px=px)), "{:.0%}", -1) for px in _HARM),
            _LEFT_ALONE,
            *(Column(f"moved > {px:g} px", _by_rectify(partial(_moved, px=px)), "{:.0%}", -1) for px in _HARM),
            _DECLINED,
            _FAILED,
        ]
    ],
    "pairs": [
        [
            _PICTURES,
            *_QUALITY[:3],
            Column("gain / ceiling's", _gain("psnr"), "{:.0%}", +1, of="ceiling"),
            Column("better than the input", _better("psnr"), "{:.0%}", +1),
            *_QUALITY[3:],
            _DECLINED,
            _FAILED,
        ]
    ],
    "sequences": [
        [
            Column("sequences", len, "{:.0f}"),
            Column("EPE median", _median("epe"), "{:.2f}", -1),
            Column("EPE p90", _p90("epe"), "{:.2f}", -1),
            Column("worst frame", _p90("worst_epe"), "{:.2f}", -1),
            Column("EPE of doing nothing", _median("epe_nothing"), "{:.2f}"),
            Column("improved", _share(_improved), "{:.0%}", +1),
            Column("ratio found", _mean("ratio_told"), "{:.0%}"),
            Column("ratio error median", _median("ratio_error"), "{:.3f}", -1),
            Column("ratio error p90", _p90("ratio_error"), "{:.3f}", -1),
            Column("ratio within 0.1", _mean("ratio_within"), "{:.0%}", +1),
            Column("ratio covered", _mean("ratio_covered"), "{:.0%}"),
            _FAILED,
        ]
    ],
    "video": [
        [
            _PICTURES,
            Column("\\|R_F\\|", _mean("inliers"), "{:.1f}", +1),
            Column("\\|R_F\\| of the input", _mean("inliers_input"), "{:.1f}"),
            Column(
                "share of matches",
                lambda rs: float(np.sum(values(rs, "inliers")) / max(np.sum(values(rs, "matches")), 1)),
                "{:.1%}",
                +1,
            ),
            _FAILED,
        ]
    ],
}


def tables(results: Results) -> str:
    """Returns all tables of a run as Markdown, with headings if there are several suites."""
    parts = all_tables(results)
    several = len({table.suite for table in parts}) > 1
    texts = []
    for k, table in enumerate(parts):
        if several and (k == 0 or parts[k - 1].suite != table.suite):
            texts.append(f"### {table.suite}")
        texts.append(table.markdown)
    return "\n\n".join(texts)


def all_tables(results: Results) -> list[Table]:
    """Returns all tables of a run."""
    protocol = PROTOCOLS[results.request.protocol]
    parts = []
    for suite in results.distinct("suite"):
        for columns in COLUMNS[protocol.kind]:
            if columns is COLUMNS["pairs"][0]:
                columns = [*columns, *_published(results)]
            blocks = [(group, results.chosen(suite=suite, group=group)) for group in results.distinct("group")]
            if not protocol.by_group:
                blocks = [("all", results.chosen(suite=suite))]
            if any(np.isfinite(c.cell(records)) for c in columns[:1] for _, records in blocks):
                parts.append(_table(suite, blocks, columns, results))
    return parts


def _published(results: Results) -> list[Column]:
    """Returns a column per other method: the gain over its published outputs."""
    keys = sorted({key for record in results.records for key in record if key.startswith(PUBLISHED)})
    return [Column(f"above {key.removeprefix(PUBLISHED)}", _lead(key), "{:+.2f} dB", +1) for key in keys]


def _lead(key: str) -> Callable[[list[Record]], float]:
    def lead(records: list[Record]) -> float:
        both = [r for r in records if r.get("psnr") is not None and r.get(key) is not None]
        return float(np.mean([r["psnr"] - r[key] for r in both])) if both else np.nan

    return lead


def marked(value: float, others: list[float], column: Column) -> str:
    """Returns a cell, in bold if no other in its column is better."""
    known = [v for v in others if np.isfinite(v)]
    best = known and column.better and column.text(value) == column.text((max if column.better > 0 else min)(known))
    return f"**{column.text(value)}**" if best else column.text(value)


def _table(suite: str, blocks: list[tuple[str, list[Record]]], columns: list[Column], results: Results) -> Table:
    """Returns rows of estimators for each block of records, best figures in bold."""
    lines = []
    for group, records in blocks:
        rows = {name: [r for r in records if r["estimator"] == name] for name in results.names}
        rows = {name: own for name, own in rows.items() if own}
        for name in rows:
            cells = []
            for column in columns:
                others = [column.of_row(n, rows) for n in results.estimators if n in rows]
                value = column.of_row(name, rows)
                ours = name in results.estimators and len(others) > 1
                cells.append(marked(value, others, column) if ours else column.text(value))
            lines.append([group, name if name in results.estimators else f"*{name}*", *cells])
    return Table(suite, ["photos", "estimator", *(column.title for column in columns)], lines)
