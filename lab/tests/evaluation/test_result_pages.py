"""docs/results is written from the measurements alone."""

import csv
import json
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from support.covering import thorough
from unshutter_lab.evaluation.protocols import Request
from unshutter_lab.evaluation.results import Results

ROOT = Path(__file__).parents[3]


def record(estimator: str, epe: float, **more: object) -> dict:
    place = {"suite": "256 px", "group": "houses", "photo": "a.jpg", "draw": 0, "estimator": estimator}
    scores = {"epe": epe, "epe_nothing": 4.0, "curvature_epe": 1.0, "tx_rmse": 2.0, "rz_rmse": 0.5}
    return place | scores | {"declined": "", "failed": "", "most_tx": 1.0, "most_rz": 0.1} | more


def results_py(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "lab" / "benchmarks" / "results.py"), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


@pytest.fixture
def write_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], object]:
    """Writes the pages, as ``results.py --pages-only`` does, in this process."""
    monkeypatch.syspath_prepend(ROOT / "lab" / "benchmarks")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["results.py", "--pages-only"])
    return lambda: runpy.run_path(str(ROOT / "lab" / "benchmarks" / "results.py"), run_name="__main__")


def test_pages_say_what_was_measured_and_keep_what_was_written_by_hand(tmp_path: Path, write_pages) -> None:
    for name, protocol in (("synthetic", "synthetic"), ("undistorted", "undistorted")):
        request = Request(protocol, (Path("photos/houses"),))
        records = [record("none", 4.0), record("kandula2020-research", 1.25)]
        results = Results(request, ["none", "kandula2020-research"], [], records)
        (tmp_path / "build" / "results" / name).mkdir(parents=True)
        (tmp_path / "build" / "results" / name / "results.json").write_text(results.to_json())
    docs = tmp_path / "docs" / "results"
    docs.mkdir(parents=True)
    (docs / "reading.md").write_text("## By hand\n\nKept.\n")
    (docs / "readings.toml").write_text('synthetic = "It helps."\n')
    (docs / "old.md").write_text("of another time")
    weights = [tmp_path / package / "weights" for package in ("src/unshutter", "lab/src/unshutter_lab")]
    for folder in weights:
        folder.mkdir(parents=True)
    write_pages()
    index, page = (docs / "index.md").read_text(), (docs / "synthetic.md").read_text()
    assert "| kandula2020-research | **1.25**, **100%** |" in page and "(synthetic.csv)" in page
    assert "256 px,houses,kandula2020-research,1,1.25," in (docs / "synthetic.csv").read_text()
    assert "(reading.md)" in index and not (docs / "old.md").exists()
    assert (docs / "reading.md").read_text() == "## By hand\n\nKept.\n"
    assert "unshutter evaluate --protocol synthetic --data photos/houses" in page
    assert page.startswith("# Synthetic motions, 256 px\n\n**In short:** It helps.\n\n")
    assert "In short" not in (docs / "undistorted.md").read_text()
    assert (docs / "synthetic-epe.png").exists()
    assert not (docs / "confidence.md").exists() and "confidence.md" not in index  # nobody stated any
    ours, of_lab = (json.loads((folder / "scores.json").read_text()) for folder in weights)
    assert of_lab == {"kandula2020-research": {"houses": {"epe_median": 1.25, "improved": 1.0}}}
    assert ours.keys() == {"none"} and ours["none"]["houses"]["improved"] == 0.0


