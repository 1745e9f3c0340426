"""The benchmark of places: its pictures, their truth, its tables, and answers from elsewhere."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from support.drawn_places import save_place, streets
from support.evaluations import cells_of, one_line, rows_of
from support.fixed_estimator import Fixed
from unshutter import Motion
from unshutter.cli import main
from unshutter.motion import RotationMotion, RowMotion
from unshutter.motion.finding import Finding
from unshutter.photo import Photo
from unshutter.single.register import load
from unshutter_lab.evaluation.case import rectified
from unshutter_lab.evaluation.clip_cases import RATIO_ESTIMATED, RATIO_KNOWN
from unshutter_lab.evaluation.metrics import epe_of_nothing
from unshutter_lab.evaluation.place_cases import (
    SUITES,
    PlaceCase,
    PlaceClip,
    PlaceSuite,
    StreetCase,
    place_cases,
)
from unshutter_lab.evaluation.protocols import PROTOCOLS, Request

ROOT = Path(__file__).parents[3]
OF_PHOTOS = [suite for suite in SUITES if suite.frames == 1]


@pytest.fixture(scope="session")
def yards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("evaluated") / "yards"
    folder.mkdir()
    save_place(folder / "yard_a", streets(1))
    save_place(folder / "yard_b", streets(2))
    return folder


def case(yards: Path, suite: PlaceSuite, draw: int = 0, place: str = "yard_a") -> PlaceCase | StreetCase:
    return (StreetCase if suite.kind in ("walk", "ride") else PlaceCase)(suite, "yards", yards / place, draw, 0)


def suite_of(name: str) -> PlaceSuite:
    return next(suite for suite in SUITES if suite.name == name)


@pytest.mark.parametrize("suite", OF_PHOTOS, ids=lambda suite: suite.name)
def test_the_truth_undoes_the_picture(yards: Path, suite: PlaceSuite) -> None:
    exam = case(yards, suite, draw=1).exam()
    picture, mask = rectified(exam.photo, exam.truth)
    before, after = (np.abs(each[mask].astype(float) - exam.gs[mask]).mean() for each in (exam.photo.pixels, picture))
    assert exam.photo.height == exam.truth.height == len(exam.gs)
    if suite.kind == "still":
        assert exam.truth.is_zero and after < 3
    else:
        assert after < 0.75 * before or after < 4
        assert mask.mean() > 0.5 and np.abs(exam.truth.tx_px[0]) == 0


def test_the_pixels_of_a_street_have_moved_as_told_which_rows_alone_undo_only_in_part(yards: Path) -> None:
    made = case(yards, suite_of("street, riding, 30 ms"))
    exam = made.exam()
    (nearest,) = made.judge(["nearest"], lambda _: Fixed(exam.truth))
    assert 0.2 < nearest["epe"] < 0.8 * nearest["epe_nothing"]  # parallax
    assert nearest["psnr"] == nearest["psnr_oracle"] > nearest["psnr_input"]
    assert exam.moved is not None
    col, row = (np.indices(exam.moved.shape[1:])[::-1] + exam.moved).astype(np.float32)
    undone = cv2.remap(exam.photo.to_array(), col, row, cv2.INTER_LINEAR)
    before, after = (np.median(np.abs(each.astype(int) - exam.gs)) for each in (exam.photo.to_array(), undone))
    assert after <= min(3, before)
    on_foot = case(yards, suite_of("street, walking, 50 ms")).exam()
    assert 0 < on_foot.error(on_foot.truth).epe < on_foot.epe_of_nothing()


def test_hands_turn_about_three_axes_and_further_the_longer_the_readout(yards: Path) -> None:
    truths = [case(yards, suite_of(f"hand {ms} ms")).exam().truth for ms in (20, 50, 100)]
    assert all(isinstance(truth, RotationMotion) for truth in truths)
    turned = [truth.rotations for truth in truths if isinstance(truth, RotationMotion)]
    assert (np.abs(turned[2][-1]) > 1e-4).all()
    sizes = [epe_of_nothing(truth) for truth in truths]
    assert sizes == sorted(sizes) and sizes[2] > 3 * sizes[0]
    # the same hand: its first 20 ms are the same at each readout
    np.testing.assert_allclose(turned[1][119], turned[0][297], atol=2e-5)


def test_the_camera_is_the_same_in_every_suite_and_other_in_every_photo(yards: Path) -> None:
    cameras = [case(yards, suite, draw=2).camera() for suite in OF_PHOTOS]
    assert all(camera == cameras[0] for camera in cameras)
    others = [case(yards, OF_PHOTOS[0], draw).camera() for draw in range(4)]
    others.append(case(yards, OF_PHOTOS[0], 0, "yard_b").camera())
    assert len({camera.yaw for camera in others}) == 5
    assert [camera.height > camera.width for camera in others] == [False, True, False, False, False]


def test_every_second_photo_states_its_focal_length(yards: Path) -> None:
    known = [case(yards, OF_PHOTOS[0], draw).exam().view.known_focal_px() for draw in range(4)]
    assert [focal is not None for focal in known] == [True, False, True, False]
    assert known[0] == case(yards, OF_PHOTOS[0]).camera().focal_px


def test_a_long_exposure_blurs_what_moves(yards: Path) -> None:
    pan = suite_of("pan 50 ms")
    sharp, blurred = (case(yards, replace(pan, exposure_s=exposure)).exam() for exposure in (0.0, 1 / 30))
    edges = [(np.diff(exam.photo.pixels.astype(float), axis=1) ** 2).mean() for exam in (sharp, blurred)]
    assert edges[1] < 0.6 * edges[0]
    np.testing.assert_array_equal(sharp.truth.tx_px, blurred.truth.tx_px)


def test_whoever_knows_the_truth_has_no_error(yards: Path) -> None:
    made = case(yards, suite_of("pan 50 ms"))
    truth = made.exam().truth
    right, none = made.judge(["truth", "none"], lambda name: Fixed(truth) if name == "truth" else load(name))
    assert right["epe"] == pytest.approx(0, abs=1e-9) and right["psnr"] == right["psnr_oracle"] > none["psnr"]
    assert none["epe"] == none["epe_nothing"] > 1


def test_frames_of_a_pair_tell_their_motion_and_one_photo_may_not(yards: Path) -> None:
    made = PlaceClip(suite_of("pair"), "yards", yards / "yard_a", 0, 0)
    frames = made.camera_and_frames()[1]
    assert len(frames) == 2 and np.abs(frames[0].astype(int) - frames[1]).mean() > 1
    known, nothing = made.judge([RATIO_KNOWN, "none"], load)
    assert known["epe"] < 0.3 * known["epe_nothing"]
    assert nothing["epe"] == nothing["epe_nothing"]
    assert made.oracles == (RATIO_ESTIMATED, RATIO_KNOWN)
    np.testing.assert_array_equal(made.view().photo.to_array(), frames[1])


def test_pairs_and_clips_are_of_the_first_photo_only(yards: Path) -> None:
    cases = place_cases("yards", [yards / "yard_a"], 3, 0)
    counts = {suite.name: sum(made.place["suite"] == suite.name for made in cases) for suite in SUITES}
    assert counts == {suite.name: 3 if suite.frames == 1 else 1 for suite in SUITES}
    assert len({made.key for made in cases}) == len({made.file for made in cases}) == len(cases)


def test_the_laboratorys_own_places_need_no_folder() -> None:
    cases = PROTOCOLS["places"].cases(Request("places", (), photos=2, per_photo=1))
    assert len(cases) == 2 * len(SUITES) and {made.place["group"] for made in cases} == {"places"}


def test_other_protocols_need_a_folder(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["evaluate", "--protocol", "native", "-o", str(tmp_path / "out")]) == 2
    assert "needs --data" in one_line(capsys)


def evaluate(yards: Path, *more: str) -> int:
    words = ["evaluate", "--protocol", "places", "--data", str(yards), "--photos", "1", "--per-photo", "1"]
    return main([*words, "--jobs", "1", *more])


@pytest.mark.usefixtures("no_plots")
def test_answers_from_elsewhere_are_a_method_in_the_tables(yards: Path, tmp_path: Path) -> None:
    pictures, answers, out = tmp_path / "pictures", tmp_path / "answers", tmp_path / "out"
    assert evaluate(yards, "--pictures-only", "-o", str(pictures)) == 0
    listed = json.loads((pictures / "pictures.json").read_text())
    assert len(listed) == len(SUITES)
    answers.mkdir()
    for name, known in listed.items():
        (suite,) = (each for each in SUITES if each.name == known["case"]["suite"])
        photo = Photo.open(pictures / name)
        if suite.frames == 1:
            exam = case(yards, suite).exam()
            np.testing.assert_array_equal(photo.to_array(), exam.photo.to_array())
            assert known["focal_px"] == exam.view.known_focal_px()
            answer: Motion = exam.truth
            if suite.name == "quadratic":  # half the size is fine
                answer = exam.truth.resized(photo.height // 2, photo.width // 2)
            answer.save((answers / name).with_suffix(".json"))
    # an answer that bends a still picture, and states that it is sure
    (still,) = (name for name, known in listed.items() if known["case"]["suite"] == "still")
    photo = Photo.open(pictures / still)
    bent = RowMotion.from_polynomials([0, 40], [0], photo.height, photo.width)
    Finding(bent, confidence=0.99).save((answers / still).with_suffix(".json"))
    assert evaluate(yards, "--estimators", "none", "--answers", str(answers), "-o", str(out)) == 0
    ours = {row["suite"]: row for row in rows_of(out) if row["estimator"] == f"answers:{answers}"}
    assert float(ours["hand 100 ms"]["epe"]) < 1e-4 < 1 < float(ours["hand 100 ms"]["epe_nothing"])
    assert float(ours["quadratic"]["epe"]) < 0.15
    assert float(ours["still"]["epe"]) > 5
    assert "there is no" in ours["clip"]["declined"]
    text = (out / "results.md").read_text()
    assert f"--answers {answers}" in text and "--estimators none" in text
    harmed = text.partition("### still")[2].partition("###")[0]
    assert cells_of(harmed, f"answers:{answers}", ("changed by rectify", "worse by rectify")) == ["100%", "100%"]
    assert cells_of(harmed, "none", ("changed by rectify", "worse by rectify")) == ["0%", "0%"]


def test_a_folder_without_answers_is_refused(yards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "other.json").write_text("{}")
    assert evaluate(yards, "--answers", str(tmp_path), "-o", str(tmp_path / "out")) == 1
    assert "named like the pictures" in one_line(capsys)
    assert evaluate(yards, "--answers", str(tmp_path / "gone"), "-o", str(tmp_path / "out")) == 1
    assert "there is no folder" in one_line(capsys)


def test_pictures_go_into_a_new_folder(yards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.txt").write_text("kept")
    assert evaluate(yards, "--pictures-only", "-o", str(tmp_path)) == 2
    assert "not empty" in one_line(capsys) and (tmp_path / "mine.txt").read_text() == "kept"


@pytest.mark.thorough
def test_the_page_of_the_benchmark_is_written_without_other_data(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "lab" / "benchmarks" / "places.py"), "--estimators", "none"]
    done = subprocess.run([*command, "--photos", "1", "--jobs", "1"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "docs" / "results" / "places.md").read_text()
    assert "**Benefit and harm**" in page and "| none | 0.00 |" in page
    assert "frames-camera, ratio given" in page
    assert "hand 100 ms" in (tmp_path / "docs" / "results" / "places.csv").read_text()
