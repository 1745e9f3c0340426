"""The first page of docs/results: one table of questions and two plots, from the CSV files next to it.

Called by result_pages.py; ``python lab/benchmarks/summary_page.py`` writes the table and the plots again by itself.
"""

from __future__ import annotations

import csv
import statistics
from dataclasses import dataclass
from pathlib import Path

from unshutter_lab.evaluation.plots import new_figure, save_figure

DOCS = Path("docs/results")
TEST = ("yorkurban", "eurasiancities", "urban100")
NAMES = {"yorkurban": "York Urban", "eurasiancities": "Eurasian Cities", "urban100": "Urban100"}
DEFAULT, NOTHING = "segment-manhattan", "none"
PLOTS = ("summary-error.png", "summary-harm.png")
_UNKNOWN = "–"


@dataclass(frozen=True)
class Question:
    """A row of the summary.

    Attributes:
        text: as a reader would ask it.
        measure: what the figures are.
        run: name of the CSV and of the page.
        places: (suite, photos) of each figure.
        column: heading in the CSV.
        form: of a figure.
        better: +1 where more is better, -1 where less is.
        several: methods that see several frames, which count as other methods here.
    """

    text: str
    measure: str
    run: str
    places: tuple[tuple[str, str], ...]
    column: str
    form: str = "{:.1f}"
    better: int = -1
    several: bool = False


def _of(suite: str, photos: tuple[str, ...] = TEST) -> tuple[tuple[str, str], ...]:
    return tuple((suite, name) for name in photos)


_ERROR, _MOVED, _GAIN = "EPE median", "moved > 1 px [%]", "PSNR gain [dB]"
_REAL = ("bsrsc", "fastec", "carla")
_LOGS = ("ios_gyro_100hz", "tumvi_room1_mocap_120hz", "phone_gyro_412hz")
_CITIES = "York Urban / Eurasian Cities / Urban100"
_SHAKEN = ("hand 20 ms", "hand 50 ms", "hand 100 ms", "pan 50 ms")
QUESTIONS = (
    Question(
        "On places, which anyone can measure on?", "mean error in px after `rectify`, hand of 20 / 50 / 100 ms, pan",
        "places", tuple((suite, "all") for suite in _SHAKEN), "EPE of rectify", "{:.2f}",
    ),
    Question("Does it straighten buildings?", f"error in px, {_CITIES}", "synthetic", _of("256 px"), _ERROR),
    Question("At full size?", f"error in px, {_CITIES}", "native", _of("native size"), _ERROR),
    Question("In portrait format?", f"error in px, {_CITIES}", "portrait", _of("native size"), _ERROR),
    Question(
        "Under recorded camera shake?", "error in px, readout of 20 / 50 / 100 ms", "trajectory",
        tuple((f"readout {ms} ms", "all") for ms in (20, 50, 100)), _ERROR, "{:.2f}",
    ),
    Question("With blur (1/60 s)?", f"error in px, {_CITIES}", "exposure", _of("1/60 s, 256 px"), _ERROR),
    Question("With roll and tilt known?", f"error in px, {_CITIES}", "attitude", _of("native size"), _ERROR),
    Question(
        "Does it leave good photos alone?", f"% moved, {_CITIES}", "undistorted", _of("native size"), _MOVED, "{:.0f}",
    ),
    Question(
        "And photos without buildings?", "% moved, of eight photos", "others", _of("native size", ("scikit-image",)),
        _MOVED, "{:.0f}",
    ),
    Question(
        "Real frames, from one photo?", "gain in dB, BS-RSC / Fastec / Carla", "pairs", _of("middle row", _REAL), _GAIN,
        "{:+.1f}", +1,
    ),
    Question(
        "Real frames, with their neighbours?", "gain in dB, BS-RSC / Fastec / Carla", "pairs", _of("middle row", _REAL),
        _GAIN, "{:+.1f}", +1, several=True,
    ),
    Question(
        "Sixty frames of a video?", "error in px, phone in hand / camera in hand / car mount", "sequences",
        _of("60 frames", _LOGS), _ERROR, "{:.2f}", several=True,
    ),
)  # fmt: skip
_Figures = dict[tuple[str, str, str], float]  # (suite, photos, method) -> figure


def summary(docs: Path) -> str:
    """The table of questions, and the plots, which it draws.

    Args:
        docs: folder of the CSV files; the plots are written there, too.
    """
    parts = [questions_table(docs)]
    for file, caption in _plots(docs):
        parts.append(f"![Plot]({file})\n\n*{caption}*")
    return "\n\n".join(parts)


