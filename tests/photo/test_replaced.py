"""A file that is replaced under its name is another photo: pixels are those of its bytes, not of an earlier file's."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from support.drawn_photos import one_line
from unshutter import Photo, UnshutterError, rectify

KINDS = {"webp": {"lossless": True}, "png": {}, "tif": {}, "jpg": {}, "avif": {}}


def write(path: Path, level: int, height: int = 100) -> None:
    """Writes a picture of one grey under a name that may exist."""
    other = path.with_name(f"new{path.suffix}")
    Image.new("RGB", (200, height), (level,) * 3).save(other, **KINDS[path.suffix[1:]])
    os.replace(other, path)


def write_tiles(path: Path, level: int, height: int = 100) -> None:
    """Writes a tiled TIFF, which libvips reads in any order, and therefore remembers."""
    image = Photo.from_array(np.full((height, 200, 3), level, np.uint8)).image
    image.tiffsave(str(path.with_name("new.tif")), tile=True, tile_width=64, tile_height=64)
    os.replace(path.with_name("new.tif"), path)


CASES = [(f"x.{kind}", write) for kind in KINDS] + [("tiles.tif", write_tiles)]


@pytest.mark.parametrize(("name", "write"), CASES, ids=[name for name, _ in CASES])
def test_the_pixels_are_those_of_the_file_that_is_there(name: str, write, tmp_path: Path) -> None:
    path = tmp_path / name
    for level, height in ((250, 100), (5, 100), (120, 150)):
        write(path, level, height)
        photo = Photo.open(path)
        assert (photo.height, photo.width) == (height, 200)
        assert np.abs(photo.pixels.astype(int) - level).max() <= 3
        assert abs(int(photo.grey(64).mean()) - level) <= 3


@pytest.mark.parametrize(("name", "write"), CASES, ids=[name for name, _ in CASES])
@pytest.mark.parametrize("height", [100, 5000], ids=["same size", "larger"])
def test_a_header_is_not_answered_with_the_pixels_of_another_file(
    height: int, name: str, write, tmp_path: Path
) -> None:
    path = tmp_path / name
    write(path, 250)
    photo = Photo.open(path, max_pixels=100 * 200)
    write(path, 5, height)
    with pytest.raises(UnshutterError, match="changed or replaced after it was opened") as error:
        _ = photo.pixels
    one_line(error)


def test_a_copy_is_one_of_the_photo_that_was_judged(tmp_path: Path) -> None:
    path = tmp_path / "x.png"
    write(path, 250)
    result = rectify(path, estimator="none")
    write(path, 5)
    with pytest.raises(UnshutterError, match="changed or replaced"):
        result.save(tmp_path / "copy.png")
    with pytest.raises(UnshutterError, match="changed or replaced"):
        _ = result.bytes
    assert sorted(os.listdir(tmp_path)) == ["x.png"]


def test_a_photo_is_read_from_another_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "x.png", 250)
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path)
    photo = Photo.open("x.png")
    monkeypatch.chdir(tmp_path / "sub")
    write(tmp_path / "sub" / "x.png", 5)
    assert photo.pixels[0, 0, 0] == 250
    assert str(photo.path) == "x.png"
