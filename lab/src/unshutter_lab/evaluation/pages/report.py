"""Writes the files of one run: results.md, results.json, results.csv, plots and contact sheets."""

from __future__ import annotations

from pathlib import Path

from unshutter.storage.files import written_whole
from unshutter_lab.evaluation.cases.case import Example
from unshutter_lab.evaluation.cases.protocols import PROTOCOLS
from unshutter_lab.evaluation.pages.plots import draw_plots
from unshutter_lab.evaluation.pages.sheets import write_sheet
from unshutter_lab.evaluation.pages.tables import tables
from unshutter_lab.evaluation.results import Results


def write_report(results: Results, examples: list[Example], folder: Path) -> None:
    """Writes tables, plots, contact sheets and figures of a run.

    Args:
        results: with the curves of the examples.
        examples: pictures to show.
        folder: an existing folder; files of an earlier report in it are replaced.

    Raises:
        UnshutterError: the folder is not writable.
    """
    sheets = []
    for k, example in enumerate(examples, start=1):
        write_sheet(example, folder / f"sheet_{k}.jpg")
        sheets.append((f"sheet_{k}.jpg", example.title))
    write_text(folder / "results.json", results.to_json() + "\n")
    write_text(folder / "results.csv", results.to_csv())
    write_text(folder / "results.md", page(results, draw_plots(results, folder), sheets))


def page(
    results: Results, plots: list[tuple[str, str]], sheets: list[tuple[str, str]], figures: str | None = None
) -> str:
    """Returns the Markdown page of one run.

    Args:
        results: results of the run.
        plots, sheets: (file, caption) of the pictures on the page.
        figures: Markdown that replaces the tables.
    """
    protocol = PROTOCOLS[results.request.protocol]
    parts = [f"# {protocol.title}", protocol.description, _counts(results), f"```sh\n{results.command}\n```"]
    parts.append(tables(results) if figures is None else figures)
    parts += [f"![{caption}]({file})\n\n*{caption}*" for file, caption in (*plots, *sheets)]
    return "\n\n".join(parts) + "\n"


def write_text(path: Path, text: str) -> None:
    """Writes a text file completely or not at all.

    Raises:
        UnshutterError: it cannot be written.
    """
    with written_whole(path) as part:
        part.write_text(text, encoding="utf-8")


def _counts(results: Results) -> str:
    """Describes the number of pictures per folder, and how they were selected."""
    photos = {group: len({(r["photo"]) for r in results.chosen(group=group)}) for group in results.distinct("group")}
    listed = ", ".join(f"{group} {count}" for group, count in photos.items())
    what = {"pairs": "Sequences", "video": "Sequences", "sequences": "Photos, seen by each log at each ratio"}.get(
        PROTOCOLS[results.request.protocol].kind, "Photos"
    )
    chosen = f" (at most {results.request.photos} of each folder, chosen by the seed)" if results.request.photos else ""
    return f"{what}: {listed}{chosen}. Seed {results.request.seed}."
