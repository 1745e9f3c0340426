"""Whole evaluations, as a user runs them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from support.covering import thorough
from support.evaluations import one_line, rows_of, run, sequence
from support.installed import install
from unshutter import version
from unshutter.cli import main

# ---- what a run leaves --------------------------------------------------------------------------------------


def test_a_run_leaves_tables_figures_plots_and_sheets_and_says_where(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(photos, tmp_path / "out", "--per-photo", "2") == 0
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert f"results: {tmp_path / 'out' / 'results.md'}" in capsys.readouterr().out
    assert {"results.md", "results.json", "results.csv", "epe.png", "size.png", "curves.png", "sheet_1.jpg"} <= names
    rows = rows_of(tmp_path / "out")
    assert len(rows) == 2 * 2 * 2  # photos, draws, estimators
    assert {row["photo"] for row in rows} == {"a.png", "more/b.jpg"}
    page = (tmp_path / "out" / "results.md").read_text()
    assert "unshutter evaluate --protocol synthetic --data" in page
    own = np.array([float(row["epe"]) for row in rows if row["estimator"] == "segment-transformer"])
    assert f"{np.median(own):.2f}" in page
    assert page.count("![") == sum(name in page for name in names if name.endswith((".png", ".jpg")))


@pytest.mark.thorough
def test_twice_the_same_figures_whatever_the_number_of_processes(photos: Path, measured: Path, tmp_path: Path) -> None:
    assert run(photos, tmp_path, jobs=2) == 0
    for file in ("results.csv", "results.json", "results.md", "epe.png", "sheet_1.jpg"):
        assert (tmp_path / file).read_bytes() == (measured / file).read_bytes(), file


@pytest.mark.usefixtures("no_plots")
def test_a_run_that_was_killed_goes_on(photos: Path, measured: Path, tmp_path: Path) -> None:
    out = shutil.copytree(measured, tmp_path / "out")
    before = rows_of(out)
    journal = out / "records.jsonl"
    lines = journal.read_text().splitlines()
    marked = json.loads(lines[1])
    marked["records"][0]["tx_rmse"] = 77.0  # not measured again: it must show up
    journal.write_text("\n".join([lines[0], json.dumps(marked), lines[2], lines[3][:40]]))
    assert run(photos, out) == 0
    rows = rows_of(out)
    assert float(rows[0]["tx_rmse"]) == 77.0
    assert rows[1:] == before[1:]
    assert len(journal.read_text().splitlines()) == len(lines)


@pytest.mark.usefixtures("no_plots")
def test_another_estimator_is_added_to_a_run(photos: Path, measured: Path, tmp_path: Path) -> None:
    assert run(photos, tmp_path, estimators="none") == 0
    assert run(photos, tmp_path) == 0
    assert (tmp_path / "results.csv").read_text() == (measured / "results.csv").read_text()


@pytest.mark.usefixtures("no_plots")
def test_another_run_in_the_folder_is_not_mixed_in(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    once = ["--per-photo", "1"]
    assert run(photos, tmp_path, *once, estimators="none") == 0
    assert run(photos, tmp_path, *once, "--seed", "1", estimators="none") == 2
    assert "--overwrite" in one_line(capsys)
    assert run(photos, tmp_path, *once, "--seed", "1", "--overwrite", estimators="none") == 0
    assert "--seed 1" in (tmp_path / "results.md").read_text()


@pytest.mark.usefixtures("no_plots")
def test_fewer_photos_are_chosen_by_the_seed(photos: Path, tmp_path: Path) -> None:
    chosen = set()
    for seed in (0, 1, 2):
        more = ["--photos", "1", "--per-photo", "1", "--seed", str(seed)]
        assert run(photos, tmp_path / str(seed), *more, estimators="none") == 0
        chosen |= {row["photo"] for row in rows_of(tmp_path / str(seed))}
    assert chosen == {"a.png", "more/b.jpg"}


@pytest.mark.parametrize("protocol", ["native", "undistorted", thorough("portrait"), "exposure", thorough("attitude")])
def test_other_protocols_of_photos(protocol: str, photos: Path, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if protocol != "undistorted":  # whose plots are others than those of the usual protocol
        request.getfixturevalue("no_plots")
    assert run(photos, tmp_path, "--protocol", protocol, "--photos", "1", "--per-photo", "1") == 0
    page = (tmp_path / "results.md").read_text()
    assert "segment-transformer" in page
    assert ("moved > 1 px | moved > 3 px" in page) == (protocol == "undistorted")


@pytest.mark.usefixtures("no_plots")
def test_recorded_motions(photos: Path, tmp_path: Path) -> None:
    t = np.linspace(0, 3, 301)
    np.savez(tmp_path / "log.npz", t_s=t, gyro_rad_s=np.stack([np.sin(t), t * 0, np.cos(3 * t)], axis=1))
    more = ["--protocol", "trajectory", "--trajectory", str(tmp_path), "--photos", "1", "--per-photo", "1"]
    assert run(photos, tmp_path / "out", *more, estimators="none") == 0
    rows = rows_of(tmp_path / "out")
    epes = [float(row["epe"]) for row in rows]
    assert [row["suite"] for row in rows] == ["readout 20 ms", "readout 50 ms", "readout 100 ms"]
    assert epes[0] < epes[1] < epes[2]


@pytest.mark.thorough
def test_every_suite_of_robustness_can_be_made(photos: Path, tmp_path: Path) -> None:
    more = ["--protocol", "robustness", "--photos", "1", "--per-photo", "1"]
    assert run(photos, tmp_path / "out", *more, estimators="none") == 0
    page = (tmp_path / "out" / "results.md").read_text()
    for suite in ("as it is", "JPEG q 30", "noise", "blur", "night", "128 px", "2160 px", "left side, no EXIF"):
        assert f"### {suite}" in page


# ---- what goes wrong ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["--estimators", "nonesuch"], 2, "unknown estimator 'nonesuch'"),
        (["--protocol", "nonesuch"], 2, "nonesuch"),
        (["--photos", "0"], 2, "at least one"),
        (["--seed", "-1"], 2, "seed"),
        (["--jobs", "0"], 2, "at least one process"),
        (["--protocol", "trajectory"], 2, "--trajectory"),
        (["--protocol", "trajectory", "--trajectory", "missing.npz"], 1, "no recorded motion in missing.npz"),
        (["--protocol", "pairs"], 1, "no pairs in folder"),
        (["--data", "missing"], 1, "there is no folder missing"),
        (["--data", "empty"], 1, "no photos in folder empty"),
        (["--data", "empty", "--protocol", "video"], 1, "no photos in folder empty"),
        (["--data", "empty/", "other/empty"], 2, "same name"),
        (["--data", "text.txt"], 1, "text.txt is not a folder"),
        (["--output", "text.txt"], 1, "cannot write to folder text.txt"),
    ],
)
def test_mistakes_get_one_line(
    words: list[str],
    code: int,
    says: str,
    photos: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("empty", "other/empty"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "text.txt").write_text("no folder")
    before = sorted(tmp_path.rglob("*"))
    given = {"--data": [str(photos)], "--estimators": ["none"], "--output": ["out"], "--jobs": ["1"]}
    for word in words:
        if word.startswith("--"):
            option = given[word] = []
        else:
            option.append(word)
    assert main(["evaluate", *(w for name, values in given.items() for w in (name, *values))]) == code
    assert says in one_line(capsys)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_mismatched_pair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sequence(tmp_path / "camera" / "seq", gs_size=(60, 90))
    assert run(tmp_path / "camera", tmp_path / "out", "--protocol", "pairs", estimators="none") == 1
    message = one_line(capsys)
    assert "100x80 px" in message and "90x60 px" in message and "not a pair" in message
    (tmp_path / "camera" / "seq" / "gs_0_middle.png").unlink()
    assert run(tmp_path / "camera", tmp_path / "out", "--protocol", "pairs", estimators="none") == 1
    assert "no global-shutter picture" in one_line(capsys)


def test_a_single_frame_is_no_video(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sequence(tmp_path / "camera" / "seq")
    assert run(tmp_path / "camera", tmp_path / "out", "--protocol", "video", estimators="none") == 1
    assert "no consecutive frames" in one_line(capsys)


def test_a_missing_extra_is_reported_before_the_work(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    assert run(photos, tmp_path / "out", estimators="none") == 1
    assert version.extra("plot") in one_line(capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("no_plots")
def test_a_damaged_photo_is_reported_and_the_others_are_measured(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "good.png").write_bytes((photos / "a.png").read_bytes())
    (folder / "half.png").write_bytes((photos / "a.png").read_bytes()[:9000])
    assert run(folder, tmp_path / "out", estimators="none") == 1
    assert "half.png" in one_line(capsys)
    assert "photos 1" in (tmp_path / "out" / "results.md").read_text()


@pytest.mark.usefixtures("no_plots")
def test_whatever_is_installed_can_be_measured(photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "site").mkdir()
    install(tmp_path / "site", "wrong-estimators", {"wrong": "support.wrong_estimator:WRONG"})
    monkeypatch.syspath_prepend(tmp_path / "site")
    assert run(photos, tmp_path / "out", "--protocol", "undistorted", estimators="none,wrong") == 0
    rows = [row for row in rows_of(tmp_path / "out") if row["estimator"] == "wrong"]
    wrong = [row for row in rows if not row["suite"].startswith("1/60 s")]
    assert len(wrong) == 3 * 2  # suites, photos
    assert all(float(row["most_tx"]) == pytest.approx(0.3 * 256, rel=0.01) for row in wrong)
    refuted = [row for row in rows if row not in wrong]  # told their exposure: too sharp for it
    assert refuted and all(float(row["most_tx"]) == 0 and row["declined"] for row in refuted)
    assert all(float(row["epe"]) > 20 for row in wrong)
