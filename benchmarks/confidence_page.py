"""The page docs/results/confidence.md: whether the confidences that estimators state are worth anything.

Called by result_pages.py; nothing in it is typed but the explanations.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unshutter.estimators.right_angles.search import HALF_TRUSTED
from unshutter.evaluation.pages.plots import looks_of
from unshutter.evaluation.pages.reliability import Judged, draw_reliability
from unshutter.evaluation.results import Results

PAGE = "confidence.md"
PLOT = "confidence-reliability.png"
RUNS = ("synthetic", "undistorted")
SUITE = "256 px"  # of both runs
DROPPED, AIM = 0.2, 0.3  # of the pictures; of their mean EPE
ALL = "all"
_Groups = dict[str, dict[str, Judged]]  # folder, and ALL -> estimator with a confidence -> its pictures

CAPTION = (
    "Mean EPE of pictures of about the same confidence, equally many to a dot, against the error that the confidence "
    "states. On the grey line they are equal."
)
READING = (
    "The error stated is a root mean square, which is never below the mean: dots a little below the line are as they "
    "should be; those above it were trusted too much. Pictures that were declined state nothing and are not among them."
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
    kinds = {"Distorted": distorted, "Undistorted": undistorted, "Half and half": _beside(distorted, undistorted)}
    if not all(kind.get(ALL) for kind in kinds.values()):
        return False
    draw_reliability({kind: groups[ALL] for kind, groups in kinds.items()}, looks_of(runs["synthetic"]), docs / PLOT)
    parts = ["# Confidence", _about(list(distorted[ALL]))]
    parts += [f"## Without the {DROPPED * 100:.0f} % that are trusted least", _bounds(kinds)]
    parts += [f"### {kind}\n\n{_drops(groups)}" for kind, groups in kinds.items()]
    parts += ["## Stated and measured errors", f"![{CAPTION}]({PLOT})\n\n*{CAPTION}*", READING]
    parts += ["## Measured by", *(f"```sh\n{runs[name].command}\n```" for name in RUNS)]
    (docs / PAGE).write_text("\n\n".join([*parts, "[All results](index.md)"]) + "\n")
    return True


def _judged(results: Results) -> _Groups:
    places = {group: {"group": group} for group in results.distinct("group")} | {ALL: {}}
    groups: _Groups = {}
    for photos, wanted in places.items():
        for name in results.estimators:
            records = results.chosen(suite=SUITE, estimator=name, **wanted)
            if any(record.get("confidence") is not None for record in records):
                groups.setdefault(photos, {})[name] = Judged.of(records)
    return groups


def _beside(distorted: _Groups, undistorted: _Groups) -> _Groups:
    return {
        photos: {n: judged.beside(undistorted[photos][n]) for n, judged in rows.items() if n in undistorted[photos]}
        for photos, rows in distorted.items()
        if photos in undistorted
    }


def _about(names: list[str]) -> str:
    listed = ", ".join(f"`{name}`" for name in names)
    return (
        f"Some methods ({listed}) state a confidence with each motion: 1 / (1 + (e / {HALF_TRUSTED:g} px)²), where e "
        "is the error that they expect (root mean square, in pixels of 256 rows). Here it is compared with the errors "
        f"that were found, on the {SUITE} pictures of [synthetic](synthetic.md) (distorted) and of "
        "[undistorted](undistorted.md), and on both together. There each kind counts as a half, as in an archive of "
        "which only some photos are distorted.\n\n"
        "A photo that was declined is left as it is and has no confidence. It is trusted least of all, for the method "
        "says that it does not know. Of photos with equal confidence at the border of what is dropped, each is dropped "
        "in part, so that the order of files has no say."
    )


def _bounds(kinds: dict[str, _Groups]) -> str:
    """What can be gained at most, from the least to the most of all folders and methods."""
    said = []
    for kind, groups in kinds.items():
        best = [_best(judged) for rows in groups.values() for judged in rows.values()]
        known = [100 * value for value in best if np.isfinite(value)]
        if known:
            said.append(f"{kind.lower()} {min(known):.0f} to {max(known):.0f} %")
    return (
        "*Drop* is by how much the mean EPE falls, *perfect order* by how much it would fall without the pictures with "
        f"the largest true errors. No confidence can do better than that: {', '.join(said)}.\n\n"
        "*Answered only* is the drop with declined photos left aside: what the confidence does by itself. "
        "In *all* the folders are pooled: there it counts, too, that a hard folder is told from an easy one. "
        f"Bold: the aim, {AIM * 100:.0f} %, is reached."
    )


def _drops(groups: _Groups) -> str:
    """A table with a row for each folder and method."""
    titles = ["photos", "estimator", "pictures", "declined", "mean EPE", "without"]
    titles += ["drop", "perfect order", "answered only"]
    lines = ["| " + " | ".join(titles) + " |", "|---" * len(titles) + "|"]
    for photos, rows in groups.items():
        for name, judged in rows.items():
            kept = judged.mean_without(DROPPED)
            drop, best = _share(judged, kept), _best(judged)
            cells = [f"{len(judged.epe)}", f"{judged.declined:.0%}", f"{judged.mean:.2f}", f"{kept:.2f}"]
            cells += [f"**{_percent(drop)}**" if drop >= AIM else _percent(drop), _percent(best)]
            cells.append(_percent(_share(judged.answered, judged.answered.mean_without(DROPPED))))
            lines.append(f"| {photos} | {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _best(judged: Judged) -> float:
    return _share(judged, judged.best_without(DROPPED))


def _share(judged: Judged, kept: float) -> float:
    """By which share of itself the mean EPE falls; NaN where there is no error at all."""
    return 1 - kept / judged.mean if judged.mean else float("nan")


def _percent(value: float) -> str:
    return f"{value:.0%}" if np.isfinite(value) else "–"
