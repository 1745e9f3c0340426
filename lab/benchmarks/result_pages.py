"""The pages of docs/results, from the JSON of ``unshutter evaluate``. Only reading.md and readings.toml are typed.

Called by results.py. A page and a CSV file for each run, a summary, run times, and contact sheets of the repository's
own photo.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
from confidence_page import PAGE as CONFIDENCE
from confidence_page import write_confidence_page
from summary_page import summary

from unshutter.errors import UnshutterError
from unshutter.single import Method
from unshutter_lab import methods
from unshutter_lab.evaluation.clip_tables import CLIP_TABLES
from unshutter_lab.evaluation.plots import draw_plots
from unshutter_lab.evaluation.protocols import PROTOCOLS
from unshutter_lab.evaluation.results import Results
from unshutter_lab.evaluation.run import page, write_text
from unshutter_lab.evaluation.tables import LEGENDS, Table, all_tables, as_csv, short_tables

READING = "reading.md"  # written by hand, kept
READINGS = "readings.toml"  # by hand, too: the line at the top of each page
KEPT = [READING, "paper-networks.md"]  # the latter is paper_networks.py's
# what ``unshutter models`` prints: file of a package -> whether it is the lab's
SCORES = {Path("src/unshutter/weights/scores.json"): False, Path("lab/src/unshutter_lab/weights/scores.json"): True}
LAB_METHODS = {method.name for method in vars(methods).values() if isinstance(method, Method)}
_ORDER = ("places", "synthetic", "native", "trajectory", "portrait", "exposure", "attitude", "undistorted", "others")
_ORDER += ("robustness", "pairs", "sequences", "video", "rendered-clips", "real-clips")
BACK = "[All results](index.md)"
ABOUT = (
    "Errors are the median EPE (the mean distance of pixels from where they belong), or its mean where stated, "
    "in pixels of a picture of 256 rows; gains are in PSNR over the unchanged frame. *Best other* is the method "
    "with the best mean. Each question leads to its page, with the command that measures it and all figures as CSV."
)
MORE = {
    "reading.md": "Which method for my photo, and how to read the figures",
    "robustness.md": "What JPEG, noise, blur and night cost",
    CONFIDENCE: "What a stated confidence is worth",
    "paper-networks.md": "Ablations of the paper's network",
    "video.md": "|R_F| over consecutive frames",
    "rendered-clips.md": "Rendered clips, and what the exact map gains",
    "real-clips.md": "Real clips, each of them, and FFmpeg's stabilisers",
    "walks.md": "What a rolling shutter costs a 3D model of a walk",
    "examples.md": "The same photo by every method, in pictures",
    "speed.md": "Run time and memory",
}
SHEETS = "examples"  # the only run whose pictures may be shown: the photo is in the public domain
# pages that say more than their protocol can: run -> (title, description)
TITLES = {
    "others": (
        "Photos that are not of buildings",
        "Sample photos of scikit-image, undistorted: every motion found is wrong.",
    ),
    "pairs": (
        "Real pairs",
        "Rolling-shutter frames, and what a global shutter saw at the moment of their first or middle row. The ceiling "
        "is the best cubic t_x and r_z, fitted to both.",
    ),
}


def write_pages(build: Path, docs: Path) -> None:
    """Writes docs/results again.

    Args:
        build: folder of the runs.
        docs: its files but reading.md and readings.toml are replaced.
    """
    try:
        runs = {path.parent.name: Results.load(path) for path in sorted(build.glob("*/results.json"))}
    except UnshutterError as error:
        sys.exit(f"results: {error}")
    if not runs:
        sys.exit(f"results: nothing measured yet in {build}: make results DATA=...")
    docs.mkdir(parents=True, exist_ok=True)
    for old in docs.iterdir():
        if old.name not in KEPT and old.suffix in (".md", ".csv", ".png", ".jpg"):
            old.unlink()
    order = [name for name in _ORDER if name in runs]
    short = tomllib.loads((docs / READINGS).read_text()) if (docs / READINGS).exists() else {}
    for name in order:
        (docs / f"{name}.md").write_text(_with_reading(_page(name, runs[name], docs), short.get(name)))
    if write_confidence_page(runs, docs):
        (docs / CONFIDENCE).write_text(_with_reading((docs / CONFIDENCE).read_text(), short.get("confidence")))
    _write_examples_and_speed(runs.get(SHEETS), build, docs)
    (docs / "index.md").write_text(_index({name: runs[name] for name in order}, docs))
    for path, of_lab in SCORES.items():
        if "synthetic" in runs and path.parent.is_dir():
            write_text(path, _scores(runs["synthetic"], of_lab))
    print(f"wrote {docs}/index.md and {len(order)} pages")


def _write_examples_and_speed(examples: Results | None, build: Path, docs: Path) -> None:
    if examples:
        (docs / "examples.md").write_text(_sheets(examples, build, docs))
    paths = [build / f"{name}.md" for name in ("estimators", "rectify", "clips")]
    timings = [path.read_text().strip() for path in paths if path.exists()]
    if timings:
        (docs / "speed.md").write_text("\n\n".join(["# Run time and memory", *timings, BACK]) + "\n")


def _scores(results: Results, of_lab: bool) -> str:
    """JSON: estimator of a package -> set of photos -> median EPE [px at 256 rows] and share of photos improved."""
    scores: dict[str, dict[str, dict[str, float]]] = {}
    for name in results.estimators:
        if (name in LAB_METHODS) != of_lab:
            continue
        for group in results.distinct("group"):
            error, nothing = (results.values(key, estimator=name, group=group) for key in ("epe", "epe_nothing"))
            figures = (round(float(np.median(error)), 2), round(float(np.mean(error < nothing)), 4))
            scores.setdefault(name, {})[group] = dict(zip(("epe_median", "improved"), figures, strict=True))
    return json.dumps(scores, indent=1) + "\n"


def write_page(name: str, results: Results, docs: Path) -> None:
    """Writes the page of one run, and its CSV."""
    short = tomllib.loads((docs / READINGS).read_text()) if (docs / READINGS).exists() else {}
    (docs / f"{name}.md").write_text(_with_reading(_page(name, results, docs), short.get(name)))


def _page(name: str, results: Results, docs: Path) -> str:
    """A page with short tables; all figures go into a CSV file of the same name."""
    every = all_tables(results)
    (docs / f"{name}.csv").write_text(as_csv(every))
    text = page(results, draw_plots(results, docs, f"{name}-"), [], figures_of(name, results, every))
    if name in TITLES:
        _, _, rest = text.split("\n\n", 2)
        title, description = TITLES[name]
        text = f"# {title}\n\n{description}\n\n{rest}"
    return f"{text}\n{BACK}\n"


def figures_of(name: str, results: Results, every: list[Table]) -> str:
    """Returns what stands between a page's command and its plots."""
    kind = PROTOCOLS[results.request.protocol].kind
    short = CLIP_TABLES[kind](results) if kind in CLIP_TABLES else short_tables(every, kind)
    return f"{LEGENDS[kind]} [All figures, as CSV]({name}.csv).\n\n{short}"


