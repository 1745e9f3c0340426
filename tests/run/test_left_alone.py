"""Photos that are left unchanged: said, counted, copied or not written."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from support.batches import make_photos, rectify
from support.camera_files import dng, heic, linear
from support.sure_estimator import Sure
from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.photo import Photo
from unshutter.reasons import Code, Reason
from unshutter.run.inputs import find_photos
from unshutter.single.estimator import View

PHOTOS = ["clear.jpg", "dark.png", "slight.jpg", "unsure.jpg"]
ANSWERS = {"c": Sure(0.9), "d": Sure(None, reason="too dark"), "s": Sure(0.9, px=0.2), "u": Sure(0.36)}


class ByName(Sure):
    """Answers by the photo's name."""

    def estimate(self, view: View) -> Finding:
        assert view.photo.path is not None
        return ANSWERS[view.photo.path.name[0]].estimate(view)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    make_photos(tmp_path / "in", PHOTOS)
    monkeypatch.setattr("unshutter.run.ahead.load", lambda name: ByName(None))
    return tmp_path / "in"


def found(*words: object) -> int:
    """``unshutter rectify`` that leaves photos alone below .5."""
    return rectify("--min-confidence", 0.5, *words)


def same(one: Path, other: Path) -> bool:
    return one.read_bytes() == other.read_bytes()


