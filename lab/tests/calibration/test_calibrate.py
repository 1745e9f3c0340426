"""``unshutter calibrate``, on facades that are drawn here.

Slow, because each of its photos is searched in eight versions, or nine parts, with the network's answer and without.
"""

import json
import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from unshutter.cli import main
from unshutter.motion import RowMotion
from unshutter.photo import Photo
from unshutter.single import prospects
from unshutter.single.estimator import View
from unshutter.single.methods import SegmentManhattan
from unshutter.single.prior import Calibration, Forest
from unshutter.single.register import method
from unshutter_lab.calibration.cases import coefficients_of, fit_motion_kinds, fit_network_errors

pytestmark = pytest.mark.skipif(find_spec("sklearn") is None, reason="needs scikit-learn")

NAMES = ("c.png", "d.png")  # in different folds


def run(data: Path, out: Path, *more: str) -> int:
    return main(["calibrate", str(data), "-o", str(out), *more])


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory, facade: np.ndarray) -> Path:
    """Two facades with and without motion, one as it is, some for the network's errors, and a gyro log."""
    folder = tmp_path_factory.mktemp("data")
    parts = [facade[:270, :270], facade[100:370, 200:470], facade[140:400, 20:280], facade[60:330, 100:370]]
    for name, files in (("train", NAMES), ("val", ("a.png", "b.png", "c.png", "d.png")), ("ordinary", ("o.png",))):
        (folder / name).mkdir()
        for file, part in zip(files, parts, strict=False):
            Photo.from_array(part.copy()).save(folder / name / file)
    (folder / "trajectories").mkdir()
    t_s = np.arange(400) / 200
    rates = np.stack([np.sin(t_s * k) for k in (5, 7, 9)], axis=1) * 0.8
    np.savez(folder / "trajectories" / "gyro.npz", t_s=t_s, gyro_rad_s=rates)
    return folder


