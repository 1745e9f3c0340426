"""HEIC and raw files: what is read from them, where it goes, and what is said where an extra is missing."""

import io
import json
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms
from PIL.JpegImagePlugin import get_sampling

import unshutter
from support.camera_files import dng, exif_blob, heic, linear
from support.drawn_photos import drawn, encoded, one_line
from unshutter import RowMotion
from unshutter.cli import main
from unshutter.errors import UnshutterError
from unshutter.photo import Photo, metadata, raw_tags

EXIF, GPS = 0x8769, 0x8825
XMP = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmp:Rating="4"/></rdf:RDF></x:xmpmeta>'
)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
NOTE = b"Acme\0" + bytes(range(200))


def rich_exif(orientation=1):
    exif = Image.Exif()
    exif.update({0x010F: "Acme", 0x0110: "One", 0x0112: orientation, 0x0132: "2024:05:06 07:08:09"})
    exif.get_ifd(EXIF).update({0x9003: "2024:05:06 07:08:09", 0x927C: NOTE, 0xA405: 26})
    exif.get_ifd(GPS).update({1: "N", 2: (48.0, 51.0, 29.5)})
    return exif.tobytes()


def check_rich_exif(data: bytes) -> None:
    with Image.open(io.BytesIO(data)) as picture:
        tags = picture.getexif()
    assert tags[0x0132] == tags.get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09"
    assert tags.get_ifd(EXIF)[0x927C] == NOTE and tags.get_ifd(GPS)[2] == (48.0, 51.0, 29.5)


# ---- HEIC ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bands", [1, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_heic_of_all_kinds_of_pixels(bands: int, dtype: type) -> None:
    pixels = drawn(64, 96, bands=bands, dtype=dtype)
    photo = Photo.from_bytes(heic(pixels[..., 0] if bands == 1 else pixels))
    assert (photo.format, photo.height, photo.width, photo.bands) == ("heic", 64, 96, bands)
    read = photo.pixels
    assert read.dtype == dtype and read.shape == pixels.shape
    assert np.abs(read.astype(float) - pixels).mean() / np.iinfo(dtype).max < 0.01
    again = Photo.from_bytes(photo.to_bytes(quality=95))  # as AVIF
    assert again.format == "avif" and again.pixels.dtype == dtype and again.has_alpha == (bands == 4)
    if dtype == np.uint16:
        assert np.all(read % 64 == 0) and np.all(again.pixels % 64 == 0)  # 10 bits, and no more


def test_heic_gives_its_metadata_to_every_format() -> None:
    photo = Photo.from_bytes(heic(drawn(64, 96), exif=rich_exif(6), icc_profile=SRGB, icc_profile_type="prof", xmp=XMP))
    assert photo.orientation == 6 and photo.focal_px() == pytest.approx(26 / 43.2666 * np.hypot(64, 96), rel=1e-4)
    for target in ("jpeg", "png", "webp", "tiff", "avif"):
        data = photo.with_pixels(~photo.pixels).to_bytes(target)
        check_rich_exif(data)
        with Image.open(io.BytesIO(data)) as picture:
            assert picture.info["icc_profile"] == SRGB
            assert b'xmp:Rating="4"' in (picture.info.get("xmp") or picture.info["XML:com.adobe.xmp"].encode())
        assert Photo.from_bytes(data).orientation == 6


@pytest.mark.parametrize(("chroma", "expected"), [(444, 0), (420, 2)])
def test_heic_gives_its_subsampling_to_jpeg(chroma: int, expected: int) -> None:
    photo = Photo.from_bytes(heic(drawn(64, 96), chroma=chroma))
    with Image.open(io.BytesIO(photo.to_bytes("jpeg"))) as picture:
        assert get_sampling(picture) == expected


def with_code_points(data: bytes, primaries: int, transfer: int) -> bytes:
    """The same box file with other colours said."""
    at = data.index(b"colrnclx") + 8
    return data[:at] + struct.pack(">HH", primaries, transfer) + data[at + 4 :]


