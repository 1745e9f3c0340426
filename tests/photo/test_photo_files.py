"""Photo: files that are refused, and files that are written whole or not at all."""

import contextlib
import hashlib
import io
import os
import resource
import struct
import sys
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from support.drawn_photos import drawn, encoded, one_line, textured
from unshutter.errors import UnshutterError, UsageError
from unshutter.photo import Photo
from unshutter.photo.codecs import WRITTEN

# ---- what is refused -----------------------------------------------------------------------------------


def cmyk(format):
    return encoded(drawn(bands=4), format, mode="CMYK")


def pages(format, **options):
    stream = io.BytesIO()
    first, second = (Image.fromarray(a) for a in (drawn(), drawn()[::-1].copy()))
    first.save(stream, format, save_all=True, append_images=[second], **options)
    return stream.getvalue()


def float_tiff():
    stream = io.BytesIO()
    Image.fromarray(drawn(bands=1)[..., 0].astype(np.float32)).save(stream, "TIFF")
    return stream.getvalue()


def lab_tiff():
    import pyvips

    return pyvips.Image.new_from_array(drawn()).colourspace("labs").tiffsave_buffer()


def preview_first_tiff(tag, kind, value):
    """A TIFF whose first directory has one tag more."""
    tags = [(256, 3, 8), (257, 3, 8), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, 1), (279, 4, 64)]
    entries = b"".join(struct.pack("<HHII", t, k, 1, v) for t, k, v in sorted([*tags, (tag, kind, value)]))
    directory = struct.pack("<H", 9) + entries + bytes(4)
    return b"II*\0" + struct.pack("<I", 72) + bytes(64) + directory


