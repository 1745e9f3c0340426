"""Saving: files are written whole or not at all, and never over an original."""

import contextlib
import hashlib
import os
import resource
import sys

import numpy as np
import pytest

from support.drawn_photos import drawn, encoded, one_line
from unshutter import rectify
from unshutter.errors import UnshutterError, UsageError
from unshutter.photo import Photo
from unshutter.photo.formats import WRITTEN
from unshutter.storage.opened import Opened


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("format", WRITTEN)
def test_save_chooses_the_format_by_the_ending_and_leaves_the_original_alone(tmp_path, format):
    original = tmp_path / "in[1] ö.jpg"
    original.write_bytes(encoded(drawn(), "JPEG"))
    before = digest(original)
    for suffix in WRITTEN[format].row.suffixes:
        target = tmp_path / f"out[2]{suffix.upper()}"
        Photo.open(original).save(target)
        assert Photo.open(target).format == format
    assert digest(original) == before
    assert len(os.listdir(tmp_path)) == 1 + len(WRITTEN[format].row.suffixes)
    assert oct(target.stat().st_mode) == oct(original.stat().st_mode)  # not a temporary file's rights


def test_times_are_kept_where_they_are_asked_for(tmp_path):
    photo, then = tmp_path / "in.jpg", (1_000_000_000_000_000_000, 900_000_000_000_000_000)
    photo.write_bytes(encoded(drawn(96, 96), "JPEG"))
    os.utime(photo, ns=then)
    rectified = rectify(photo, estimator="none")
    rectified.save(tmp_path / "then.jpg", keep_times=True)
    rectified.save(tmp_path / "now.jpg")
    assert Opened.at(tmp_path / "then.jpg").times_ns == then == rectified.original.times_ns
    assert Opened.at(tmp_path / "now.jpg").times_ns[1] > 1_700_000_000_000_000_000
    with pytest.raises(UsageError, match="read from a file"):
        Photo.from_bytes(photo.read_bytes()).save(tmp_path / "none.jpg", keep_times=True)
    assert not (tmp_path / "none.jpg").exists()


def test_existing_files_need_overwrite_and_the_original_is_never_replaced(tmp_path):
    original, other, target = tmp_path / "in.jpg", tmp_path / "folder", tmp_path / "out.png"
    original.write_bytes(encoded(drawn(), "JPEG"))
    target.write_bytes(b"precious")
    before = digest(original)
    other.mkdir()
    (tmp_path / "symbolic.jpg").symlink_to(original)
    (tmp_path / "hard.jpg").hardlink_to(original)
    photo = Photo.open(original)
    changed = photo.with_pixels(~photo.pixels)
    with pytest.raises(UnshutterError, match="use overwrite"):
        changed.save(target)
    assert target.read_bytes() == b"precious"
    for own in (original, tmp_path / "symbolic.jpg", tmp_path / "hard.jpg", other / ".." / "in.jpg"):
        for overwrite in (False, True):
            with pytest.raises(UnshutterError, match="never overwritten") as error:
                changed.save(own, overwrite=overwrite)
            one_line(error)
    changed.save(target, overwrite=True)
    np.testing.assert_array_equal(Photo.open(target).to_array(), 255 - photo.to_array())
    assert digest(original) == before
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


@pytest.mark.skipif(sys.platform == "win32", reason="needs permissions")
@pytest.mark.parametrize("mode", [0o600, 0o664])
def test_the_result_has_the_permissions_of_the_original(tmp_path, mode):
    original, target = tmp_path / "in.jpg", tmp_path / "out.jpg"
    original.write_bytes(encoded(drawn(), "JPEG"))
    original.chmod(mode)
    Photo.open(original).save(target)
    assert target.stat().st_mode & 0o777 == mode
    Photo.from_bytes(original.read_bytes()).save(target, overwrite=True)  # from nowhere: as any new file
    (tmp_path / "new").touch()
    assert target.stat().st_mode == (tmp_path / "new").stat().st_mode


def test_places_that_cannot_be_written_to(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(b"no folder")
    (tmp_path / "folder.png").mkdir()
    for target, expected in (
        (file / "out.png", "folder"),
        (tmp_path / "none" / "out.png", "there is no folder"),
        (tmp_path / "folder.png", "it is a folder"),
        (tmp_path / ("x" * 300 + ".png"), "too long"),
    ):
        with pytest.raises(UnshutterError) as error:
            Photo.from_array(drawn()).save(target)
        assert expected in one_line(error)
    assert sorted(os.listdir(tmp_path)) == ["file", "folder.png"]


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc, a folder that nobody can write to, root neither")
def test_a_folder_without_permission():
    with pytest.raises(UnshutterError, match=r"cannot write /proc/out\.png") as error:
        Photo.from_array(drawn()).save("/proc/out.png")
    one_line(error)


@contextlib.contextmanager
def room_for(size):
    """A limit on the size of files stands in for a full disc: writing fails part of the way."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("format", WRITTEN)
def test_a_disc_that_fills_up_leaves_nothing_behind(tmp_path, format):
    noise = np.random.default_rng(1).integers(0, 256, (200, 300, 3)).astype(np.uint8)
    target = tmp_path / f"out{WRITTEN[format].row.suffixes[0]}"
    target.write_bytes(b"precious")
    with room_for(10_000), pytest.raises(UnshutterError) as error:
        Photo.from_array(noise).save(target, overwrite=True)
    assert one_line(error) == f"cannot write {target}: File too large"
    assert os.listdir(tmp_path) == [target.name] and target.read_bytes() == b"precious"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems' names are text")
def test_complaints_that_are_not_text_do_not_spoil_later_ones(tmp_path):
    """libvips notes the folder's name, which pyvips takes for text; and it notes warnings that nobody asked for."""
    folder = tmp_path / os.fsdecode(b"b\xfcro")
    folder.mkdir()
    noise = np.random.default_rng(1).integers(0, 256, (200, 300, 3)).astype(np.uint8)
    with room_for(10_000), pytest.raises(UnshutterError, match=r"cannot write .*: File too large"):
        Photo.from_array(noise).save(folder / "out.jpg")
    assert os.listdir(folder) == []
    odd = encoded(drawn(), "JPEG")
    scan = odd.index(b"\xff\xda") + 11
    Photo.from_bytes(odd[:scan] + b"\0\0\0" + odd[scan + 3 :]).to_array()
    with pytest.raises(UnshutterError) as error:
        Photo.from_bytes(encoded(drawn(), "WEBP")[:20])
    assert one_line(error).endswith("unusual: part of its data cannot be decoded")