@pytest.fixture(scope="module")
def calibrated(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a run leaves; tests that change it copy it."""
    folder = tmp_path_factory.mktemp("calibrated")
    assert run(data, folder, "--jobs", "1") == 0
    return folder


def test_the_file_is_one_that_the_default_method_runs_on(
    calibrated: Path, data: Path, facade: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = Calibration.read(calibrated / "calibration.json")
    monkeypatch.setattr(prospects, "shipped", lambda: file)
    known = method("segment-manhattan")
    motion = SegmentManhattan(known, known.weights, file.network_errors, file.kinds).estimate(
        View(Photo.from_array(facade))
    )
    assert motion.confidence is not None and 0 < motion.confidence < 1
    assert all(len(each.better.feature) > 1 for each in (file.with_network, file.without_network))


def test_the_file_says_what_it_was_made_of(calibrated: Path, data: Path) -> None:
    provenance = json.loads((calibrated / "calibration.json").read_text())["provenance"]
    assert {name: each.get("photos") for name, each in provenance["data"].items()} == {
        "val": 4,
        "train": 2,
        "ordinary": 1,
        "trajectories": None,
    }
    assert provenance["seed"] == 0
    assert {"unshutter", "unshutter-lab", "numpy", "scikit-learn", "python"} <= provenance["versions"].keys()
    assert str(data) not in (calibrated / "calibration.json").read_text()


@pytest.mark.thorough
def test_the_same_data_give_the_same_file_whatever_the_number_of_processes(
    calibrated: Path, data: Path, tmp_path: Path
) -> None:
    assert run(data, tmp_path / "again", "--jobs", "2") == 0
    for name in ("calibration.json", "report.txt"):
        assert (tmp_path / "again" / name).read_bytes() == (calibrated / name).read_bytes()


def test_a_run_that_was_stopped_goes_on(calibrated: Path, data: Path, tmp_path: Path) -> None:
    out = shutil.copytree(calibrated, tmp_path / "out")
    (out / "calibration.json").unlink()
    records = out / "records.jsonl"
    lines = records.read_text().splitlines(keepends=True)
    records.write_text("".join(lines[:-1]) + lines[-1][:30])
    assert run(data, out, "--jobs", "1") == 0
    assert (out / "calibration.json").read_bytes() == (calibrated / "calibration.json").read_bytes()
    assert len(records.read_text().splitlines()) == len(lines)


def test_a_run_with_another_seed_does_not_go_on(
    calibrated: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(data, calibrated, "--seed", "1") == 2
    assert "--overwrite" in capsys.readouterr().err


def test_an_output_that_is_a_link_to_a_photo(
    calibrated: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo = data / "val" / "a.png"
    before = photo.read_bytes()
    out = shutil.copytree(calibrated, tmp_path / "out")
    (out / "report.txt").unlink()
    (out / "report.txt").hardlink_to(photo)
    assert run(data, out, "--overwrite", "--jobs", "1") == 1
    assert "input" in capsys.readouterr().err
    assert photo.read_bytes() == before


def test_folders_that_are_missing_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path, tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and str(tmp_path / "val") in error
    assert not (tmp_path / "out").exists()


def test_too_few_photos_are_reported(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    few = tmp_path / "few"
    shutil.copytree(data, few)
    for name in ("b.png", "c.png"):
        (few / "val" / name).unlink()
    assert run(few, tmp_path / "out", "--jobs", "1") == 1
    assert "add photos of buildings" in capsys.readouterr().err


def test_scales_and_correlations_are_those_that_errors_were_drawn_with() -> None:
    rng = np.random.default_rng(0)
    scales = np.array([0.02, 0.03, 0.006, 0.03, 0.03, 0.005])
    correlations = np.eye(6)
    correlations[0, 1] = correlations[1, 0] = -0.6
    normal = rng.multivariate_normal(np.zeros(6), correlations * np.outer(scales, scales), 20000)
    sizes_px = rng.uniform(0, 40, len(normal))
    errors = normal / np.sqrt(rng.chisquare(3, len(normal)) / 3)[:, None] * np.hypot(1, sizes_px / 25)[:, None]
    fitted = fit_network_errors(errors, sizes_px)
    np.testing.assert_allclose(fitted.scales, scales, rtol=0.03)
    np.testing.assert_allclose(fitted.correlations, correlations, atol=0.03)


def test_coefficients_are_those_of_the_motion() -> None:
    expected = np.array([0.1, -0.2, 0.05, 0.02, 0.03, -0.04])
    view = View(Photo.from_array(np.zeros((90, 120), np.uint8)))
    motion = view.cubic_motion(expected.reshape(2, 3), "x").motion
    assert isinstance(motion, RowMotion)
    np.testing.assert_allclose(coefficients_of(motion), expected, atol=1e-9)


def test_the_forest_of_the_file_says_what_the_fitted_one_says() -> None:
    from sklearn.ensemble import HistGradientBoostingClassifier

    from unshutter_lab.calibration.fits import forest_fields

    rng = np.random.default_rng(0)
    table = rng.normal(size=(600, 3))
    helps = table[:, 0] + table[:, 1] ** 2 + 0.3 * rng.normal(size=600) > 0.5
    trees = HistGradientBoostingClassifier(max_depth=3, max_iter=20, random_state=0).fit(table, helps)
    forest = Forest.read(forest_fields(trees, ("a", "b", "c")))
    own = [forest.of(dict(zip("abc", row, strict=True))) for row in table[:50]]
    np.testing.assert_allclose(own, trees.decision_function(table[:50]), atol=1e-4)


def test_the_kinds_of_motion_are_those_of_the_logs(data: Path) -> None:
    """A log whose every window is a pan, ten times as fast as it is anything else."""
    t_s = np.arange(400) / 200
    rates = np.stack([0.5 + 0 * t_s, 0.02 * np.sin(9 * t_s), 0.02 * np.sin(7 * t_s)], axis=1)
    log = data / "pan.npz"
    np.savez(log, t_s=t_s, gyro_rad_s=rates)
    quadratic, hand, pan = fit_motion_kinds([log], 0)
    assert [kind.name for kind in (quadratic, hand, pan)] == ["quadratic", "hand", "pan"]
    assert sum(kind.share for kind in (quadratic, hand, pan)) == pytest.approx(1)
    drawn = np.sqrt(np.diag(quadratic.scale))  # Rengarajan's ranges: 30 px and 40 px of 356 rows and so on
    np.testing.assert_allclose(drawn[[0, 1, 3, 4]], (0.054, 0.081, 0.062, 0.044), rtol=0.05)
    widths = np.sqrt(np.diag(pan.scale))
    assert widths[0] > 5 * widths[1:].max()
    assert np.sqrt(hand.scale[0, 0]) == pytest.approx(0.5 * 0.05, rel=0.5)  # 50 ms of half a radian a second