@pytest.mark.parametrize("format", ["heic", "avif"])
def test_colours_told_by_numbers_become_a_profile_or_are_refused(format: str) -> None:
    data = heic(drawn(64, 96)) if format == "heic" else encoded(drawn(64, 96), "AVIF")
    plain = Photo.from_bytes(with_code_points(data, 1, 13)).to_bytes("jpeg")
    wide = Photo.from_bytes(with_code_points(data, 12, 13)).to_bytes("jpeg")
    with Image.open(io.BytesIO(plain)) as first, Image.open(io.BytesIO(wide)) as second:
        assert "icc_profile" not in first.info
        profile = ImageCms.ImageCmsProfile(io.BytesIO(second.info["icc_profile"]))
        red = profile.profile.red_primary[1]
        assert red[:2] == pytest.approx((0.680, 0.320), abs=0.01)  # that of Display P3
    for primaries, transfer in ((9, 16), (9, 18), (12, 16), (9, 13)):
        with pytest.raises(UnshutterError, match="HDR") as error:
            Photo.from_bytes(with_code_points(data, primaries, transfer))
        one_line(error)


@pytest.mark.parametrize("kept", [0.2, 0.6, 0.97])
def test_truncated_heic_is_refused(tmp_path: Path, kept: float) -> None:
    data = heic(drawn(200, 300))
    path = tmp_path / "a.heic"
    path.write_bytes(data[: int(len(data) * kept)])
    with pytest.raises(UnshutterError) as error:
        Photo.open(path).save(tmp_path / "a.png")
    assert "damaged" in one_line(error) and str(path) in str(error.value)
    assert [p.name for p in tmp_path.iterdir()] == ["a.heic"]


# ---- raw -----------------------------------------------------------------------------------------------------


def soft(height=120, width=160) -> np.ndarray:
    """Soft colours with some white: LibRaw takes the brightest for white if it is near."""
    pixels = drawn(height, width)
    pixels[:8, :8] = 255
    return pixels


def test_raw_is_developed_plainly_in_16_bits() -> None:
    pixels = soft()
    photo = Photo.from_bytes(dng(linear(pixels)))
    assert (photo.format, photo.bands, photo.orientation) == ("raw", 3, 1)
    read = photo.pixels
    assert read.dtype == np.uint16 and np.any(read % 256)
    assert np.abs(read / 257 - pixels)[12:-4, 12:-4].mean() < 2.5
    dark = Photo.from_bytes(dng(linear(np.minimum(pixels, 100)))).pixels  # not brightened
    assert dark.max() < 110 * 257
    tiff = Photo.from_bytes(photo.to_bytes())
    assert tiff.format == "tiff" and np.array_equal(tiff.pixels, read)


def raw_with_exif(orientation=1) -> bytes:
    stream = io.BytesIO(dng(linear(soft()), orientation, tags=[(700, 1, len(XMP), XMP, True)]))
    metadata.add_exif_to_tiff(stream, rich_exif(), 120, 160)
    return stream.getvalue()


@pytest.mark.parametrize("target", ["jpeg", "png", "webp", "tiff", "avif"])
def test_raw_gives_its_metadata_to_every_format(target: str) -> None:
    photo = Photo.from_bytes(raw_with_exif(8))
    data = photo.with_pixels(~photo.pixels).to_bytes(target)
    check_rich_exif(data)
    with Image.open(io.BytesIO(data)) as picture:
        assert ImageCms.ImageCmsProfile(io.BytesIO(picture.info["icc_profile"])).profile.profile_description
        assert b'xmp:Rating="4"' in (picture.info.get("xmp") or picture.info["XML:com.adobe.xmp"].encode())
        if target != "tiff":
            assert picture.getexif()[0x0112] == 8
    assert Photo.from_bytes(data).orientation == 8


