"""Whole evaluations, as a user runs them."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from support.frame_pairs import Scene
from support.installed import install
from unshutter.cli import main
from unshutter.evaluation.cases.case import Record
from unshutter.evaluation.cases.protocols import PROTOCOLS, Request
from unshutter.evaluation.pages.tables import overview, tables
from unshutter.evaluation.results import Results
from unshutter.photo import Photo
from unshutter.synthesis.pair_folder import synthesize_folder


@pytest.fixture(scope="session")
def photos(tmp_path_factory: pytest.TempPathFactory, facade: np.ndarray) -> Path:
    folder = tmp_path_factory.mktemp("data") / "houses"
    (folder / "more").mkdir(parents=True)
    Photo.from_array(facade[:300, :400]).save(folder / "a.png")
    Photo.from_array(facade[100:, 150:]).save(folder / "more" / "b.jpg")
    return folder


def run(photos: Path, out: Path, *more: str, estimators: str = "none,segment-transformer", jobs: int = 1) -> int:
    words = ["evaluate", "--data", str(photos), "--estimators", estimators, "-o", str(out), "--jobs", str(jobs)]
    return main([*words, *more])


@pytest.fixture(scope="session")
def measured(photos: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a plain run leaves; tests that change it copy it."""
    folder = tmp_path_factory.mktemp("measured")
    assert run(photos, folder) == 0
    return folder


def rows_of(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "results.csv").read_text().splitlines()))


def cells_of(text: str, name: str, heads: tuple[str, ...]) -> list[str]:
    """Cells of an estimator's row in a Markdown table, under these headings."""
    lines = [[cell.strip(" *") for cell in line.split(" | ")] for line in text.splitlines() if " | " in line]
    rows = {cells[1]: cells for cells in lines}
    return [rows[name][rows["estimator"].index(head)] for head in heads]


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    message = capsys.readouterr().err.strip()
    assert message.startswith("unshutter: ") and "\n" not in message and "Traceback" not in message
    return message


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


def test_twice_the_same_figures_whatever_the_number_of_processes(photos: Path, measured: Path, tmp_path: Path) -> None:
    assert run(photos, tmp_path, jobs=2) == 0
    for file in ("results.csv", "results.json", "results.md", "epe.png", "sheet_1.jpg"):
        assert (tmp_path / file).read_bytes() == (measured / file).read_bytes(), file


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


def test_another_estimator_is_added_to_a_run(photos: Path, measured: Path, tmp_path: Path) -> None:
    assert run(photos, tmp_path, estimators="none") == 0
    assert run(photos, tmp_path) == 0
    assert (tmp_path / "results.csv").read_text() == (measured / "results.csv").read_text()


