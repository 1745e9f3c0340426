"""Results as tables, based on the records alone: in full as Markdown or CSV, or short, with the main figures."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from unshutter_lab.evaluation.pair_cases import PUBLISHED
from unshutter_lab.evaluation.protocols import PROTOCOLS
from unshutter_lab.evaluation.results import Results

# kind of a run -> titles of the figures in its short tables
SHORT = {
    "motion": ("EPE median", "improved"),
    "still": ("moved > 1 px",),
    "pairs": ("PSNR gain",),
    "sequences": ("EPE median",),
    "video": ("\\|R_F\\|",),
}
# kind of a run -> (titles, legend) of each of its short tables, if it has several
STACKED = {
    "places": (
        (
            ("EPE of rectify",),
            "**What `rectify` leaves**: mean EPE in px of 256 rows. Pictures left unchanged count as they are.",
        ),
        (
            ("better by rectify", "worse by rectify"),
            "**Benefit and harm**: the shares of pictures that `rectify` brings closer to the truth by more than half "
            "a pixel, and that it takes farther away from it.",
        ),
    ),
}
LEGENDS = {
    "places": "Columns are suites, rows methods.",
    "motion": "Median EPE in px of 256 rows, and the share of pictures improved.",
    "still": "Share of the photos in which `rectify` would move something by more than 1 px.",
    "pairs": "Mean gain in PSNR over the unchanged frame.",
    "sequences": "Median EPE in px of 256 rows.",
    "video": "Mean |R_F|.",
    "rendered clips": "PSNR of still surfaces [dB]; in brackets, the share of the exact map's gain.",
    "real clips": "**What unshutter does**: pixels before and after; in brackets t.",
}
_UNKNOWN = "–"
_FIGURE = re.compile(r"(?P<number>[+-]?[\d.]+) ?(?P<unit>px|dB|°|%)?")
_PLACE = ["suite", "photos", "estimator"]
CLEARLY = 0.5  # px at 256 rows: a photo is clearly better or worse if its EPE changed by more
HARM = (1, 3)  # px at 256 rows: a measurable change of an undistorted photo, and a clearly visible one
_TEXTS = ["declined", "failed", "left_alone"]
_FIGURES = ["epe", "epe_nothing", "worst_epe", "epe_best", "curvature_epe", "tx_rmse", "rz_rmse"]
_FIGURES += ["most_tx", "most_rz", "farthest"]
_FIGURES += [f"{score}{of}" for score in ("psnr", "ssim") for of in ("", "_input", "_oracle")]
_FIGURES += ["ratio_told", "ratio_error", "ratio_within", "ratio_covered", "inliers", "inliers_input", "matches"]


@dataclass(frozen=True)
class Table:
    """A table of text cells."""

    suite: str  # suite on which the figures were measured
    titles: list[str]  # titles of the columns; the first two are ``photos`` and ``estimator``
    rows: list[list[str]]  # the cells

    @property
    def markdown(self) -> str:
        """The table in Markdown."""
        lines = [f"| {' | '.join(cells)} |" for cells in (self.titles, *self.rows)]
        return "\n".join([lines[0], "|---" * len(self.titles) + "|", *lines[1:]])

    def figures(self, titles: tuple[str, ...]) -> dict[str, dict[str, str]]:
        """Returns photos -> method -> the figures of these columns, as one text."""
        places = [self.titles.index(title) for title in titles]
        figures: dict[str, dict[str, str]] = {}
        for row in self.rows:
            figures.setdefault(row[0], {})[row[1]] = ", ".join(row[k] for k in places)
        return figures


def short_tables(tables: list[Table], kind: str) -> str:
    """Returns tables of methods against photos, one per suite; against suites if all photos are in one group."""
    if kind in STACKED:
        parts = []
        for titles, legend in STACKED[kind]:
            (group,) = {row[0] for table in tables for row in table.rows}
            parts += [legend, _matrix({table.suite: table.figures(titles)[group] for table in tables})]
        return "\n\n".join(parts)
    tables = [table for table in tables if SHORT[kind][0] in table.titles]
    groups = {row[0] for table in tables for row in table.rows}
    if groups == {"all"} or (len(groups) == 1 and len(tables) > 1):
        (group,) = groups
        return _matrix({table.suite: table.figures(SHORT[kind])[group] for table in tables})
    parts = []
    for table in tables:
        parts += [f"### {table.suite}"] if len(tables) > 1 else []
        parts.append(_matrix(table.figures(SHORT[kind])))
    return "\n\n".join(parts)


def _matrix(columns: dict[str, dict[str, str]]) -> str:
    names = list(dict.fromkeys(name for figures in columns.values() for name in figures))
    rows = [[name, *(figures.get(name, _UNKNOWN) for figures in columns.values())] for name in names]
    return Table("", ["estimator", *columns], rows).markdown


def as_csv(tables: list[Table]) -> str:
    """Returns all figures as CSV: a line per suite, set of photos and method, with units in the headings only."""
    cells: Any = pd.concat(
        [pd.DataFrame(table.rows, columns=table.titles).assign(suite=table.suite) for table in tables]
    )
    cells = cells.map(_plain, na_action="ignore").groupby(_PLACE, sort=False).first()
    cells.columns = [_with_unit(title, cells[title].dropna()) for title in cells]
    return cells.map(_number, na_action="ignore").to_csv(lineterminator="\n")


def _plain(text: str) -> str:
    return text.replace("*", "").replace("\\", "")


def _number(cell: str) -> str:
    """Returns the number in a cell; empty if unknown, the text if it is not a number."""
    figure = _FIGURE.fullmatch(cell)
    return figure["number"] if figure else cell.replace(_UNKNOWN, "")


def _with_unit(title: str, cells: Iterable[str]) -> str:
    units = {figure["unit"] for cell in cells if (figure := _FIGURE.fullmatch(cell)) and figure["unit"]}
    return f"{_plain(title)} [{units.pop()}]" if len(units) == 1 else _plain(title)


def _p90(figures: pd.Series) -> float:
    return figures.quantile(0.9)


@dataclass(frozen=True)
class Column:
    """One column: its figure is that of the row's records, or its ratio to another figure."""

    title: str
    key: str  # of :func:`judged`
    how: str | Callable[[pd.Series], float] = "median"  # pandas' name of an aggregation, or a function
    form: str = "{:.2f}"
    better: int = 0  # which direction is better (0: neither)
    per: str = ""  # divides by the same figure of this key
    of: str = ""  # divides by the figure of the row with this name

    def figures(self, rows: Any) -> Any:
        """Returns the figure of each group of pictures, by photos and estimator."""
        figures = rows[self.key].agg(self.how).astype(float)
        if self.per:
            figures = figures / rows[self.per].agg(self.how).clip(lower=1)
        if self.of:
            whole = figures[(figures > 0) & figures.index.isin([self.of], level=1)].droplevel(1)
            figures = figures / whole.reindex(figures.index.get_level_values(0)).to_numpy()
        return figures

    def text(self, value: float) -> str:
        """Returns the figure as printed."""
        return self.form.format(value) if np.isfinite(value) else _UNKNOWN