def test_raw_of_too_many_pixels_is_refused_before_it_is_developed() -> None:
    with pytest.raises(UnshutterError, match="160x120 px"):
        Photo.from_bytes(dng(linear(soft())), max_pixels=10_000)


def test_broken_raw_is_refused(tmp_path: Path) -> None:
    data = dng(linear(soft()))
    for name, content in (("a.dng", data[:3000]), ("b.nef", b"no raw file at all" * 9), ("c.cr2", data[:100])):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UnshutterError, match="as a camera's raw file") as error:
            Photo.open(tmp_path / name).to_array()
        assert str(tmp_path / name) in one_line(error)


def box(name: bytes, *contents: bytes) -> bytes:
    return struct.pack(">I4s", 8 + sum(map(len, contents)), name) + b"".join(contents)


def test_exif_is_found_where_each_maker_puts_it() -> None:
    tiff = rich_exif().removeprefix(b"Exif\0\0")
    little = Image.Exif()
    little.endian = "<"
    little.update({0x010F: "Acme"})
    olympus = b"IIRO" + little.tobytes().removeprefix(b"Exif\0\0")[4:]
    jpeg = encoded(drawn(), "JPEG", exif=rich_exif())
    fuji = b"FUJIFILMCCD-RAW ".ljust(84, b"\0") + struct.pack(">II", 100, len(jpeg)) + bytes(8) + jpeg
    exif_only, gps_only = Image.Exif(), Image.Exif()
    exif_only.update({0x9003: "2024:05:06 07:08:09"})
    gps_only.update({1: "N"})
    parts = (exif.tobytes().removeprefix(b"Exif\0\0") for exif in (exif_only, gps_only))
    parts = [box(b"CMT1", tiff), *(box(name, part) for name, part in zip((b"CMT2", b"CMT4"), parts, strict=True))]
    canon = bytes.fromhex("85c0b687820f11e08111f4ce462b6a48")
    cr3 = box(b"ftyp", b"crx \0\0\0\1crx isom") + box(b"moov", box(b"uuid", canon, *parts), box(b"trak"))
    for data in (tiff, olympus, fuji, cr3):
        tree = raw_tags.read_tags(io.BytesIO(data))
        assert tree is not None and tree.data(0x010F) == b"Acme\0"
    tree = raw_tags.read_tags(io.BytesIO(cr3))
    assert tree is not None
    again = Image.Exif()
    again.load(metadata.exif_of_tiff(tree))
    assert again.get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09" and again.get_ifd(GPS)[1] == "N"
    for broken in (b"", fuji[:90], cr3[:60], box(b"ftyp", b"crx \0\0\0\1")):
        assert raw_tags.read_tags(io.BytesIO(broken)) is None


# ---- folders, names, missing extras --------------------------------------------------------------------------


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
        assert f"cannot write '{name}': such files are only read" in capsys.readouterr().err
    assert main(["rectify", str(folder / "a.jpg"), "-o", str(folder / "x.png"), "--format", "tiff"]) == 2
    assert "--format is for folders" in capsys.readouterr().err


def test_bytes_in_bytes_out(rolling_facade: np.ndarray) -> None:
    pixels = rolling_facade[:200, :300]
    motion = RowMotion.from_polynomials([0, 9], [0], 200, 300)
    for data, format in ((heic(pixels), "avif"), (dng(linear(pixels)), "tiff")):
        assert Photo.from_bytes(unshutter.rectify(data, motion=motion)).format == format


@pytest.mark.parametrize("jobs", [[], ["--jobs", "1"]])
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
    assert f"{folder}/a.DNG is a camera's raw file: to read it, pip install 'unshutter[raw]'" in said
    assert f"{folder}/b.HEIC is a HEIC photo: to read it, pip install 'unshutter[heic]'" in said
    assert "Traceback" not in said
    end = json.loads(log.read_text().splitlines()[-1])
    assert (end["event"], end["failed"], end["done"]) == ("end", 2, 2)
