"""What is worked on ahead comes out as without."""

import threading
from collections.abc import Iterator
from pathlib import Path
from weakref import WeakSet

import numpy as np
import pytest

import unshutter
from support.batches import rectify
from support.covering import thorough
from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion, RowMotion
from unshutter.motion.finding import Candidate, Finding
from unshutter.options import MAX_PIXELS, Find, Rectify, Undo
from unshutter.photo import Photo
from unshutter.run import ahead
from unshutter.run.ahead import Begun, Wanted, look_ahead
from unshutter.run.job import Job, Work
from unshutter.run.work import rectify_photo
from unshutter.single import network, register
from unshutter.single.estimator import Estimator, View
from unshutter.single.methods import Manhattan, SegmentManhattan
from unshutter.storage.targets import Target


@pytest.fixture
def photos(rolling_facade: np.ndarray, tmp_path: Path) -> list[Path]:
    """Four photos of different widths, the third of which is none."""
    paths = [tmp_path / f"{k}.jpg" for k in range(4)]
    for k, path in enumerate(paths):
        Photo.from_array(rolling_facade[:, : 560 - 10 * k]).save(path)
    paths[2].write_bytes(b"no photo")
    return paths


@pytest.mark.parametrize("ending", [".jpg", ".png", thorough(".tif")])
def test_the_command_line_gives_what_python_gives(ending: str, rolling_facade: np.ndarray, tmp_path: Path) -> None:
    photo, out, given = (tmp_path / f"{name}{ending}" for name in ("photo", "out", "given"))
    Photo.from_array(np.kron(rolling_facade, np.ones((3, 3, 1), np.uint8))).save(photo)  # large enough to be shrunk
    assert rectify(photo, "-o", out) == 0
    result = unshutter.rectify(photo, edges="auto")
    assert result.changed
    result.save(given)
    assert out.read_bytes() == given.read_bytes()


def begin(photos: list[Path], find: Find | None, max_pixels: int = MAX_PIXELS) -> Iterator[Begun]:
    return look_ahead([Wanted(photo, find, Undo(), max_pixels) for photo in photos])


def found(begun: Begun) -> Finding:
    return begun.verdict.finding


def test_photos_come_in_order_and_a_run_may_leave_some_out(photos: list[Path]) -> None:
    begun = begin(photos, None)
    assert [next(begun).photo.width, next(begun).photo.width] == [560, 550]
    next(begun)  # which is none, and not used
    assert next(begun).photo.width == 530
    assert next(begun, None) is None


