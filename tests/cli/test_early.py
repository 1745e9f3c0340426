"""What is begun before it is asked for gives what it gives without; a session lasts as long as the process."""

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

import unshutter
from support.batches import rectify
from unshutter import early
from unshutter.errors import UnshutterError
from unshutter.estimators import ahead
from unshutter.estimators.base import Estimator, View
from unshutter.estimators.methods.manhattan import Manhattan
from unshutter.estimators.methods.segment_manhattan import SegmentManhattan
from unshutter.estimators.register import Method, load
from unshutter.motion import Motion
from unshutter.options import DEFAULT_ESTIMATOR, Camera
from unshutter.photo import Photo


@pytest.mark.parametrize("ending", [".jpg", ".png", ".tif"])
def test_decoded_early_or_not(ending: str, rolling_facade: np.ndarray, tmp_path: Path) -> None:
    photo, ahead, plain = (tmp_path / f"{name}{ending}" for name in ("photo", "ahead", "plain"))
    Photo.from_array(np.kron(rolling_facade, np.ones((3, 3, 1), np.uint8))).save(photo)  # large enough to be shrunk
    assert rectify(photo, "-o", ahead) == 0  # decoded early: it is the first argument
    assert rectify("--edges", "keep", photo, "-o", plain) == 0
    assert ahead.read_bytes() == plain.read_bytes()
    given = unshutter.rectify(photo)
    assert (given.pixels != given.original.to_array()).any()
    given.save(tmp_path / f"given{ending}")
    assert ahead.read_bytes() == (tmp_path / f"given{ending}").read_bytes()


def test_a_photo_that_changed_is_read_again(rolling_facade: np.ndarray, tmp_path: Path) -> None:
    photo, out = tmp_path / "photo.png", tmp_path / "out.png"
    Photo.from_array(rolling_facade).save(photo)
    early.begin(photo)
    Photo.from_array(rolling_facade[:200]).save(photo, overwrite=True)
    assert early.take(photo) is None
    assert rectify(photo, "--no-such-option") == 2  # begun, and never taken
    Photo.from_array(rolling_facade[:300]).save(photo, overwrite=True)
    assert rectify("--estimator", "none", photo, "-o", out) == 0
    assert Photo.open(out).height == 300


def test_given_away_once(rolling_facade: np.ndarray, tmp_path: Path) -> None:
    photo = tmp_path / "photo.jpg"
    Photo.from_array(rolling_facade).save(photo)
    early.begin(photo)
    taken = early.take(photo)
    assert taken is not None
    assert (taken.to_array() == Photo.open(photo).to_array()).all()
    assert early.take(photo) is None


def test_what_cannot_be_opened_is_told_when_it_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo = tmp_path / "photo.jpg"
    photo.write_bytes(b"no photo")
    early.begin(photo)
    assert early.take(photo) is None
    assert rectify(photo) == 1
    assert "is not a JPEG" in capsys.readouterr().err