def questions_table(docs: Path) -> str:
    """The table alone."""
    lines = ["| question | figure | nothing done | the default | best other method |", "|---" * 5 + "|"]
    for question in QUESTIONS:
        if cells := _cells(question, docs):
            lines.append(f"| [{question.text}]({question.run}.md) | {question.measure} | {' | '.join(cells)} |")
    return "\n".join(lines)


def figures(path: Path, column: str) -> _Figures:
    """Returns one column of a CSV file; empty if there is no such file or column."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    return {(r["suite"], r["photos"], r["estimator"]): float(r[column]) for r in rows if r.get(column)}


def _cells(question: Question, docs: Path) -> list[str]:
    """Nothing done, the default, the best other method; none where the default was not measured."""
    known = figures(docs / f"{question.run}.csv", question.column)
    methods = list(dict.fromkeys(name for _, _, name in known))
    rows = {name: [known.get((*place, name)) for place in question.places] for name in methods}
    whole = {name: [v for v in row if v is not None] for name, row in rows.items() if None not in row}
    if DEFAULT not in whole:
        return []
    single = {name: row for name, row in whole.items() if name not in (DEFAULT, NOTHING) and _single(name)}
    frames = {name: row for name, row in whole.items() if name.startswith("frames") and "," not in name}
    others = frames if question.several else single
    best = max(others, key=lambda name: (question.better * statistics.fmean(others[name]), -len(name)), default=None)
    shown = [_text(question, whole.get(NOTHING)), _text(question, whole[DEFAULT])]
    return [*shown, f"{_text(question, others[best])} (`{best}`)" if best else _UNKNOWN]


def _single(name: str) -> bool:
    """Whether a method sees one photo and does not know the truth."""
    return not name.startswith(("frames", "true", "ceiling", "rssr", "sunet"))


def _text(question: Question, row: list[float] | None) -> str:
    if row is None:
        return _UNKNOWN
    if question.run == "others":
        row = [statistics.fmean(row)]
    return " / ".join(question.form.format(value) for value in row)


def _plots(docs: Path) -> list[tuple[str, str]]:
    """(file, caption) of the plots that the measurements allow."""
    error = figures(docs / "synthetic.csv", _ERROR)
    improved = figures(docs / "synthetic.csv", "improved by rectify [%]")
    moved = figures(docs / "undistorted.csv", _MOVED)
    methods = [name for suite, photos, name in error if (suite, photos) == ("256 px", TEST[0])]
    if not methods or not moved:
        return []
    figure, axes = new_figure(3, 3.2)
    for axis, photos in zip(axes[0], TEST, strict=True):
        values = [error["256 px", photos, name] for name in methods]
        colours = ["tab:blue" if name == DEFAULT else "0.5" if name == NOTHING else "tab:cyan" for name in methods]
        axis.barh(range(len(methods)), values, color=colours)
        axis.set(title=NAMES[photos], yticks=range(len(methods)), xlabel="median error [px of 256 rows]")
        axis.set_yticklabels(methods if photos == TEST[0] else [])
        axis.invert_yaxis()
    save_figure(figure, docs / PLOTS[0])
    figure, axes = new_figure(1, 4.0)
    figure.set_size_inches(8, 4)
    points = {
        name: tuple(
            statistics.fmean(known[suite, photos, name] for photos in TEST)
            for known, suite in ((moved, "native size"), (improved, "256 px"))
        )
        for name in methods
        if name != NOTHING
    }
    for name, (x, y) in points.items():
        axes[0, 0].plot(x, y, "o", color="tab:blue" if name == DEFAULT else "0.4")
        has_neighbour = any(x < other_x < x + 20 and abs(other_y - y) < 2 for other_x, other_y in points.values())
        side, shift = ("right", -7) if has_neighbour else ("left", 7)
        axes[0, 0].annotate(name, (x, y), (shift, -3), textcoords="offset points", ha=side, fontsize=9)
    axes[0, 0].set(xlabel="undistorted photos that rectify moves [%]", ylabel="distorted photos that it improves [%]")
    axes[0, 0].set(xlim=(-3, 130), ylim=(50, 95), xticks=range(0, 101, 20))
    save_figure(figure, docs / PLOTS[1])
    return [
        (PLOTS[0], "How much distortion is left? Median error of distorted photos of buildings, at 256 px."),
        (PLOTS[1], "What does the benefit cost? `rectify` by each method, means of the test sets; best is top left."),
    ]


if __name__ == "__main__":
    print(summary(DOCS))
