"""How many photos of a folder moved, found from all of them, and those done again because of it."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from support.batches import make_photos, rectify, results
from support.sure_estimator import Sure
from support.tagged_files import exif_blob
from unshutter.motion.finding import Finding, MotionOdds
from unshutter.reasons import Code, Reason
from unshutter.run.folder import MOST, Judged, shares_moved
from unshutter.single.estimator import View

CLEAR, FAINT, STILL = (6.0, -4.0), (-0.5, 0.5), (-4.0, 6.0)  # log odds, turning point


class ByFolder(Sure):
    """Answers by the photo's name: clearly moved, faintly, or still; as the default method does, given the folder."""

    def estimate(self, view: View) -> Finding:
        assert view.photo.path is not None
        chance = MotionOdds(*{"c": CLEAR, "f": FAINT, "s": STILL}[view.photo.path.name[0]])
        if view.decision.folder > chance.decision_threshold:
            return replace(super().estimate(view), motion_odds=chance)
        return replace(view.no_motion(self.name, Reason(Code.NO_VISIBLE_MOTION)), motion_odds=chance)


@pytest.fixture
def take(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("unshutter.run.ahead.load", lambda name: ByFolder(0.9))

    def photos(camera: bool = True, **kinds: int) -> Path:
        names = [f"{kind[0]}{k:02}.png" for kind, count in kinds.items() for k in range(count)]
        make_photos(tmp_path / "in", names)
        for path in (tmp_path / "in").iterdir() if camera else ():
            Image.open(path).save(path, exif=exif_blob())
        return tmp_path / "in"

    return photos


def changed(folder: Path) -> set[str]:
    return {name.partition(".")[0] for name in results(folder) if ".rectified" in name}


def test_a_single_photo_says_nothing_about_itself() -> None:
    assert shares_moved([5.0]) == [0.0]
    assert shares_moved([-5.0]) == [0.0]


@pytest.mark.parametrize(("moved", "of"), [(0, 100), (3, 100), (30, 100), (100, 100)])
def test_the_share_is_that_of_the_photos(moved: int, of: int) -> None:
    found = shares_moved([5.0] * moved + [-5.0] * (of - moved))
    expected = (moved + 10) / (of + 20)
    assert found[-1] == pytest.approx(min(math.log(expected / (1 - expected)), MOST), abs=0.15)


def test_no_photo_counts_for_itself() -> None:
    first, *others = shares_moved([5.0] + [-5.0] * 9)
    assert first < others[0]


def test_faint_motion_is_undone_where_all_others_moved(take, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    folder = take(clear=20, faint=2)
    assert rectify(folder, "-o", tmp_path / "alone", "--each-alone") == 0
    assert changed(tmp_path / "alone") == {f"c{k:02}" for k in range(20)}
    capsys.readouterr()
    assert rectify(folder, "-o", tmp_path / "out", "--json-log", tmp_path / "log.jsonl") == 0
    assert {"f00", "f01"} < changed(tmp_path / "out")
    assert not (tmp_path / "out" / "f00.png").exists()  # the copy of the photo that was left unchanged at first
    said = capsys.readouterr().err
    assert "f00.rectified.png after all" in said
    assert "judging by all 22 photos, about 2" in said
    assert "22 of 22 photos done" in said
    assert "22 changed, 0 left unchanged" in said
    assert "what to try" not in said
    assert (
        "after all (points moved by up to 9.0 px, confidence 0.70: tentative" in said
    )  # as often as such photos got better, measured
    *events, end = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert {event["confidence"] for event in events} >= {0.9, 0.7}
    assert all(event["confidence"] == 0.7 for event in events if "again" in event)
    assert (end["done"], end["changed"]) == (22, 22)


def test_photos_that_name_no_camera_lend_one_another_no_motion(take, tmp_path: Path) -> None:
    """They may be strangers'."""
    assert rectify(take(camera=False, clear=20, faint=2), "-o", tmp_path / "out") == 0
    assert changed(tmp_path / "out") == {f"c{k:02}" for k in range(20)}


@pytest.mark.parametrize("camera", [True, False])
def test_next_to_photos_a_result_goes_that_the_others_contradict(
    take, camera: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "FAINT", (-0.5, -0.5))  # undone by itself
    folder = take(camera, faint=2, still=30)
    before = {path.name for path in folder.iterdir()}
    assert rectify(folder) == 0
    assert {path.name for path in folder.iterdir()} == before


def test_a_folder_is_judged_alike_with_several_workers_and_when_it_is_gone_on_with(take, tmp_path: Path) -> None:
    folder = take(clear=20, faint=2)
    assert rectify(folder, "-o", tmp_path / "whole") == 0
    late = [folder / f"c{k:02}.png" for k in range(4, 20)]
    for photo in late:
        photo.rename(photo.with_suffix(".later"))
    assert rectify(folder, "-o", tmp_path / "grown") == 0
    assert "f00" not in changed(tmp_path / "grown")
    for photo in late:
        photo.with_suffix(".later").rename(photo)
    assert rectify(folder, "-o", tmp_path / "grown") == 0
    assert results(tmp_path / "grown") == results(tmp_path / "whole")


def test_what_the_user_says_is_not_judged_again(take, tmp_path: Path) -> None:
    folder = take(clear=20, faint=2)
    assert rectify(folder, "-o", tmp_path / "out", "--min-confidence", 0.5) == 0
    assert "f00" not in changed(tmp_path / "out")


def test_records_of_other_versions_are_skipped() -> None:
    judged = Judged("g", 1.0, 2.0, 0.0)
    assert Judged.from_json(judged.as_json()) == judged
    assert Judged.from_json({}) is None
    assert Judged.from_json({"folder": {"group": "g"}}) is None
    assert Judged.from_json({"folder": {"group": "g", "log_odds": "x", "turning_point": 1, "used": 0}}) is None