def judged(records: Any) -> Any:
    """Returns the figures of each picture, and what follows from them; NaN where records do not tell."""
    known = records.reindex(columns=list(dict.fromkeys([*records, *_TEXTS, *_FIGURES])))
    each = known.drop(columns=_TEXTS).assign(**known[_FIGURES].astype(float))
    left = (known["left_alone"] != "").where(known["left_alone"].notna()).astype(float)
    improved = (each["epe"] < each["epe_nothing"]).astype(float)
    gain = each["psnr"] - each["psnr_input"]
    each = each.assign(left=left, improved=improved, improved_by_rectify=improved * (1 - left), gain=gain)
    decided = each["epe"].where(left != 1, each["epe_nothing"])
    change = decided - each["epe_nothing"]
    known_change = change.notna()
    each = each.assign(decided=decided, changed=1 - left)
    each["helped"] = (change < -CLEARLY).astype(float).where(known_change)
    each["harmed"] = (change > CLEARLY).astype(float).where(known_change)
    each["better"] = (gain > 0).astype(float).where(gain.notna())
    for px in HARM:
        each[f"wrong_{px}"] = each["epe"] > px
        each[f"moved_{px}"] = (1 - left) * ~(each["farthest"] <= px)  # unknown: the farthest is not finite
    for key in ("declined", "failed"):
        each[key] = known[key].astype(object).fillna("").astype(bool)
    for key in sorted(key for key in records if key.startswith(PUBLISHED)):
        each[f"above {key.removeprefix(PUBLISHED)}"] = each["psnr"] - each[key].astype(float)
    return each


