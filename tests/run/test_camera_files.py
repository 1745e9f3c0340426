"""Folders with HEIC and raw files: names of results, formats, missing extras."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.JpegImagePlugin import get_sampling

import unshutter
from support.camera_files import dng, heic, linear
from support.covering import thorough
from support.drawn_photos import encoded
from support.tagged_files import (
    exif_blob,
)
from unshutter import RowMotion, version
from unshutter.cli import main
from unshutter.photo import Photo


@pytest.fixture
def folder(tmp_path: Path, rolling_facade: np.ndarray) -> Path:
    """What a camera and a phone leave on a card: a raw file with a JPEG of the same name, a HEIC with another."""
    photos = tmp_path / "card"
    photos.mkdir()
    pixels = rolling_facade[:200, :300]
    (photos / "a.DNG").write_bytes(dng(linear(pixels)))
    (photos / "b.HEIC").write_bytes(heic(pixels))
    for name in ("a.jpg", "b.jpg"):
        (photos / name).write_bytes(encoded(pixels, "JPEG", exif=exif_blob()))
    return photos


def test_folders_with_files_of_all_kinds(folder: Path, tmp_path: Path) -> None:
    out, motions = tmp_path / "out", tmp_path / "motions"
    assert main(["rectify", str(folder), "-o", str(out), "--save-motion", str(motions)]) == 0
    pictures = ["a.DNG.rectified.tif", "a.rectified.jpg", "b.HEIC.rectified.avif", "b.rectified.jpg"]
    assert sorted(p.name for p in out.iterdir() if p.suffix != ".jsonl") == pictures
    assert sorted(p.name for p in motions.iterdir()) == ["a.DNG.json", "a.json", "b.HEIC.json", "b.json"]
    assert [Photo.open(out / name).format for name in pictures] == ["tiff", "jpeg", "avif", "jpeg"]
    assert main(["estimate", str(folder), "-o", str(tmp_path / "estimated")]) == 0
    assert sorted(p.name for p in (tmp_path / "estimated").iterdir()) == sorted(p.name for p in motions.iterdir())


@pytest.mark.parametrize(("format", "ending"), [("jpeg", ".jpg"), ("tiff", ".tif"), ("avif", ".avif")])
def test_folders_into_one_format(folder: Path, tmp_path: Path, format: str, ending: str) -> None:
    out, motion = tmp_path / "out", tmp_path / "motion.json"
    RowMotion.from_polynomials([0, 9], [0], 200, 300).save(motion)
    command = ["rectify", str(folder), "-o", str(out), "--format", format, "--motion", str(motion)]
    assert main([*command, "--subsampling", "4:4:4"]) == 0
    pictures = sorted(p.name for p in out.iterdir() if p.suffix != ".jsonl")
    jpegs = ["a.rectified.jpg", "b.rectified.jpg"] if format == "jpeg" else [f"{n}.jpg.rectified{ending}" for n in "ab"]
    assert pictures == sorted([f"a.DNG.rectified{ending}", f"b.HEIC.rectified{ending}", *jpegs])
    assert {Photo.open(out / name).format for name in pictures} == {format}
    if format == "jpeg":
        with Image.open(out / "b.rectified.jpg") as picture:
            assert get_sampling(picture) == 0


def test_results_are_not_named_like_files_that_are_only_read(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("out.heic", "out.nef"):
        assert main(["rectify", str(folder / "a.jpg"), "-o", str(folder / name)]) == 2
        assert f"cannot write '{name}': unshutter only reads such files" in capsys.readouterr().err
    assert main(["rectify", str(folder / "a.jpg"), "-o", str(folder / "x.png"), "--format", "tiff"]) == 2
    assert "--format is for folders" in capsys.readouterr().err


def test_bytes_in_bytes_out(rolling_facade: np.ndarray) -> None:
    pixels = rolling_facade[:200, :300]
    motion = RowMotion.from_polynomials([0, 9], [0], 200, 300)
    for data, format in ((heic(pixels), "avif"), (dng(linear(pixels)), "tiff")):
        assert Photo.from_bytes(unshutter.rectify(data, motion=motion).bytes).format == format


@pytest.mark.parametrize("jobs", [[], thorough(["--jobs", "1"])])
def test_without_the_extras_each_such_file_fails_with_their_names_and_the_batch_goes_on(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], jobs: list[str]
) -> None:
    for name in ("pi_heif", "rawpy"):
        monkeypatch.setitem(sys.modules, name, None)  # this process's imports of it fail
        (tmp_path / f"{name}.py").write_text("raise ImportError")  # and those of its workers
    monkeypatch.syspath_prepend(tmp_path)
    out, log = tmp_path / "out", tmp_path / "log"
    assert main(["rectify", str(folder), "-o", str(out), "--json-log", str(log), *jobs]) == 1
    pictures = sorted(p.name for p in out.iterdir() if p.suffix != ".jsonl")
    assert pictures == ["a.rectified.jpg", "b.rectified.jpg"]
    said = capsys.readouterr().err
    assert f"{folder}/a.DNG is a camera's raw file: to read it, {version.extra('raw')}" in said
    assert f"{folder}/b.HEIC is a HEIC photo: to read it, {version.extra('heic')}" in said
    assert "Traceback" not in said
    end = json.loads(log.read_text().splitlines()[-1])
    assert (end["event"], end["failed"], end["done"]) == ("end", 2, 2)
