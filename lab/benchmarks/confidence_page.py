"""Writes docs/results/confidence.md: how well stated confidences match the share of right answers.

Called by result_pages.py; nothing in it is typed but the explanations.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unshutter_lab.evaluation.plots import styles_of
from unshutter_lab.evaluation.reliability import ENOUGH, Bin, Judged, draw_reliability, mean_gap, widest
from unshutter_lab.evaluation.results import Results
from unshutter_lab.evaluation.tables import Table, as_csv

PAGE = "confidence.md"
CSV = "confidence.csv"
PLOT = "confidence-reliability.png"
RUNS = ("synthetic", "undistorted")
SUITE = "256 px"  # of both runs
DROPPED, AIM = 0.2, 0.3  # of the pictures; of their mean EPE
AIM_GAP = 0.05  # between the confidences of a bin and the share that is right
ALL = "all"
_Groups = dict[str, dict[str, Judged]]  # folder, and ALL -> estimator with a confidence -> its pictures

CAPTION = (
    "Reliability diagram: the share of pictures whose answer is right against the confidence stated, in "
    "ten bins. The area of a dot is the number of pictures, the line through it the 95 % interval. Above the grey line "
    "more answers are right than stated, below it fewer."
)
READING = (
    "A confidence is meant for photos with and without motion: judge it by the panel *half and half*. The intervals "
    "are a little too narrow, since each photo appears with several motions."
)


def write_confidence_page(runs: dict[str, Results], docs: Path) -> bool:
    """Writes the page and its plot; False where no confidence was measured on both kinds of pictures.

    Args:
        runs: name -> what it measured.
        docs: folder of the page.
    """
    if not set(RUNS) <= runs.keys():
        return False
    distorted, undistorted = (_judged(runs[name]) for name in RUNS)
    kinds = {"Distorted": distorted, "Undistorted": undistorted, "Half and half": _pooled(distorted, undistorted)}
    if not all(kind.get(ALL) for kind in kinds.values()):
        return False
    draw_reliability({kind: groups[ALL] for kind, groups in kinds.items()}, styles_of(runs["synthetic"]), docs / PLOT)
    parts = ["# Confidence", _about(list(distorted[ALL]))]
    parts += ["## Stated and true shares", f"![Plot]({PLOT})\n\n*{CAPTION}*", READING]
    gaps = [_gaps(kind, groups) for kind, groups in kinds.items()]
    drops = [_drops(kind, groups) for kind, groups in kinds.items()]
    (docs / CSV).write_text(as_csv([*gaps, *drops]))
    parts += [_gap_words(), _of_all(gaps)]
    parts += [f"## Without the {DROPPED * 100:.0f} % that are trusted least", _bounds(kinds), _of_all(drops)]
    pages = " and ".join(f"[{name}]({name}.md)" for name in RUNS)
    parts += [f"[All figures, folder by folder, as CSV]({CSV}). Measured by the commands of {pages}."]
    (docs / PAGE).write_text("\n\n".join([*parts, "[All results](index.md)"]) + "\n")
    return True


def _judged(results: Results) -> _Groups:
    places = {group: {"group": group} for group in results.distinct("group")} | {ALL: {}}
    groups: _Groups = {}
    for photos, criteria in places.items():
        for name in results.estimators:
            records = results.chosen(suite=SUITE, estimator=name, **criteria)
            if "confidence" in records and records["confidence"].notna().any():
                groups.setdefault(photos, {})[name] = Judged.of(records)
    return groups


def _pooled(distorted: _Groups, undistorted: _Groups) -> _Groups:
    pooled: _Groups = {}
    for photos in distorted:
        if photos not in undistorted:
            continue
        still = undistorted[photos]
        pooled[photos] = {n: judged.pooled_with(still[n]) for n, judged in distorted[photos].items() if n in still}
    return pooled


def _about(names: list[str]) -> str:
    listed = ", ".join(f"`{name}`" for name in names)
    return (
        f"Some methods ({listed}) state a [confidence](../reference/glossary.md) with each motion. This page compares "
        f"it with the errors measured on the {SUITE} pictures of [synthetic](synthetic.md) (distorted) and of "
        "[undistorted](undistorted.md), and on both together, where each kind counts as a half."
    )


def _gap_words() -> str:
    return (
        "[What the columns mean](../reference/conventions.md#what-is-measured); the *largest gap* is that of the worst "
        f"bin with at least {ENOUGH} pictures. Bold: the aim, at most {AIM_GAP:g}, is reached."
    )


def _gaps(kind: str, groups: _Groups) -> Table:
    """How far stated and true shares are apart: a row for each folder and method."""
    rows = []
    for photos, methods in groups.items():
        for name, judged in methods.items():
            answered, bins = judged.answered, judged.bins()
            both = (answered.stated, answered.right_share) if bins else ()
            cells = [photos, name, f"{len(answered)}", *([f"{share:.2f}" for share in both] or ["–", "–"])]
            rows.append([*cells, f"{mean_gap(bins):.2f}" if bins else "–", *_worst(widest(bins))])
    titles = ["photos", "estimator", "answered", "mean confidence", "right"]
    return Table(kind.lower(), [*titles, "mean gap", "largest gap", "in the bin", "of pictures"], rows)


def _of_all(tables: list[Table]) -> str:
    """One table with the rows of all folders together, and the kind of photos in the place of the folder."""
    rows = [[table.suite, *row[1:]] for table in tables for row in table.rows if row[0] == ALL]
    return Table("", tables[0].titles, rows).markdown


def _worst(worst: Bin | None) -> list[str]:
    """Gap of the worst bin, bold where even that is small enough; its bounds and pictures."""
    if worst is None:
        return ["–"] * 3
    gap, reached = f"{worst.gap:+.2f}", abs(float(f"{worst.gap:.2f}")) <= AIM_GAP
    return [f"**{gap}**" if reached else gap, f"{worst.low:.1f} to {worst.high:.1f}", f"{worst.count}"]


def _bounds(kinds: dict[str, _Groups]) -> str:
    """What can be gained at most, from the least to the most of all folders and methods."""
    said = []
    for kind, groups in kinds.items():
        best = [_best(judged) for rows in groups.values() for judged in rows.values()]
        known = [100 * value for value in best if np.isfinite(value)]
        if known:
            ends = dict.fromkeys(f"{value:.0f}" for value in (min(known), max(known)))
            said.append(f"{kind.lower()} {' to '.join(ends)} %")
    return (
        "*Drop* is by how much the mean EPE falls, *perfect order* by how much it would fall without the pictures with "
        f"the largest true errors (by folder: {', '.join(said)}). Declined photos count as the least trusted; "
        f"*answered only* is the drop without them. Bold: the aim, {AIM * 100:.0f} %, is reached."
    )


def _drops(kind: str, groups: _Groups) -> Table:
    """What dropping gains: a row for each folder and method."""
    rows = []
    for photos, methods in groups.items():
        for name, judged in methods.items():
            kept = judged.mean_without(DROPPED)
            drop, best = _share(judged, kept), _best(judged)
            cells = [f"{len(judged)}", f"{judged.declined:.0%}", f"{judged.mean:.2f}", f"{kept:.2f}"]
            cells += [f"**{_percent(drop)}**" if drop >= AIM else _percent(drop), _percent(best)]
            cells.append(_percent(_share(judged.answered, judged.answered.mean_without(DROPPED))))
            rows.append([photos, name, *cells])
    titles = ["photos", "estimator", "pictures", "declined", "mean EPE", "without"]
    return Table(kind.lower(), [*titles, "drop", "perfect order", "answered only"], rows)


def _best(judged: Judged) -> float:
    return _share(judged, judged.best_without(DROPPED))


def _share(judged: Judged, kept: float) -> float:
    """By which share of itself the mean EPE falls; NaN where there is no error at all."""
    return 1 - kept / judged.mean if judged.mean else float("nan")


def _percent(value: float) -> str:
    return f"{value:.0%}" if np.isfinite(value) else "–"