def test_another_run_in_the_folder_is_not_mixed_in(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    once = ["--per-photo", "1"]
    assert run(photos, tmp_path, *once, estimators="none") == 0
    assert run(photos, tmp_path, *once, "--seed", "1", estimators="none") == 2
    assert "--overwrite" in one_line(capsys)
    assert run(photos, tmp_path, *once, "--seed", "1", "--overwrite", estimators="none") == 0
    assert "Seed 1" in (tmp_path / "results.md").read_text()


def test_fewer_photos_are_chosen_by_the_seed(photos: Path, tmp_path: Path) -> None:
    chosen = set()
    for seed in (0, 1, 2):
        more = ["--photos", "1", "--per-photo", "1", "--seed", str(seed)]
        assert run(photos, tmp_path / str(seed), *more, estimators="none") == 0
        chosen |= {row["photo"] for row in rows_of(tmp_path / str(seed))}
    assert chosen == {"a.png", "more/b.jpg"}


@pytest.mark.parametrize("protocol", ["native", "undistorted", "portrait", "exposure", "attitude"])
def test_other_protocols_of_photos(protocol: str, photos: Path, tmp_path: Path) -> None:
    assert run(photos, tmp_path, "--protocol", protocol, "--photos", "1", "--per-photo", "1") == 0
    page = (tmp_path / "results.md").read_text()
    assert "segment-transformer" in page
    assert ("moved > 1 px | moved > 3 px" in page) == (protocol == "undistorted")


def test_recorded_motions(photos: Path, tmp_path: Path) -> None:
    t = np.linspace(0, 3, 301)
    np.savez(tmp_path / "log.npz", t_s=t, gyro_rad_s=np.stack([np.sin(t), t * 0, np.cos(3 * t)], axis=1))
    more = ["--protocol", "trajectory", "--trajectory", str(tmp_path), "--photos", "1", "--per-photo", "1"]
    assert run(photos, tmp_path / "out", *more, estimators="none") == 0
    rows = rows_of(tmp_path / "out")
    epes = [float(row["epe"]) for row in rows]
    assert [row["suite"] for row in rows] == ["readout 20 ms", "readout 50 ms", "readout 100 ms"]
    assert epes[0] < epes[1] < epes[2]


def test_every_suite_of_robustness_can_be_made(photos: Path, tmp_path: Path) -> None:
    more = ["--protocol", "robustness", "--photos", "1", "--per-photo", "1"]
    assert run(photos, tmp_path / "out", *more, estimators="none") == 0
    page = (tmp_path / "out" / "results.md").read_text()
    for suite in ("as it is", "JPEG q 30", "noise", "blur", "night", "128 px", "2160 px", "left side, no EXIF"):
        assert f"### {suite}" in page


# ---- pairs and frames ---------------------------------------------------------------------------------------


def sequence(folder: Path, frames: int = 1, gs_size: tuple[int, int] = (80, 100)) -> Path:
    folder.mkdir(parents=True)
    noise = np.random.default_rng(0).integers(0, 255, (12, 14, 3), np.uint8).repeat(10, 0).repeat(10, 1)
    for k in range(frames):
        Photo.from_array(noise[k : k + 80, :100]).save(folder / f"rs_{k}.png")
        Photo.from_array(noise[k : k + gs_size[0], : gs_size[1]]).save(folder / f"gs_{k}_middle.png")
    return folder


def test_pairs(tmp_path: Path) -> None:
    sequence(tmp_path / "camera" / "seq", frames=2)
    assert run(tmp_path / "camera", tmp_path / "out", "--protocol", "pairs") == 0
    rows = rows_of(tmp_path / "out")
    assert [row["estimator"] for row in rows] == ["none", "segment-transformer", "ceiling"] * 2
    assert "*ceiling*" in (tmp_path / "out" / "results.md").read_text()


def test_pairs_whose_frames_follow_one_another(tmp_path: Path) -> None:
    """What the neighbours say stands beside the estimators, and beside what others published of the same frames."""
    scene, ratio, folder = Scene(speed=(20, 3)), 0.8, tmp_path / "camera"
    folder.mkdir()
    for number in (0, 1):
        Photo.from_array(scene.frame(number, ratio)).save(folder / f"rs_{number}.png")
        Photo.from_array(scene.at(number + ratio / 2)).save(folder / f"gs_{number}_middle.png")
    shifted = np.roll(scene.at(ratio / 2), 6, axis=1)
    Photo.from_array(shifted).save(folder / "published_theirs_0_middle.png")
    how = ["--protocol", "pairs", "--readout-ratio", str(ratio)]
    assert run(folder, tmp_path / "out", *how, estimators="none") == 0
    rows = [row for row in rows_of(tmp_path / "out") if row["estimator"] == "frames-dense"]
    assert len(rows) == 2
    for row in rows:
        assert float(row["psnr"]) > float(row["psnr_input"]) + 15
    assert [bool(row["psnr_published_theirs"]) for row in rows] == [True, False]
    page = (tmp_path / "out" / "results.md").read_text()
    assert "above theirs" in page and f"--readout-ratio {ratio}" in page


@pytest.mark.parametrize("words", [["--readout-ratio", "0.5", "0.5"], ["--readout-ratio", "2"]])
def test_readout_ratios_that_cannot_be(tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    sequence(tmp_path / "camera")
    assert run(tmp_path / "camera", tmp_path / "out", "--protocol", "pairs", *words, estimators="none") == 2
    assert "ratio" in capsys.readouterr().err


def test_pairs_are_measured_against_the_ceiling() -> None:
    """Gains of 1 and -0.5 dB on two frames where 4 and 1 were to be had: a tenth of it, and better on one of them."""

    def record(estimator: str, photo: str, psnr: float) -> dict:
        about = {"suite": "middle row", "group": "g", "photo": photo, "estimator": estimator, "declined": False}
        return {**about, "failed": False, "psnr": psnr, "psnr_input": 20.0, "ssim": 0.5, "ssim_input": 0.5}

    gains = {"ours": (1.0, -0.5), "none": (0.0, 0.0), "ceiling": (4.0, 1.0)}
    records = [record(name, str(k), 20 + gain) for name, both in gains.items() for k, gain in enumerate(both)]
    text = tables(Results.of(Request("pairs", (Path("g"),)), ["ours", "none"], ["ceiling"], records))
    rows = {cells[2].strip(" *"): cells for line in text.splitlines() if len(cells := line.split("|")) > 5}
    heads = [cell.strip() for cell in rows["estimator"]]
    at = [heads.index(title) for title in ("of the ceiling's", "better than the input")]
    found = {name: [rows[name][k].strip(" *") for k in at] for name in gains}
    assert found == {"ours": ["10%", "50%"], "none": ["0%", "0%"], "ceiling": ["100%", "100%"]}


def test_of_undistorted_pictures_those_that_would_be_moved_are_counted() -> None:
    """Moved by up to 0.8, 2, 8 px and no end; 16 px found, but left alone. Records of earlier versions do not say."""
    found = [(0.5, 0.8, ""), (0.7, 2.0, ""), (4.0, 8.0, ""), (9.0, None, ""), (9.0, 16.0, "not sure")]
    place = {"suite": "256 px", "group": "g", "declined": "", "failed": "", "most_tx": 1.0, "most_rz": 0.1}
    records = [
        {**place, "photo": str(k), "estimator": "ours", "epe": epe, "farthest": farthest, "left_alone": cause}
        for k, (epe, farthest, cause) in enumerate(found)
    ]
    records += [{**place, "photo": "0", "estimator": "old", "epe": 5.0}]
    text = tables(Results.of(Request("undistorted", (Path("g"),)), ["ours", "old"], [], records))
    heads = ("EPE > 1 px", "EPE > 3 px", "left alone", "moved > 1 px", "moved > 3 px")
    assert cells_of(text, "ours", heads) == ["60%", "60%", "20%", "60%", "40%"]
    assert cells_of(text, "old", heads) == ["100%", "100%", "–", "–", "–"]


def test_what_is_left_alone_is_not_improved_by_rectify() -> None:
    """Four pictures of 4 px: found to 1 px and undone, made worse, found to 2 px but not sure of it, hardly moved."""
    found = [(1.0, ""), (5.0, ""), (2.0, "not sure"), (3.99, "less than half a pixel")]
    place = {"suite": "256 px", "group": "g", "declined": "", "failed": "", "epe_nothing": 4.0}
    place |= {"curvature_epe": 1.0, "tx_rmse": 2.0, "rz_rmse": 0.5}
    records = [
        {**place, "photo": str(k), "estimator": "ours", "epe": epe, "left_alone": cause}
        for k, (epe, cause) in enumerate(found)
    ]
    records += [{**place, "photo": "0", "estimator": "old", "epe": 5.0}]
    text = tables(Results.of(Request("synthetic", (Path("g"),)), ["ours", "old"], [], records))
    heads = ("improved", "left alone", "improved by rectify")
    assert cells_of(text, "ours", heads) == ["75%", "50%", "25%"]
    assert cells_of(text, "old", heads) == ["0%", "–", "–"]


def test_pairs_that_synthesize_wrote(photos: Path, tmp_path: Path) -> None:
    synthesize_folder([photos / "a.png"], tmp_path / "made")
    assert run(tmp_path / "made", tmp_path / "out", "--protocol", "pairs", estimators="none") == 0
    assert "real" not in (tmp_path / "out" / "results.md").read_text().casefold()
    (tmp_path / "made" / "gs" / "a_00.png").unlink()
    assert run(tmp_path / "made", tmp_path / "out2", "--protocol", "pairs", estimators="none") == 1


def test_frames(tmp_path: Path) -> None:
    sequence(tmp_path / "camera" / "seq", frames=3)
    assert run(tmp_path / "camera", tmp_path / "out", "--protocol", "video") == 0
    rows = rows_of(tmp_path / "out")
    assert [row["estimator"] for row in rows] == ["none", "segment-transformer", "true global shutter"] * 2
    assert "Our reading" in (tmp_path / "out" / "results.md").read_text()


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
    assert "unshutter[plot]" in one_line(capsys)
    assert not (tmp_path / "out").exists()


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


# ---- tables -------------------------------------------------------------------------------------------------


def record(estimator: str, epe: float, group: str = "g", **more: object) -> Record:
    scores = {"curvature_epe": epe / 2, "tx_rmse": epe, "rz_rmse": 0.5, "declined": "", "failed": ""}
    place = {"suite": "256 px", "group": group, "photo": f"{epe}", "draw": 0, "estimator": estimator}
    return place | {"epe": epe, "epe_nothing": 4.0} | scores | more


def test_tables_by_hand() -> None:
    records = [record("a", e) for e in (1, 2, 3, 10)] + [record("b", 4.0) for _ in range(4)]
    table = tables(Results(Request("synthetic", (Path("g"),)), ["a", "b"], [], records)).splitlines()
    cells = [cell.strip() for cell in table[2].split("|")[1:-1]]
    assert cells[:7] == ["g", "a", "4", "**2.50**", "**4.00**", "7.90", "**75%**"]
    assert [cell.strip() for cell in table[3].split("|")[4:8]] == ["4.00", "**4.00**", "**4.00**", "0%"]


def test_pictures_without_a_figure_do_not_count() -> None:
    scores = {"psnr": 20.0, "psnr_input": 17.0, "ssim": None, "ssim_input": None}
    records = [record("a", 1.0, **scores), record("a", 2.0, psnr=None, psnr_input=None, ssim=None, ssim_input=None)]
    results = Results(Request("pairs", (Path("g"),)), ["a"], [], records)
    assert "| 20.00 dB | 17.00 dB | +3.00 dB | – | 100% | – | – |" in tables(results)
    ((_, figures, column),) = overview(results)
    assert column.text(figures["a"]) == "+3.00 dB"


def test_results_come_back_from_their_file(tmp_path: Path) -> None:
    request = Request("trajectory", (Path("x/g"),), 3, 1, 7, Path("logs"))
    results = Results(request, ["a"], ["ceiling"], [record("a", 1.0)], {"unshutter": "1"}, {})
    (tmp_path / "results.json").write_text(results.to_json())
    assert Results.load(tmp_path / "results.json") == results
    older = json.loads(results.to_json())
    older |= {"about": older.pop("environment"), "rivals": older.pop("oracles")}
    (tmp_path / "older.json").write_text(json.dumps(older))
    assert Results.load(tmp_path / "older.json") == results
    assert results.command == (
        "unshutter evaluate --protocol trajectory --data x/g --trajectory logs --photos 3 --per-photo 1 --seed 7 "
        "--estimators a"
    )


def test_the_command_line_knows_every_protocol() -> None:
    from typing import get_args

    from unshutter.cli.commands.evaluate import ProtocolName

    assert set(get_args(ProtocolName)) == set(PROTOCOLS)