def test_the_page_about_confidence_says_what_dropping_gains(tmp_path: Path, write_pages) -> None:
    """The worst of five distorted is trusted least, the worst of five others most; another method states nothing."""
    confidences = {
        "synthetic": [(1, 0.9), (2, 0.8), (3, 0.7), (4, 0.6), (15, 0.1)],
        "undistorted": [(0, 0.9), (0, 0.8), (0, 0.7), (0, 0.6), (2, 0.95)],
    }
    for name, pictures in confidences.items():
        kinds = {"kind": "hand", "left_alone": "", "farthest": 9.0, "epe_nothing": 1.0, "epe_best": 0.5}
        records = [record("manhattan", float(epe), confidence=confidence, **kinds) for epe, confidence in pictures]
        records += [record("none", 4.0, confidence=None), record("manhattan", 99.0, confidence=0.5, suite="other")]
        results = Results(Request(name, (Path("photos/houses"),)), ["none", "manhattan"], [], records)
        (tmp_path / "build" / "results" / name).mkdir(parents=True)
        (tmp_path / "build" / "results" / name / "results.json").write_text(results.to_json())
    write_pages()
    docs = tmp_path / "docs" / "results"
    page, figures = (docs / "confidence.md").read_text(), (docs / "confidence.csv").read_text()
    assert "| distorted | manhattan | 5 | 0% | 5.00 | 2.50 | **50%** | 50% | 50% |" in page
    assert "| undistorted | manhattan | 5 | 0% | 0.40 | 0.50 | -25% | 100% | -25% |" in page
    # a tenth each: the fifth that goes is 15 px and either 4 px of the distorted or 0 px (equal confidences)
    assert "| half and half | manhattan | 10 | 0% | 2.70 | 1.25 | **54%** | 63% | 54% |" in page
    for row in csv.DictReader(figures.splitlines()):
        if row["suite"] == "distorted":  # of houses and of all
            assert (row["mean EPE"], row["without"], row["drop [%]"], row["pictures"]) == ("5.00", "2.50", "50", "5")
    assert "| half and half | manhattan | 10 | 0.71 | 0.40 |" in page  # four of ten are right
    assert "| – | – | – |" in page  # no bin has enough pictures for a largest gap
    assert "| none |" not in page and ",none," not in figures and "(`manhattan`)" in page
    assert "the commands of [synthetic](synthetic.md) and [undistorted](undistorted.md)" in page
    assert (docs / "confidence-reliability.png").exists()
    assert "(confidence.md)" in (docs / "index.md").read_text()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        thorough((), "DATA=../shared/data"),
        (("nowhere",), "no folder nowhere/test/yorkurban"),
        thorough(("--pages-only",), "nothing"),
    ],
)
def test_missing_data_gets_one_line(words: tuple[str, ...], says: str, tmp_path: Path) -> None:
    done = results_py(*words, folder=tmp_path)
    assert done.returncode != 0
    assert says in done.stderr and done.stderr.strip().count("\n") == 0


def test_the_summary_answers_only_what_was_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "lab" / "benchmarks")
    from summary_page import questions_table

    rows = [f"readout {ms} ms,all,{name},{epe}" for ms in (20, 50, 100) for name, epe in FIGURES.items()]
    (tmp_path / "trajectory.csv").write_text("\n".join(["suite,photos,estimator,EPE median", *rows]) + "\n")
    (tmp_path / "native.csv").write_text("suite,photos,estimator,EPE median\nnative size,yorkurban,none,9\n")
    lines = questions_table(tmp_path).splitlines()[2:]
    cells = "| 4.00 / 4.00 / 4.00 | 2.00 / 2.00 / 2.00 | 1.50 / 1.50 / 1.50 (`manhattan`) |"
    assert len(lines) == 1 and lines[0].startswith("| [Under recorded") and lines[0].endswith(cells)


FIGURES = {"none": 4.0, "segment-manhattan": 2.0, "manhattan": 1.5, "kandula2020-research": 3.0, "ceiling": 0.1}


def test_the_summary_is_that_of_the_files_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "lab" / "benchmarks")
    from summary_page import questions_table

    docs = ROOT / "docs" / "results"
    if not docs.exists():
        pytest.skip("the source distribution of unshutter-lab has no docs")
    assert questions_table(docs) in (docs / "index.md").read_text(encoding="utf-8")