def test_two_photos_are_held_at_a_time(photos: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    held: WeakSet[Photo] = WeakSet()
    opening = ahead.open_input
    monkeypatch.setattr(ahead, "open_input", lambda *given: [photo := opening(*given), held.add(photo)][0])
    photos[2].write_bytes(photos[1].read_bytes())
    for begun in begin(photos, None):
        assert begun.photo.height == 420
        assert len(held) <= 2


def test_what_cannot_be_opened_is_said_where_it_is_used(photos: list[Path]) -> None:
    begun = begin(photos[1:], Find("none"))
    assert found(next(begun)).reason
    bad = next(begun)
    for ask in (lambda: bad.photo, lambda: bad.verdict):
        with pytest.raises(UnshutterError, match="is not a JPEG"):
            ask()
    assert next(begun).photo.width == 530


def test_an_estimator_that_cannot_be_loaded_is_said_at_once_and_nobody_waits(photos: list[Path]) -> None:
    before = threading.active_count()
    with pytest.raises(UsageError, match="unknown estimator"):
        begin(photos, Find("magic"))
    with pytest.raises(UnshutterError, match="no such file"):
        begin(photos, Find("segment-transformer@missing.onnx"))
    assert threading.active_count() <= before + 4  # their threads end with them


def test_a_folder_opens_the_network_once(
    rolling_facade: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = []

    read = network.read_weights
    monkeypatch.setattr(network, "read_weights", lambda *given: opened.append(given) or read(*given))
    register._built.cache_clear()
    folder = tmp_path / "photos"
    folder.mkdir()
    for k in range(3):
        Photo.from_array(np.roll(rolling_facade, 5 * k, axis=1)).save(folder / f"{k}.jpg")
    try:
        assert rectify(folder, "-o", tmp_path / "out") == 0
    finally:
        register._built.cache_clear()  # the counted one
    assert len(list((tmp_path / "out").glob("*.jpg"))) == 3
    assert len(opened) == 1


class Counting(Estimator):
    """Counts how often it was asked; fails where it is asked to."""

    fail_at = asked = 0

    def estimate(self, view: View) -> Finding:
        self.asked += 1
        if self.asked == self.fail_at:
            raise UnshutterError("not this time")
        return view.no_motion(self.name, f"asked {self.asked} times about {view.width} columns")


@pytest.fixture
def counting(monkeypatch: pytest.MonkeyPatch) -> Counting:
    """What is loaded, whatever is asked for."""
    estimator = Counting(register.method("none"), None)
    monkeypatch.setattr("unshutter.run.ahead.load", lambda name: estimator)
    return estimator


def test_each_photo_is_estimated_once(photos: list[Path], counting: Counting) -> None:
    for k, begun in enumerate(begin(photos[:2], Find("none"))):
        for _ in range(2):  # the answer stays
            assert str(found(begun).reason) == f"asked {k + 1} times about {560 - 10 * k} columns"


def test_what_goes_wrong_ahead_is_tried_again_where_it_is_asked_for(photos: list[Path], counting: Counting) -> None:
    counting.fail_at = 1
    assert str(found(next(begin(photos[:1], Find("none")))).reason).startswith("asked 2 times")
    counting.fail_at = 4
    begun = next(begin(photos[:1], Find("none")))
    assert str(found(begun).reason).startswith("asked 3 times")
    for counting.fail_at in range(5, 8):
        with pytest.raises(UnshutterError, match="not this time"):
            counting.asked = counting.fail_at - 1
            begun.wanted.judge(begun.photo, counting)


def test_the_network_is_opened_while_the_first_photo_is_looked_at(
    photos: list[Path], counting: Counting, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked = threading.Event()
    monkeypatch.setattr(Counting, "estimate", lambda self, view: looked.set() or view.no_motion(self.name, "none"))
    monkeypatch.setattr(Counting, "prepare", lambda self: None if looked.wait(60) else pytest.fail("it was waited for"))
    assert found(next(begin(photos[:1], Find("none")))).reason


@pytest.mark.parametrize("options", [(), ("--estimator", "manhattan"), ("--focal-px", "900")])
def test_one_estimate_is_made_beside_the_rest(
    options: tuple[str, ...], rolling_facade: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = Manhattan if "manhattan" in options else SegmentManhattan
    original, threads = kind.candidates, []

    def noting(self, view: View) -> tuple[Candidate, ...]:
        threads.append(threading.current_thread())
        return original(self, view)

    monkeypatch.setattr(kind, "candidates", noting)
    photo = tmp_path / "photo.png"
    Photo.from_array(rolling_facade).save(photo)
    assert rectify(photo, "-o", tmp_path / "out.png", *options) == 0
    assert len(threads) == 1
    assert threads[0] is not threading.main_thread()


@pytest.mark.parametrize(
    ("words", "find"),
    [
        ((), {}),
        (("--estimator", "manhattan"), {"estimator": "manhattan"}),
        (("--estimator=segment-transformer",), {"estimator": "segment-transformer"}),
        (("--roll-deg", "3"), {"roll_deg": 3.0}),
        (("--focal-px", "900"), {"focal_px": 900.0}),
        (("--readout", "bottom-to-top"), {"readout": "bottom-to-top"}),
    ],
)
def test_every_option_reaches_the_estimate(
    words: tuple[str, ...], find: dict, rolling_facade: np.ndarray, tmp_path: Path
) -> None:
    photo, motion = tmp_path / "photo.png", tmp_path / "motion.json"
    Photo.from_array(rolling_facade).save(photo)
    undone = ("--min-confidence", "0.001", *words)  # 0 asks for another answer
    assert rectify(photo, "-o", tmp_path / "out.png", "--save-motion", motion, *undone) == 0
    np.testing.assert_array_equal(
        Motion.load(motion).tx_px, unshutter.rectify(photo, min_confidence=0.001, **find).found.motion.tx_px
    )


def test_estimates_of_a_folder_are_those_of_its_photos(photos: list[Path], tmp_path: Path) -> None:
    motions = tmp_path / "motions"
    assert rectify(*photos, "-o", tmp_path / "out", "--save-motion", motions) == 1
    for k in (0, 1, 3):
        expected = unshutter.estimate(photos[k])
        np.testing.assert_array_equal(Motion.load(motions / f"{k}.json").tx_px, expected.motion.tx_px)
    assert not (motions / "2.json").exists()


def test_a_motion_that_is_known_is_not_estimated(
    photos: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    photo = Photo.open(photos[0])
    known = Finding(RowMotion(photo.width, np.linspace(0, 40, photo.height), np.zeros(photo.height)))
    monkeypatch.setattr(ahead, "load", lambda name: pytest.fail("the estimator was loaded"))
    job = Job(photos[0], (Target(tmp_path / "saved.jpg"),))
    assert rectify_photo(job, Work(Rectify(), known)).picture == job.picture