REFUSED = {
    "text": (b"This is not a photo, only called one.\n" * 20, "not a JPEG, PNG, WebP, TIFF, AVIF, HEIC or raw"),
    "empty": (b"", "empty"),
    "gif": (encoded(drawn(), "GIF"), "not a JPEG"),
    "heic": (struct.pack(">I", 24) + b"ftypheic\0\0\0\0mif1heic" + bytes(100), "HEIC"),
    "canon raw": (b"II*\0\x10\0\0\0CR\2\0" + bytes(100), "raw"),
    "dng": (preview_first_tiff(50706, 1, 0x401), "raw"),
    "nikon raw": (preview_first_tiff(254, 4, 1), "raw"),
    "cmyk jpeg": (cmyk("JPEG"), "CMYK"),
    "cmyk tiff": (cmyk("TIFF"), "CMYK"),
    "float tiff": (float_tiff(), "32-bit float"),
    "lab tiff": (lab_tiff(), "LAB"),
    "two pages": (pages("TIFF"), "2 pictures"),
    "animated webp": (pages("WEBP"), "2 pictures"),
    "animated avif": (pages("AVIF"), "animation"),
    "jpeg head only": (encoded(drawn(), "JPEG")[:20], "damaged, incomplete or unusual"),
    "png head only": (encoded(drawn(), "PNG")[:20], "damaged, incomplete or unusual"),
    "webp head only": (encoded(drawn(), "WEBP")[:20], "damaged, incomplete or unusual"),
    "tiff head only": (encoded(drawn(), "TIFF")[:12], "damaged, incomplete or unusual"),
    "avif head only": (encoded(drawn(), "AVIF")[:40], "damaged, incomplete or unusual"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_photo_is_refused_in_one_line(tmp_path, name, capfd):
    data, expected = REFUSED[name]
    path = tmp_path / "photo.jpg"
    path.write_bytes(data)
    with pytest.raises(UnshutterError) as error:
        Photo.open(path)
    message = one_line(error)
    assert expected in message and str(path) in message
    with pytest.raises(UnshutterError) as error:
        Photo.from_bytes(data)
    assert expected in one_line(error)
    assert capfd.readouterr() == ("", "")


def test_places_without_a_file_are_refused_in_one_line(tmp_path):
    for place, expected in ((tmp_path, "folder"), (tmp_path / "none.jpg", "No such file"), ("a\0b.jpg", "null")):
        with pytest.raises(UnshutterError) as error:
            Photo.open(place)
        assert expected in one_line(error)


def test_a_tiff_with_a_smaller_copy_of_itself_is_one_photo():
    stream = io.BytesIO()
    small = Image.fromarray(drawn(12, 20))
    small.encoderinfo = {"tiffinfo": {254: 1}}
    Image.fromarray(drawn()).save(stream, "TIFF", save_all=True, append_images=[small])
    np.testing.assert_array_equal(Photo.from_bytes(stream.getvalue()).to_array(), drawn())


@pytest.mark.parametrize("format", ["JPEG", "PNG", "WEBP", "TIFF", "AVIF"])
@pytest.mark.parametrize("kept", [0.6, 0.95])
def test_truncated_files_are_found_before_anything_is_written(tmp_path, format, kept, capfd):
    noise = np.random.default_rng(1).integers(0, 256, (120, 160, 3)).astype(np.uint8)
    data = encoded(noise, format)
    path, target = tmp_path / f"photo.{format.lower()}", tmp_path / "out.png"
    path.write_bytes(data[: int(len(data) * kept)])
    for use in (lambda photo: photo.save(target), lambda photo: photo.grey(16), lambda photo: photo.to_array()):
        with pytest.raises(UnshutterError) as error:
            use(Photo.open(path))
        assert "damaged" in one_line(error) and str(path) in str(error.value)
    assert os.listdir(tmp_path) == [path.name]
    assert capfd.readouterr() == ("", "")


def test_a_jpeg_with_a_hole_is_damaged_but_harmless_oddities_are_not():
    data = encoded(textured(480, 640), "JPEG")
    holed = data[: len(data) // 2] + b"\xff\0" * 150 + data[len(data) // 2 + 300 :]  # ones only: no Huffman code
    with pytest.raises(UnshutterError, match="damaged or incomplete"):
        Photo.from_bytes(holed).to_array()
    scan = data.index(b"\xff\xda") + 11
    assert data[scan : scan + 3] == b"\0\x3f\0"  # first and last coefficient, bits
    padded, odd_header = data[:-2] + bytes(7) + data[-2:] + b"more", data[:scan] + b"\0\0\0" + data[scan + 3 :]
    for odd in (padded, odd_header):
        np.testing.assert_array_equal(Photo.from_bytes(odd).to_array(), Photo.from_bytes(data).to_array())
        np.testing.assert_array_equal(Photo.from_bytes(odd).grey(20), Photo.from_bytes(data).grey(20))


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(["JPEG", "PNG", "WEBP", "TIFF", "AVIF"]), st.data())
def test_damage_gives_a_picture_or_one_clear_line(format, data):
    whole = encoded(drawn(), format)
    damaged = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    try:
        photo = Photo.from_bytes(bytes(damaged), max_pixels=10_000_000)
        assert photo.to_array().shape[:2] == (photo.height, photo.width)
    except UnshutterError as error:
        assert "\n" not in str(error)


def test_too_many_pixels_are_refused_before_they_are_decoded():
    data = Photo.from_array(np.zeros((3000, 4000), np.uint8)).to_bytes("png")
    with pytest.raises(UnshutterError) as error:
        Photo.from_bytes(data, max_pixels=10_000_000)
    assert one_line(error).endswith("has 4000x3000 px (12 megapixels), more than the limit of 10 megapixels")
    bomb = bytearray(data)
    bomb[16:24] = struct.pack(">II", 60000, 60000)
    bomb[29:33] = struct.pack(">I", zlib.crc32(bomb[12:29]))
    with pytest.raises(UnshutterError, match="3600 megapixels"):
        Photo.from_bytes(bytes(bomb))


@pytest.mark.parametrize(
    "array",
    [np.zeros((4, 4), np.float32), np.zeros((4, 4, 3), np.int16), np.zeros((4, 4), bool), np.zeros(9, np.uint8)]
    + [np.zeros(shape, np.uint8) for shape in ((4, 4, 5), (0, 4), (4, 4, 0), (1, 4, 4, 3))],
)
def test_arrays_of_other_kinds_are_refused(array):
    with pytest.raises(UnshutterError) as error:
        Photo.from_array(array)
    one_line(error)


def test_impossible_requests_are_usage_errors(tmp_path):
    photo = Photo.from_array(drawn())
    for use in (
        lambda: photo.save(tmp_path / "a.gif"),
        lambda: photo.save(tmp_path / "noending"),
        lambda: photo.save(tmp_path / "a.jpg", quality=0),
        lambda: photo.to_bytes("jpeg", quality=101),
        lambda: photo.to_bytes("bmp"),
        lambda: photo.grey(0),
    ):
        with pytest.raises(UsageError) as error:
            use()
        one_line(error)
    with pytest.raises(UnshutterError, match="WEBP, which ends at 16383 px"):
        Photo.from_array(np.zeros((1, 16384), np.uint8)).to_bytes("webp")
    with pytest.raises(UnshutterError, match="uint8 or uint16"):
        photo.with_pixels(photo.pixels.astype(float))
    assert os.listdir(tmp_path) == []


# ---- saving --------------------------------------------------------------------------------------------


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("format", WRITTEN)
def test_save_chooses_the_format_by_the_ending_and_leaves_the_original_alone(tmp_path, format):
    original = tmp_path / "in[1] ö.jpg"
    original.write_bytes(encoded(drawn(), "JPEG"))
    before = digest(original)
    for suffix in WRITTEN[format].suffixes:
        target = tmp_path / f"out[2]{suffix.upper()}"
        Photo.open(original).save(target)
        assert Photo.open(target).format == format
    assert digest(original) == before
    assert len(os.listdir(tmp_path)) == 1 + len(WRITTEN[format].suffixes)
    assert oct(target.stat().st_mode) == oct(original.stat().st_mode)  # not a temporary file's rights


@pytest.mark.skipif(sys.platform != "linux", reason="other systems' names are text")
def test_names_that_are_not_text(tmp_path):
    path = tmp_path / os.fsdecode(b"b\xfcro.jpg")
    path.write_bytes(encoded(drawn(), "JPEG"))
    Photo.open(path).save(path.with_suffix(".png"))
    assert Photo.open(path.with_suffix(".png")).width == 80


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
    with pytest.raises(UnshutterError, match="use --overwrite"):
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


def test_saving_through_a_link_writes_the_file_behind_it(tmp_path):
    behind, link = tmp_path / "behind.png", tmp_path / "link.png"
    behind.write_bytes(b"old")
    link.symlink_to(behind)
    Photo.from_array(drawn()).save(link, overwrite=True)
    assert link.is_symlink()
    np.testing.assert_array_equal(Photo.open(behind).to_array(), drawn())


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
    target = tmp_path / f"out{WRITTEN[format].suffixes[0]}"
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
        Photo.from_bytes(REFUSED["webp head only"][0])
    assert one_line(error).endswith("unusual: webp: unable to parse image")


def test_an_interrupted_save_leaves_nothing_behind(tmp_path, monkeypatch):
    def interrupted(source, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Photo.from_array(drawn()).save(tmp_path / "out.png")
    assert os.listdir(tmp_path) == []


def test_a_file_changed_since_is_read_anew(tmp_path):
    path = tmp_path / "in.png"
    for pixels in (drawn(), drawn()[::-1], drawn(20, 30)):
        path.write_bytes(encoded(np.ascontiguousarray(pixels), "PNG"))
        np.testing.assert_array_equal(Photo.open(path).to_array(), pixels)