def _with_reading(text: str, line: str | None) -> str:
    """A page with its line below the title."""
    title, _, rest = text.partition("\n\n")
    return f"{title}\n\n**In short:** {line}\n\n{rest}" if line else text


def _index(runs: dict[str, Results], docs: Path) -> str:
    return "\n\n".join(["# Results", ABOUT, summary(docs), _links(docs), _intro(runs)]) + "\n"


def _links(docs: Path) -> str:
    """To the pages that no question of the summary leads to."""
    known = [f"* [{text}]({file})" for file, text in MORE.items() if (docs / file).exists()]
    return "## More\n\n" + "\n".join(known) if known else ""


def _intro(runs: dict[str, Results]) -> str:
    environment = next(iter(runs.values())).environment
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=Path(__file__).parent
    ).stdout.strip()
    versions = ", ".join(
        f"{name} {version}" for name, version in environment.items() if name not in ("code", "machine")
    )
    return (
        "`make benchmark METHODS=all` measures [places](places.md) from what is in the repository, and "
        "[your own method](../research/evaluate.md#a-method-of-yours-in-the-tables) with it. `make results DATA=...` "
        "measures all figures; its other photos are not part of the repository. No method was trained on any of "
        "these pictures.\n\n"
        f"Commit {commit} (code {environment.get('code', '?')}), {environment.get('machine', '?')}, {versions}."
    )


def _sheets(examples: Results, build: Path, docs: Path) -> str:
    parts = [
        "# Results in pictures",
        "The photo, by Berthold Werner, shows the Constantine Basilica in Trier and is in the public domain. Above "
        "each picture stand the method and its EPE.",
        f"```sh\n{examples.command}\n```",
    ]
    for sheet in sorted((build / SHEETS).glob("sheet_*.jpg")):
        shutil.copy(sheet, docs / f"example-{sheet.name}")
        parts.append(f"![Input, the result of each method, and the truth](example-{sheet.name})")
    curves = [file for file, _ in draw_plots(examples, docs, "example-") if file.endswith("curves.png")]
    parts += [f"![Motions found and true, of the pictures above]({file})" for file in curves]
    for name in ("epe", "size"):
        (docs / f"example-{name}.png").unlink(missing_ok=True)
    return "\n\n".join([*parts, BACK]) + "\n"
