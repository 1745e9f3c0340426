"""What Python gets back: a photo that was changed, or the very same one."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.drawn_photos import drawn
from support.sure_estimator import Sure
from unshutter.errors import UnshutterError
from unshutter.motion.finding import Finding
from unshutter.motion.verdict import judge
from unshutter.options import MIN_CONFIDENCE, Neighbours, Rectify, Undo
from unshutter.photo import Photo
from unshutter.photo.formats import FORMATS
from unshutter.reasons import as_stated
from unshutter.rectification.rectified import render

UNSURE, SURE = Sure(MIN_CONFIDENCE / 2), Sure(0.9)


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "street.jpg"
    Photo.from_array(drawn(120, 160)).save(path, quality=80)
    return path


def test_a_motion_that_is_not_sure_is_not_undone(photo: Path) -> None:
    left = unshutter.rectify(photo, estimator=UNSURE)
    assert not left.changed
    assert left.reason == str(left.verdict.carried_out.reason)
    assert left.reason.startswith("not sure enough: it would help with a probability of 0.")
    assert left.motion.is_zero and left.found.confidence == as_stated(MIN_CONFIDENCE / 2)
    assert left.found.motion.largest_px == pytest.approx(9)
    assert left.valid.all()
    for options in (
        {"estimator": SURE},
        {"estimator": UNSURE, "min_confidence": as_stated(MIN_CONFIDENCE / 2)},
        {"motion": left.found},
    ):
        result = unshutter.rectify(photo, edges="keep", **options)
        assert result.changed and not result.reason
        assert (result.pixels != left.pixels).any()


def test_without_a_least_confidence_the_likeliest_motion_is_undone(facade_canvas: np.ndarray) -> None:
    height, width = facade_canvas.shape[:2]
    askew = cv2.getRotationMatrix2D((width / 2, height / 2), 2, 1)
    photo = Photo.from_array(cv2.warpAffine(facade_canvas, askew, (width, height))[90:-90, 90:-90].copy())
    left, moved = unshutter.rectify(photo), unshutter.rectify(photo, min_confidence=0)
    assert not left.changed
    assert moved.changed and moved.verdict.largest_px > 0.5
    assert moved.found.confidence is not None and moved.found.confidence < 0.5


def test_who_asks_for_the_likeliest_motion() -> None:
    def asks(**options) -> bool:
        return Rectify(undo=Undo(min_confidence=0), **options).settled().find.decision.any

    alone, between = Path("m.json"), Neighbours(after=Path("b.jpg"))
    assert asks() and asks(neighbours=replace(between, fallback=True))
    assert not asks(motion=alone) and not asks(neighbours=between)
    assert not Rectify().find.decision.any


def test_what_is_left_as_it_is_comes_back_the_same(photo: Path) -> None:
    data = photo.read_bytes()
    assert unshutter.rectify(data, estimator=UNSURE).bytes == data
    assert unshutter.rectify(data, estimator=SURE).bytes != data
    pixels = drawn(120, 160)
    same = unshutter.rectify(pixels, estimator=UNSURE).array
    np.testing.assert_array_equal(same, pixels, strict=True)
    assert same is not pixels


@pytest.mark.parametrize("ending", ["jpg", "png", "webp", "tif", "avif"])
def test_what_is_left_as_it_is_is_copied_byte_for_byte(ending: str, tmp_path: Path) -> None:
    path, out = tmp_path / f"a.{ending}", tmp_path / f"b.{ending}"
    Photo.from_array(drawn(120, 160)).save(path)
    assert unshutter.rectify(path, estimator=UNSURE).save(out) == ()
    assert out.read_bytes() == path.read_bytes()
    assert unshutter.rectify(path, estimator=UNSURE).encode().data == path.read_bytes()


def test_another_format_or_quality_is_encoded(photo: Path, tmp_path: Path) -> None:
    left = unshutter.rectify(photo, estimator=UNSURE)
    left.save(tmp_path / "a.png")
    np.testing.assert_array_equal(Photo.open(tmp_path / "a.png").pixels, left.pixels)
    left.save(tmp_path / "a.jpg", quality=30)
    assert (tmp_path / "a.jpg").stat().st_size < photo.stat().st_size


def test_a_copy_needs_no_pixels(photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded = []
    kind = type(FORMATS["jpeg"])
    original = kind.decode
    monkeypatch.setattr(kind, "decode", lambda *given: decoded.append(1) or original(*given))
    opened = Photo.open(photo)
    still, moved = unshutter.RowMotion.zero(120, 160), unshutter.RowMotion.from_polynomials([0, 9], [0], 120, 160)
    render(opened, judge(Finding(still), Undo())).save(tmp_path / "out.jpg")
    assert decoded == []
    render(opened, judge(Finding(moved), Undo())).save(tmp_path / "out2.jpg")
    assert decoded == [1]


def test_a_copy_replaces_nothing_and_not_the_original(photo: Path, tmp_path: Path) -> None:
    left = unshutter.rectify(photo, estimator=UNSURE)
    before = photo.read_bytes()
    with pytest.raises(UnshutterError, match="never overwritten"):
        left.save(photo, overwrite=True)
    (tmp_path / "there.jpg").write_bytes(b"mine")
    with pytest.raises(UnshutterError, match="exists already"):
        left.save(tmp_path / "there.jpg")
    assert (tmp_path / "there.jpg").read_bytes() == b"mine" and photo.read_bytes() == before


def test_what_is_wrong_with_saving_is_said_in_pythons_words(photo: Path, tmp_path: Path) -> None:
    left = unshutter.rectify(photo, estimator=UNSURE)
    (tmp_path / "there.jpg").write_bytes(b"mine")
    for save in (left.save, left.photo.save):
        with pytest.raises(UnshutterError, match="exists already: use overwrite to replace it"):
            save(tmp_path / "there.jpg")
        with pytest.raises(UnshutterError, match="quality must be a whole number, got 'high'"):
            save(tmp_path / "new.jpg", quality="high")  # type: ignore[arg-type]
