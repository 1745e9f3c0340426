"""Pictures of what a run did, names that are kept, and masks."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from support.batches import HEIGHT, WIDTH, make_photos, rectify, results
from unshutter.cli import main
from unshutter.motion import Motion
from unshutter.motion.warp import validity_mask
from unshutter.photo import Photo
from unshutter.run.preview import Preview


def test_one_photo_before_and_after_in_its_own_pixels(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    preview, out = tmp_path / "preview.png", tmp_path / "out.png"
    assert rectify(archive / "b.png", "-o", out, "--motion", motion, "--preview", preview, "--edges", "keep") == 0
    assert f"before and after: {preview}" in capsys.readouterr().err
    shown = Photo.open(preview).to_array()
    before, after = Photo.open(archive / "b.png").to_array(), Photo.open(out).to_array()
    top, width = shown.shape[0] - 8 - HEIGHT, shown.shape[1]
    left = 8
    np.testing.assert_array_equal(shown[top : top + HEIGHT, left : left + WIDTH], before)
    np.testing.assert_array_equal(shown[top : top + HEIGHT, width - 8 - WIDTH : width - 8], after)
    assert (shown[:top] < 255).any()  # it says what was done


def test_a_folder_on_one_sheet_whoever_does_the_work(archive: Path, motion: Path, tmp_path: Path) -> None:
    sheets = []
    for jobs in ([], ["--jobs", 2]):
        preview = tmp_path / f"sheet{len(jobs)}.jpg"
        assert (
            rectify(archive, "-o", tmp_path / f"out{len(jobs)}", "--motion", motion, "--preview", preview, *jobs) == 0
        )
        sheets.append(Photo.open(preview).pixels)
    np.testing.assert_array_equal(*sheets)
    assert sheets[0].shape[0] > 2 * HEIGHT and sheets[0].shape[1] > 3 * 2 * WIDTH  # three in a row


def test_the_order_is_that_of_the_photos(archive: Path, motion: Path, tmp_path: Path, monkeypatch) -> None:
    """Whichever worker is faster, and also for those that are left out."""
    photos = [archive / name for name in sorted(results(archive))]
    pair = (np.zeros((8, 8, 3), np.uint8),) * 2
    monkeypatch.setattr("unshutter.run.preview.MOST_PHOTOS", 3)
    for order in itertools.permutations(photos):
        preview = Preview(tmp_path / "x.png", False, photos)
        for photo in order:
            preview._add(photo, photo.name, pair)
        assert sorted(preview._pairs, key=preview._turn) == photos[:3]


def test_a_sheet_shows_what_an_earlier_run_finished(archive: Path, motion: Path, tmp_path: Path) -> None:
    words = (archive, "-o", tmp_path / "out", "--motion", motion)
    assert rectify(*words, "--preview", tmp_path / "first.png") == 0
    (tmp_path / "out" / "b.rectified.png").unlink()  # to be made again
    for sheet in ("second.png", "third.png"):
        assert rectify(*words, "--preview", tmp_path / sheet) == 0
        assert Photo.open(tmp_path / sheet).pixels.shape == Photo.open(tmp_path / "first.png").pixels.shape


def test_a_photo_that_is_left_alone_is_shown_twice(archive: Path, tmp_path: Path) -> None:
    preview = tmp_path / "preview.png"
    assert rectify(archive / "b.png", "-o", tmp_path / "o.png", "--estimator", "none", "--preview", preview) == 0
    shown, before = Photo.open(preview).to_array(), Photo.open(archive / "b.png").to_array()
    np.testing.assert_array_equal(shown[-8 - HEIGHT : -8, -8 - WIDTH : -8], before)


def test_a_preview_shows_photos_upright_and_every_kind_of_pixels(tmp_path: Path) -> None:
    grey = np.linspace(0, 255, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH).astype(np.uint8)
    assert Photo.from_array(grey).upright().shape == (HEIGHT, WIDTH, 3)
    deep = Photo.from_array(grey.astype(np.uint16) * 257)
    np.testing.assert_array_equal(deep.upright()[..., 1], grey)
    clear = Photo.from_array(np.dstack([grey, np.zeros_like(grey)]))
    assert (clear.upright() == 255).all()
    assert Photo.from_array(grey).upright(WIDTH // 2).shape == (HEIGHT // 2, WIDTH // 2, 3)


@pytest.mark.parametrize("name", ["a.txt", "archive/a.jpg", "nowhere/a.png"])
def test_a_preview_replaces_nothing(name: str, archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    before = results(archive)
    words = ("-o", tmp_path / "out", "--motion", motion, "--overwrite", "--preview", tmp_path / name)
    assert rectify(archive, *words) in (1, 2)
    assert capsys.readouterr().err.count("\n") == 1
    assert results(archive) == before and not (tmp_path / "out").exists()


# ---- photogrammetry ----------------------------------------------------------------------------------------


def test_names_are_kept_and_masks_lie_where_colmap_looks(archive: Path, motion: Path, tmp_path: Path) -> None:
    out, masks = tmp_path / "out", tmp_path / "masks"
    assert rectify(archive, "-o", out, "--keep-names", "--masks", masks, "--motion", motion) == 0
    names = sorted(results(archive))
    assert sorted(results(out)) == names
    assert sorted(results(masks)) == [f"{name}.png" for name in names]
    expected = validity_mask(Motion.load(motion))
    for name in names:
        mask = Photo.open(masks / f"{name}.png").to_array()
        np.testing.assert_array_equal(mask, expected * np.uint8(255))
        assert Photo.open(out / name).pixels.shape == (HEIGHT, WIDTH, 3)
    assert not expected.all()


def test_masks_that_are_gone_are_made_again(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    words = (archive, "-o", tmp_path / "out", "--masks", tmp_path / "masks", "--motion", motion)
    assert rectify(*words) == 0
    (tmp_path / "masks" / "a.rectified.jpg.png").unlink()
    assert rectify(*words) == 0
    assert "3 finished already" in capsys.readouterr().err
    assert (tmp_path / "masks" / "a.rectified.jpg.png").exists()


def test_kept_names_in_another_format(archive: Path, motion: Path, tmp_path: Path) -> None:
    assert rectify(archive, "-o", tmp_path / "o", "--keep-names", "--format", "webp", "--motion", motion) == 0
    assert sorted(results(tmp_path / "o")) == ["a.webp", "b.webp", "trip/a.webp", "trip/day 2/c.webp"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--keep-names"], "--output FOLDER"),
        (["--masks", "m", "--edges", "crop"], "leave out --edges crop"),
        (["--keep-names", "-o", "x.jpg"], "--output FOLDER"),
    ],
)
def test_what_does_not_fit_together(words: list, told: str, archive: Path, capsys) -> None:
    assert rectify(archive / "a.jpg", *words) == 2
    assert told in capsys.readouterr().err


def test_kept_names_never_replace_the_originals(archive: Path, motion: Path, capsys) -> None:
    before = results(archive)
    assert rectify(archive, "-o", archive, "--keep-names", "--motion", motion, "--overwrite") == 1
    assert "4 of 4 photos failed" in capsys.readouterr().err
    assert results(archive) == before


def test_small_photos_are_many(tmp_path: Path, motion: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr("unshutter.run.preview.MOST_PHOTOS", 2)
    make_photos(tmp_path / "in", ["a.png", "b.png", "c.png"])
    words = ("-o", tmp_path / "out", "--motion", motion, "--preview", tmp_path / "sheet.png")
    assert rectify(tmp_path / "in", *words) == 0
    assert "the first 2 photos; 1 more are not in it" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["sheet.jpg", "sheet.png", "sheet.webp", "sheet.tif", "sheet.avif"])
def test_a_preview_is_not_taken_for_a_photo(name: str, motion: Path, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path / "in", ["a.jpg", "z.jpg"])
    sheet, out = tmp_path / "in" / name, tmp_path / "out"
    words = [tmp_path / "in", "-o", out, "--motion", motion]
    assert rectify(*words, "--preview", sheet) == 0
    for more in ([], ["--jobs", 2], ["--overwrite"]):
        capsys.readouterr()
        assert rectify(*words, *more) == 0
        assert "skipped: 1 made by unshutter" in capsys.readouterr().err
    assert sorted(path.name for path in out.glob("*.*g*")) == ["a.rectified.jpg", "z.rectified.jpg"]
    assert main(["estimate", str(tmp_path / "in"), "-o", str(tmp_path / "motions"), "--estimator", "none"]) == 0
    assert "skipped: 1 made by unshutter" in capsys.readouterr().err
    assert rectify(sheet, "--motion", motion) == 1
    assert f"{name}: it is a preview that unshutter made, not a photo" in capsys.readouterr().err
