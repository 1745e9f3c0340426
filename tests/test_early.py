"""A photo decoded ahead of the command line gives what it gives without; a session lasts as long as the process."""

from pathlib import Path

import numpy as np
import onnxruntime
import pytest

import unshutter
from batches import rectify
from unshutter.estimators import load
from unshutter.photo import Photo, early


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
    monkeypatch.setattr(early, "begin", begun.append)
    assert rectify(photo, "--max-pixels", "1000", "-o", tmp_path / "out.png") == 1
    assert begun == []
    assert rectify(photo, "--estimator", "none", "-o", tmp_path / "out.png") == 0
    assert begun == [photo]


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