def test_what_to_do_next_ends_the_summary(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    moved = "if the camera moved: --moving; with a frame taken just before or after: --before or --after"
    which = "what else fits: unshutter estimate --candidates PHOTO"
    cases = {"slight.jpg": moved, "unsure.jpg": which, "": f"{moved}; {which}", "clear.jpg": None}
    for name, steps in cases.items():
        assert found(folder / name, "-o", folder.parent / f"out {name}") == 0
        last = capsys.readouterr().err.splitlines()[-1]
        next_step = f"unshutter: what to try for photos left unchanged: {steps}"
        assert last == next_step if steps else last.startswith(str(folder / name))


def test_the_summary_names_moving_where_it_is_unsure_whether_the_camera_moved(folder, capsys, monkeypatch) -> None:
    doubtful = Reason.of(Code.UNSURE_WHETHER_MOVED, confidence=0.6)
    monkeypatch.setattr("unshutter.run.ahead.load", lambda name: Sure(None, reason=doubtful))
    assert rectify(folder, "-o", folder.parent / "out") == 0
    assert "if the camera moved: --moving" in capsys.readouterr().err.splitlines()[-1]


def test_a_set_for_photogrammetry_of_which_only_a_part_changed_is_warned_of(folder: Path, capsys) -> None:
    warning = "only 1 of 4 changed; a mixed set confuses the calibration"
    for number, (words, warned) in enumerate(
        (
            (["--keep-names"], True),
            (["--masks", folder.parent / "masks"], True),
            (["--keep-names", "--only-changed"], False),
            ([], False),
        )
    ):
        assert found(folder, "-o", folder.parent / f"out {number}", *words) == 0
        assert (warning in capsys.readouterr().err) is warned, words
    assert found(folder, "-o", folder.parent / "all", "--keep-names", "--min-confidence", 0, "--strength", 0) == 0
    assert "mixed set" not in capsys.readouterr().err  # none changed


def test_a_line_says_one_thing_unless_more_is_wanted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = (folder, "-o", folder.parent / "out", "--overwrite")
    for more, advised in (([], False), (["-v"], True)):
        assert found(*words, *more) == 0
        told = capsys.readouterr().err.splitlines()
        assert told[0].endswith(
            "(points moved by up to 9.0 px, confidence 0.90: likely; cropped to 92 %)"
        )  # of every changed photo
        assert ("--min-confidence" in told[3]) == advised


def test_each_photo_is_told_of_and_all_are_counted(folder: Path, capsys) -> None:
    out, log = folder.parent / "out", folder.parent / "log.jsonl"
    assert found(folder, "-o", out, "--json-log", log, "--edges", "keep") == 0
    told = capsys.readouterr().err.splitlines()
    assert (
        told[0]
        == f"{folder}/clear.jpg -> {out}/clear.rectified.jpg (points moved by up to 9.0 px, confidence 0.90: likely)"
    )
    assert told[1] == f"{folder}/dark.png left unchanged (too dark)"
    assert told[3] == f"{folder}/unsure.jpg left unchanged (not sure enough: it would help with a probability of 0.36)"
    counted = "1 changed, 3 left unchanged (1 nothing to go by, 1 no motion, 1 not sure)"
    assert told[-2] == f"unshutter: {counted}"
    for name in PHOTOS:
        assert name == "clear.jpg" or same(folder / name, out / name)
    assert not (out / "clear.jpg").exists() and len(list(out.glob("*.[jp]*g"))) == 4

    events = {Path(event.get("photo", "end")).stem: event for event in map(json.loads, log.read_text().splitlines())}
    assert (events["clear"]["changed"], events["clear"]["confidence"]) == (True, 0.9)
    assert (events["unsure"]["changed"], events["unsure"]["cause"]) == (False, "not sure")
    assert events["unsure"]["largest_px"] == 9
    assert events["end"]["changed"] == 1
    assert events["end"]["left_as_they_are"] == {"nothing to go by": 1, "no motion": 1, "not sure": 1}
    records = [json.loads(line) for line in (out / "unshutter-manifest.jsonl").read_text().splitlines()]
    done = {record["target"]: record for record in records if record["state"] == "done"}
    assert done["unsure.rectified.jpg"]["reason"] == "not sure enough: it would help with a probability of 0.36"
    assert done["clear.rectified.jpg"]["changed"]


def test_zero_confidence_moves_all_that_moves(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert found(folder, "-o", folder.parent / "out", "--min-confidence", 0) == 0
    assert "2 changed, 2 left unchanged" in capsys.readouterr().err


def test_only_changed_photos_are_written_and_none_is_done_twice(folder: Path, capsys) -> None:
    out = folder.parent / "out"
    for finished in (0, 4):
        assert found(folder, "-o", out, "--only-changed") == 0
        assert sorted(path.name for path in out.glob("*.[jp]*g")) == ["clear.rectified.jpg"]
        assert ("4 finished already" in capsys.readouterr().err) == (finished == 4)


def test_copies_of_a_run_before_go_where_only_changed_photos_are_wanted(folder: Path) -> None:
    out = folder.parent / "out"
    assert found(folder, "-o", out) == 0
    (out / "slight.jpg").write_bytes(b"edited since")
    assert found(folder, "-o", out, "--only-changed") == 0
    assert sorted(path.name for path in out.glob("*.[jp]*g")) == ["clear.rectified.jpg", "slight.jpg"]
    assert (out / "slight.jpg").read_bytes() == b"edited since"


def test_a_copy_goes_when_its_photo_changes_and_comes_back(folder: Path) -> None:
    out, pictures = folder.parent / "out", "*.[jp]*g"
    words = [folder, "-o", out, "--masks", out / "masks"]
    for least, unsure in ((0.5, "unsure.jpg"), (0.2, "unsure.rectified.jpg"), (0.5, "unsure.jpg")):
        assert found(*words, "--min-confidence", least) == 0
        expected = ["clear.rectified.jpg", "dark.png", "slight.jpg", unsure]
        assert sorted(path.name for path in out.glob(pictures)) == expected
        assert sorted(path.name for path in (out / "masks").iterdir()) == [f"{name}.png" for name in expected]
    assert same(folder / "unsure.jpg", out / "unsure.jpg")


def test_next_to_the_photos_nothing_is_written_for_those_that_stay(folder: Path) -> None:
    before = {path.name for path in folder.iterdir()}
    for words in ([folder], [folder, "-o", folder, "--overwrite"], [folder / "unsure.jpg", "--format", "png"]):
        assert found(*words) == 0
        new = {path.name for path in folder.iterdir()} - before - {"unshutter-manifest.jsonl"}
        assert new == {"clear.rectified.jpg"}


def test_a_copy_never_replaces_another_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder.parent / "out"
    out.mkdir()
    (out / "slight.jpg").write_bytes(b"somebody's")
    (out / "unsure.jpg").write_bytes((folder / "unsure.jpg").read_bytes())  # a copy already
    (out / "clear.jpg").write_bytes(b"somebody's")  # not in the way of clear.rectified.jpg
    assert found(folder, "-o", out) == 1
    assert "slight.jpg exists already" in capsys.readouterr().err
    assert (out / "slight.jpg").read_bytes() == (out / "clear.jpg").read_bytes() == b"somebody's"
    assert found(folder, "-o", out) == 1
    assert "3 finished already" in capsys.readouterr().err
    assert found(folder, "-o", out, "--overwrite") == 0
    assert same(folder / "slight.jpg", out / "slight.jpg")
    assert (out / "clear.jpg").read_bytes() == b"somebody's"


def test_formats_that_are_only_read_are_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unshutter.run.ahead.load", lambda name: ByName(None))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "unsure.HEIC").write_bytes(heic(np.full((80, 90, 3), 128, np.uint8)))
    (tmp_path / "in" / "unsure.DNG").write_bytes(dng(linear(np.full((80, 90, 3), 128, np.uint8))))
    out = tmp_path / "out"
    assert found(tmp_path / "in", "-o", out) == 0
    assert all(same(tmp_path / "in" / name, out / name) for name in ("unsure.HEIC", "unsure.DNG"))
    assert found(tmp_path / "in", "-o", out, "--format", "JPG", "--only-changed") == 0
    assert found(tmp_path / "in", "-o", out, "--format", "jpg") == 0
    assert {path.name for path in out.glob("*.jpg")} == {"unsure.HEIC.jpg", "unsure.DNG.jpg"}


def test_a_result_is_rectified_once_more_under_the_next_number(folder: Path) -> None:
    first = folder / "clear.rectified.jpg"
    for name in ("clear", "clear.rectified", "clear.rectified-2"):
        assert found(folder / f"{name}.jpg", "--edges", "keep") == 0
    assert found(first, "-o", folder.parent / "out", "--format", "png") == 0
    assert {path.name for path in folder.glob("clear*")} == {
        "clear.jpg", "clear.rectified.jpg", "clear.rectified-2.jpg", "clear.rectified-3.jpg",
    }  # fmt: skip
    assert (folder.parent / "out" / "clear.rectified-2.png").exists()
    assert len(find_photos([folder]).photos) == len(PHOTOS)  # results are not taken, whatever their number


def test_another_format_is_encoded_and_that_is_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder.parent / "out"
    assert found(folder / "unsure.jpg", "-o", out, "--format", "png") == 0
    assert "px; encoded as PNG)\n" in capsys.readouterr().err
    assert (Photo.open(out / "unsure.jpg.png").pixels == Photo.open(folder / "unsure.jpg").pixels).all()
    assert found(folder / "dark.png", "-o", folder.parent / "dark.png") == 0
    assert "encoded as" not in capsys.readouterr().err


def test_the_saved_motion_is_the_one_that_was_undone(folder: Path) -> None:
    motion = folder.parent / "motion.json"
    assert found(folder / "unsure.jpg", "-o", folder.parent / "out.jpg", "--save-motion", motion) == 0
    left = Finding.load(motion)
    assert left.motion.is_zero and str(left.reason) == "not sure enough: it would help with a probability of 0.36"


# ---- edges -----------------------------------------------------------------------------------------------


def test_what_was_not_seen_is_cropped_away_and_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo, motion, out = folder / "clear.jpg", folder.parent / "m.json", folder.parent / "out.png"
    log = folder.parent / "log.jsonl"
    height, width = Photo.open(photo).pixels.shape[:2]
    look = ", please look: --edges keep or fill would keep its size"
    for part, said in ((0.04, ""), (0.5, look), (3, None)):
        RowMotion.from_polynomials([0, part * width], [0], height, width).save(motion)
        assert rectify(photo, "-o", out, "--motion", motion, "--overwrite", "--json-log", log) == 0
        told = capsys.readouterr().err
        noted = next(json.loads(line) for line in log.read_text().splitlines() if "area_left" in line)
        share = Photo.open(out).height * Photo.open(out).width / (height * width)
        if said is None:  # next to nothing is left
            assert share == 1 and re.search(r"not cropped, please look: \d % would be left; --edges fill", told)
        else:
            assert f"; cropped to {round(100 * share)} %{said})" in told
        assert noted["please_look"] == (said != "") and noted["edges"] == ("keep" if said is None else "crop")
        log.unlink()


def test_coordinates_that_are_wanted_are_kept(folder: Path) -> None:
    out, motion = folder.parent / "out.png", folder.parent / "m.json"
    assert rectify(folder / "clear.jpg", "-o", out, "--save-motion", motion) == 0
    assert Photo.open(out).pixels.shape == Photo.open(folder / "clear.jpg").pixels.shape
    kept = out.with_name("kept.png")
    assert rectify(folder / "clear.jpg", "-o", kept, "--edges", "keep") == 0
    assert same(out, kept)
    assert rectify(folder / "clear.jpg", "-o", out, "--overwrite") == 0
    assert Photo.open(out).width < Photo.open(folder / "clear.jpg").width