def test_a_photo_beyond_the_limit_is_not_decoded_early(
    rolling_facade: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photo, begun = tmp_path / "photo.png", []
    Photo.from_array(rolling_facade).save(photo)
    monkeypatch.setattr(early, "begin", lambda *what: begun.append(what))
    assert rectify(photo, "--max-pixels", "1000", "-o", tmp_path / "out.png") == 1
    assert begun == []
    assert rectify(photo, "--estimator", "none", "-o", tmp_path / "out.png") == 0
    assert rectify(photo, "--estimator=manhattan", "-o", tmp_path / "out.png", "--overwrite") == 0
    assert rectify(photo, "-o", tmp_path / "out.png", "--overwrite") == 0
    assert rectify(photo, "--tilt-deg", "2", "-o", tmp_path / "out.png", "--overwrite") == 0
    assert begun == [(photo, name) for name in ("none", "manhattan", DEFAULT_ESTIMATOR, None)]


def test_a_folder_opens_the_network_once(
    rolling_facade: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = []

    class Counted(onnxruntime.InferenceSession):
        def __init__(self, *arguments, **options):
            opened.append(arguments)
            super().__init__(*arguments, **options)

    monkeypatch.setattr(onnxruntime, "InferenceSession", Counted)
    load.cache_clear()
    photos = tmp_path / "photos"
    photos.mkdir()
    for k in range(3):
        Photo.from_array(np.roll(rolling_facade, 5 * k, axis=1)).save(photos / f"{k}.jpg")
    try:
        assert rectify(photos, "-o", tmp_path / "out") == 0
    finally:
        load.cache_clear()  # the counted one
    assert len(list((tmp_path / "out").glob("*.jpg"))) == 3
    assert len(opened) == 1


class Counting(Estimator):
    """Says how often it was asked; fails where it is told to."""

    def __init__(self, fail_at: int = 0):
        super().__init__(Method("counting", "counts", "nowhere:Counting"))
        self.asked, self.fail_at = 0, fail_at

    def estimate(self, view: View) -> Motion:
        self.asked += 1
        if self.asked == self.fail_at:
            raise UnshutterError("not this time")
        return view.no_motion(self.name, f"asked {self.asked} times")


@pytest.fixture
def view(rolling_facade: np.ndarray) -> View:
    return View(Photo.from_array(rolling_facade))


def test_an_estimate_that_was_begun_is_not_made_again(view: View) -> None:
    counting = Counting()
    estimator = ahead.EstimatorAhead(counting)
    with ThreadPoolExecutor(1) as thread:
        estimator.begin(view, thread)
        estimator.begin(view, thread)
    assert counting.asked == 1
    assert estimator.estimate(view).reason == "asked 1 times"
    assert estimator.estimate(view).reason == "asked 2 times"  # given away once


def test_an_estimate_begun_for_another_view_is_not_used(view: View) -> None:
    estimator = ahead.EstimatorAhead(Counting())
    with ThreadPoolExecutor(1) as thread:
        estimator.begin(view, thread)
    assert estimator.estimate(View(view.photo, Camera(focal_px=900.0))).reason == "asked 2 times"
    assert estimator.estimate(View(Photo.from_array(view.photo.to_array()))).reason == "asked 3 times"


def test_what_goes_wrong_ahead_is_tried_again_where_it_is_asked_for(view: View) -> None:
    counting = Counting(fail_at=1)
    estimator = ahead.EstimatorAhead(counting)
    with ThreadPoolExecutor(1) as thread:
        estimator.begin(view, thread)
    assert estimator.estimate(view).reason == "asked 2 times"
    counting.fail_at = 3
    with pytest.raises(UnshutterError, match="not this time"):
        estimator.estimate(view)


def test_estimates_that_nobody_asks_for_are_dropped(view: View) -> None:
    estimator = ahead.EstimatorAhead(Counting())
    views = [View(view.photo, Camera(focal_px=100.0 + k)) for k in range(5)]
    with ThreadPoolExecutor(1) as thread:
        for each in views:
            estimator.begin(each, thread)
    answers = [estimator.estimate(each).reason for each in views]
    assert answers == [f"asked {k} times" for k in (6, 7, 8, 4, 5)]


@pytest.mark.parametrize("options", [(), ("--estimator", "manhattan"), ("--focal-px", "900")])
def test_one_estimate_is_made_and_ahead_where_nothing_is_told(
    options: tuple[str, ...], rolling_facade: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = Manhattan if "manhattan" in options else SegmentManhattan
    original, threads = kind.estimate, []

    def noting(self, view: View) -> Motion:
        threads.append(threading.current_thread())
        return original(self, view)

    monkeypatch.setattr(kind, "estimate", noting)
    photo = tmp_path / "photo.png"
    Photo.from_array(rolling_facade).save(photo)
    assert rectify(photo, "-o", tmp_path / "out.png", *options) == 0
    assert len(threads) == 1
    if "--focal-px" not in options:
        assert threads[0] is not threading.main_thread()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ((), {}),
        (("--estimator", "manhattan"), {"estimator": "manhattan"}),
        (("--estimator=segment-transformer",), {"estimator": "segment-transformer"}),
        (("--roll-deg", "3"), {"roll_deg": 3.0}),
        (("--focal-px", "900"), {"focal_px": 900.0}),
        (("--readout", "bottom-to-top"), {"readout": "bottom-to-top"}),
    ],
)
def test_options_change_the_estimate_whether_it_was_begun_or_not(
    options: tuple[str, ...], told: dict, rolling_facade: np.ndarray, tmp_path: Path
) -> None:
    photo, motion = tmp_path / "photo.png", tmp_path / "motion.json"
    Photo.from_array(rolling_facade).save(photo)
    assert rectify(photo, "-o", tmp_path / "out.png", "--save-motion", motion, *options) == 0
    np.testing.assert_array_equal(Motion.load(motion).tx_px, unshutter.estimate(photo, **told).tx_px)


def test_estimates_of_a_folder_are_those_of_its_photos(rolling_facade: np.ndarray, tmp_path: Path) -> None:
    """They are begun while the photo before is warped."""
    photos, motions = tmp_path / "photos", tmp_path / "motions"
    photos.mkdir()
    for k in range(4):
        Photo.from_array(np.roll(rolling_facade, 40 * k, axis=1)).save(photos / f"{k}.png")
    (photos / "2.png").write_bytes(b"no photo")
    assert rectify(photos, "-o", tmp_path / "out", "--save-motion", motions) == 1
    for k in (0, 1, 3):
        expected = unshutter.estimate(photos / f"{k}.png")
        np.testing.assert_array_equal(Motion.load(motions / f"{k}.json").tx_px, expected.tx_px)
    assert not (motions / "2.json").exists()
