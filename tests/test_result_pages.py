"""docs/results is written from the measurements alone."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from unshutter.evaluation.protocols import Request
from unshutter.evaluation.results import Results

ROOT = Path(__file__).parent.parent


def record(estimator: str, epe: float) -> dict:
    place = {"suite": "256 px", "group": "houses", "photo": "a.jpg", "draw": 0, "estimator": estimator}
    scores = {"epe": epe, "epe_nothing": 4.0, "curvature_epe": 1.0, "tx_rmse": 2.0, "rz_rmse": 0.5}
    return place | scores | {"declined": "", "failed": "", "most_tx": 1.0, "most_rz": 0.1}


def results_py(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "benchmarks" / "results.py"), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_pages_say_what_was_measured_and_keep_what_was_written_by_hand(tmp_path: Path) -> None:
    for name, protocol in (("synthetic", "synthetic"), ("undistorted", "undistorted")):
        request = Request(protocol, (Path("photos/houses"),))
        results = Results(request, ["none", "kandula2020"], [], [record("none", 4.0), record("kandula2020", 1.25)])
        (tmp_path / "build" / "results" / name).mkdir(parents=True)
        (tmp_path / "build" / "results" / name / "results.json").write_text(results.to_json())
    docs = tmp_path / "docs" / "results"
    docs.mkdir(parents=True)
    (docs / "reading.md").write_text("## By hand\n\nKept.\n")
    (docs / "old.md").write_text("of another time")
    weights = tmp_path / "src" / "unshutter" / "weights"
    weights.mkdir(parents=True)
    done = results_py("--pages-only", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    index, page = (docs / "index.md").read_text(), (docs / "synthetic.md").read_text()
    assert "| kandula2020 | **1.25** | **1.25** |" in index
    assert "## By hand\n\nKept." in index and (docs / "reading.md").exists() and not (docs / "old.md").exists()
    assert "purkait2017" in index.split("no weights of it")[1]  # the paper's others have no row, and it says so
    assert "unshutter evaluate --protocol synthetic --data photos/houses" in page
    assert (docs / "synthetic-epe.png").exists()
    scores = json.loads((weights / "scores.json").read_text())
    assert scores["kandula2020"] == {"houses": {"epe_median": 1.25, "improved": 1.0}}
    assert scores["none"]["houses"]["improved"] == 0.0


@pytest.mark.parametrize(
    ("words", "says"),
    [((), "DATA=../shared/data"), (("nowhere",), "no folder nowhere/test/yorkurban"), (("--pages-only",), "nothing")],
)
def test_missing_data_gets_one_line(words: tuple[str, ...], says: str, tmp_path: Path) -> None:
    done = results_py(*words, folder=tmp_path)
    assert done.returncode != 0
    assert says in done.stderr and done.stderr.strip().count("\n") == 0
