"""``estimate --candidates`` and ``rectify --candidate``, on a photo whose shear may be a pan or a crooked camera."""

import json
from pathlib import Path

import pytest

import unshutter
from support.batches import make_photos, rectify
from support.sure_estimator import Sure
from unshutter import Candidate, RowMotion, UnshutterError, UsageError, View
from unshutter.cli import main
from unshutter.motion.finding import Finding


class Torn(Sure):
    """Finds no motion, but would not be surprised by two others."""

    def candidates(self, view: View) -> tuple[Candidate, ...]:
        def sheared(px: float, error_px: float = 0.0) -> Finding:
            motion = RowMotion.from_polynomials([0, px], [0], view.height, view.width)
            return Finding(motion, confidence=0.01, estimator=self.name, expected_error=error_px / view.height)

        still = Candidate("still", sheared(0.9), 0.6)  # a mean that is too small to be seen
        return (still, Candidate("pan", sheared(-9, 4.0), 0.3), Candidate("hand", sheared(5, 6.0), 0.1))


@pytest.fixture
def photo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    make_photos(tmp_path, ["torn.png"])
    for place in ("run.ahead", "rectification.find"):
        monkeypatch.setattr(f"unshutter.{place}.load", lambda name: Torn(0.01))
    return tmp_path / "torn.png"


def test_candidates_are_listed_for_people_and_for_programs(photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [
        f"{photo}: 1  as it is (right with a probability of 0.60): --candidate 1",
        f"{photo}: 2  pan to the right, 9.0 px (helps with a probability of 0.30, typically off by 4.0 px): "
        "--candidate 2",
        f"{photo}: 3  hand (helps with a probability of 0.10, no larger than its typical error of 6.0 px): "
        "--candidate 3",
    ]
    assert main(["estimate", "--candidates", str(photo)]) == 0
    listed = capsys.readouterr()
    assert listed.out.splitlines() == lines and not listed.err
    assert main(["estimate", "--candidates", "--json", str(photo)]) == 0
    listed = capsys.readouterr()
    assert listed.err.splitlines() == lines
    data = json.loads(listed.out)
    assert data["format"] == "unshutter-candidates/1"
    assert [(each["number"], each["kind"]) for each in data["candidates"]] == [(1, "still"), (2, "pan"), (3, "hand")]


def test_the_chosen_candidate_is_undone_however_unsure(photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, saved = photo.with_name("out.png"), photo.with_name("motion.json")
    assert rectify("--candidate", 2, photo, "-o", out, "--save-motion", saved) == 0
    assert "up to 9.0 px, typically off by 4.0 px)" in capsys.readouterr().err
    assert unshutter.Motion.load(saved).tx_px[-1] == pytest.approx(-9, abs=0.1)
    assert unshutter.rectify(photo, candidate=3).found.motion.tx_px[-1] == pytest.approx(5, abs=0.1)
    assert not unshutter.rectify(photo).changed


def test_as_it_is_means_unchanged(photo: Path) -> None:
    assert not unshutter.rectify(photo, candidate=1).changed


def test_a_candidate_that_is_not_there_is_refused(photo: Path) -> None:
    with pytest.raises(UnshutterError, match=r"there is no candidate 4: the photo has 3 .as it is, pan to the right"):
        unshutter.rectify(photo, candidate=4)
    with pytest.raises(UsageError, match="candidate is counted from 1"):
        unshutter.rectify(photo, candidate=0)
    assert main(["estimate", "--candidates", "--candidate", "2", str(photo)]) == 2