_PICTURES = Column("pictures", "estimator", "size", "{:.0f}")
_DECLINED = Column("declined", "declined", "mean", "{:.0%}")
_FAILED = Column("failed", "failed", "mean", "{:.0%}")
_LEFT_ALONE = Column("left alone", "left", "mean", "{:.0%}")
_QUALITY = [
    Column("PSNR", "psnr", "mean", "{:.2f} dB", +1),
    Column("PSNR of the input", "psnr_input", "mean", "{:.2f} dB"),
    Column("PSNR gain", "gain", "mean", "{:+.2f} dB", +1),
    Column("SSIM", "ssim", "mean", "{:.3f}", +1),
    Column("SSIM of the input", "ssim_input", "mean", "{:.3f}"),
]
_EPE = Column("EPE median", "epe", better=-1)
_EPE_P90 = Column("EPE p90", "epe", _p90, better=-1)
_IMPROVED = Column("improved", "improved", "mean", "{:.0%}", +1)
COLUMNS: dict[str, list[list[Column]]] = {
    "places": [
        [
            _PICTURES,
            Column("EPE of doing nothing", "epe_nothing", "mean"),
            Column("EPE mean", "epe", "mean", better=-1),
            _EPE,
            Column("curvature EPE", "curvature_epe", better=-1),
            Column("EPE of rectify", "decided", "mean", better=-1),
            Column("changed by rectify", "changed", "mean", "{:.0%}"),
            Column("better by rectify", "helped", "mean", "{:.0%}", +1),
            Column("worse by rectify", "harmed", "mean", "{:.0%}", -1),
            Column("EPE of the best candidate", "epe_best", "mean", better=-1),
            _DECLINED,
            _FAILED,
        ]
    ],
    "motion": [
        [
            _PICTURES,
            _EPE,
            Column("EPE mean", "epe", "mean", better=-1),
            _EPE_P90,
            _IMPROVED,
            Column("curvature EPE", "curvature_epe", better=-1),
            Column("t_x RMSE", "tx_rmse", form="{:.2f} px", better=-1),
            Column("r_z RMSE", "rz_rmse", form="{:.2f}°", better=-1),
            _LEFT_ALONE,
            Column("improved by rectify", "improved_by_rectify", "mean", "{:.0%}", +1),
            _DECLINED,
            _FAILED,
        ],
        [
            *_QUALITY[:3],
            Column("PSNR, true motion", "psnr_oracle", "mean", "{:.2f} dB"),
            *_QUALITY[3:],
            Column("SSIM, true motion", "ssim_oracle", "mean", "{:.3f}"),
        ],
    ],
    "still": [
        [
            _PICTURES,
            Column("max\\|t_x\\| median", "most_tx", form="{:.2f} px", better=-1),
            Column("max\\|t_x\\| p90", "most_tx", _p90, "{:.2f} px", -1),
            Column("max\\|r_z\\| median", "most_rz", form="{:.2f}°", better=-1),
            Column("max\\|r_z\\| p90", "most_rz", _p90, "{:.2f}°", -1),
            _EPE,
            *(Column(f"EPE > {px} px", f"wrong_{px}", "mean", "{:.0%}", -1) for px in HARM),
            _LEFT_ALONE,
            *(Column(f"moved > {px} px", f"moved_{px}", "mean", "{:.0%}", -1) for px in HARM),
            _DECLINED,
            _FAILED,
        ]
    ],
    "pairs": [
        [
            _PICTURES,
            *_QUALITY[:3],
            Column("gain / ceiling's", "gain", "mean", "{:.0%}", +1, of="ceiling"),
            Column("better than the input", "better", "mean", "{:.0%}", +1),
            *_QUALITY[3:],
            _DECLINED,
            _FAILED,
        ]
    ],
    "sequences": [
        [
            Column("sequences", "estimator", "size", "{:.0f}"),
            _EPE,
            _EPE_P90,
            Column("worst frame", "worst_epe", _p90, better=-1),
            Column("EPE of doing nothing", "epe_nothing"),
            _IMPROVED,
            Column("ratio found", "ratio_told", "mean", "{:.0%}"),
            Column("ratio error median", "ratio_error", form="{:.3f}", better=-1),
            Column("ratio error p90", "ratio_error", _p90, "{:.3f}", -1),
            Column("ratio within 0.1", "ratio_within", "mean", "{:.0%}", +1),
            Column("ratio covered", "ratio_covered", "mean", "{:.0%}"),
            _FAILED,
        ]
    ],
    "rendered clips": [
        [
            Column("shift", "shift_px", form="{:.1f} px"),
            Column("PSNR", "psnr", form="{:.2f} dB", better=+1),
            Column("PSNR gain", "gain", form="{:+.2f} dB", better=+1),
            Column("share of the exact map's", "share", form="{:.3f}"),
            Column("least gain of a frame", "least", form="{:+.2f} dB"),
            Column("PSNR of whole pictures", "psnr_whole", form="{:.2f} dB", better=+1),
            Column("share of whole pictures", "share_whole", form="{:.3f}"),
            Column("true readout", "true_ms", form="{:.1f} ms"),
            Column("readout found", "readout_ms", form="{:.1f} ms"),
            Column("its error", "readout_error_ms", form="{:.1f} ms"),
            Column("corner off by", "corner_px", form="{:+.1f} px"),
            Column("straightened", "straightened", form="{:.0%}"),
        ]
    ],
    "real clips": [
        [
            Column("rms", "rms", form="{:.2f} px", better=-1),
            Column("95 %", "usual", form="{:.2f} px", better=-1),
            Column("largest", "largest", form="{:.2f} px", better=-1),
            Column("worse", "worse", form="{:.0f}"),
            Column("sharpness", "sharpness", better=+1),
            Column("ratio", "ratio", form="{:.3f}"),
            Column("t", "ratio_t", form="{:.0f}"),
            Column("explained by the ratio", "explained", form="{:.2f} px"),
            Column("readout found", "readout_ms", form="{:.1f} ms"),
            Column("its error", "readout_error_ms", form="{:.1f} ms"),
            Column("straightened", "straightened", form="{:.0%}"),
        ]
    ],
    "video": [
        [
            _PICTURES,
            Column("\\|R_F\\|", "inliers", "mean", "{:.1f}", +1),
            Column("\\|R_F\\| of the input", "inliers_input", "mean", "{:.1f}"),
            Column("share of matches", "inliers", "sum", "{:.1%}", +1, per="matches"),
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
    photos = "all" if protocol.rows == "suite" else results.frame[protocol.rows]
    pictures = judged(results.frame).assign(photos=photos)
    above = [Column(key, key, "mean", "{:+.2f} dB", +1) for key in pictures if key.startswith("above ")]
    order = pd.MultiIndex.from_product([pictures["photos"].unique(), results.names])
    parts = []
    for suite, of_suite in pictures.groupby("suite", sort=False):
        for columns in COLUMNS[protocol.kind]:
            columns = [*columns, *above]
            rows = of_suite.groupby(["photos", "estimator"], sort=False)
            figures = {column.title: column.figures(rows) for column in columns}
            figures = pd.DataFrame(figures).reindex(order[order.isin(list(rows.groups))])
            if figures.iloc[:, 0].notna().any():
                parts.append(_table(str(suite), figures, columns, results.estimators))
    return parts


def _table(suite: str, figures: Any, columns: list[Column], estimators: list[str]) -> Table:
    """Returns the rows as text; the best figures of each block of photos, of at least two estimators, in bold."""
    ours = figures[figures.index.isin(estimators, level=1)]
    several = ours.groupby(level=0).transform("size") > 1
    cells = pd.DataFrame({column.title: figures[column.title].map(column.text) for column in columns})
    for column in (column for column in columns if column.better):
        text = cells.loc[ours.index, column.title]
        best = ours[column.title].groupby(level=0).transform("max" if column.better > 0 else "min")
        is_best = several & best.notna() & (text == best.map(column.text))
        cells.loc[ours.index[is_best], column.title] = "**" + text[is_best] + "**"
    names = [(photos, name if name in estimators else f"*{name}*") for photos, name in figures.index]
    rows = [[*place, *texts] for place, texts in zip(names, cells.to_numpy().tolist(), strict=True)]
    return Table(suite, ["photos", "estimator", *cells.columns], rows)
