"""Photos in PQ and HLG: pixels, colours and light levels of results, and copies in SDR."""

import io
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.camera_files import heic
from support.drawn_photos import drawn, one_line, textured
from support.tagged_files import png_with_chunks, with_code_points
from unshutter import RowMotion, UnshutterError
from unshutter.photo import Photo, boxes
from unshutter.photo.box_properties import state_colours
from unshutter.photo.code_points import CodePoints

PQ, HLG = 16, 18
HEIGHT, WIDTH = 96, 160
MOTION = RowMotion.from_polynomials([0, 12], [0, 0.03], HEIGHT, WIDTH)
LEVELS = (b"cLLI", struct.pack(">II", 1000 * 10_000, 200 * 10_000))
MASTERING = (b"mDCV", struct.pack(">8H2I", *range(1, 9), 10_000_000, 50))


def png(pixels: np.ndarray, transfer: int, *more: tuple[bytes, bytes], primaries: int = 9) -> bytes:
    data = cv2.imencode(".png", pixels[..., ::-1])[1].tobytes()
    return png_with_chunks(data, (b"cICP", bytes([primaries, transfer, 0, 1])), *more)


def pq(photo: np.ndarray) -> np.ndarray:
    """The code values of PQ for a picture in sRGB whose white has 203 cd/m2."""
    code = photo / 255
    nits = 203 * np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    root = (nits / 10_000) ** 0.1593017578125
    return np.rint(65_535 * ((0.8359375 + 18.8515625 * root) / (1 + 18.6875 * root)) ** 78.84375).astype(np.uint16)


def properties(data: bytes) -> dict[bytes, bytes]:
    """Contents of the boxes with properties of the primary picture, of which each has one."""
    meta = boxes.in_meta(io.BytesIO(data))
    return dict(boxes.inside(dict(boxes.inside(meta[b"iprp"]))[b"ipco"]))


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_code_values_are_rectified_like_any_pixels(transfer: int) -> None:
    pixels = textured(HEIGHT, WIDTH, dtype=np.uint16)
    result = unshutter.rectify(png(pixels, transfer, LEVELS, MASTERING), motion=MOTION, edges="crop")
    data = result.bytes
    plain = unshutter.rectify(pixels, motion=MOTION, edges="crop")
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), -1)[..., ::-1], plain.array)
    head = data[: data.index(b"IDAT")]
    for name, content in ((b"cICP", bytes([9, transfer, 0, 1])), LEVELS, MASTERING):
        assert head.count(name) == 1 and name + content in head
    assert result.encode().left_out == ()


@pytest.mark.parametrize("bands", [3, 4])
def test_avif_states_colours_and_light_as_png_did(bands: int) -> None:
    pixels = textured(HEIGHT, WIDTH, dtype=np.uint16)
    fallback = (b"gAMA", struct.pack(">I", 45455)), (b"cHRM", bytes(32))
    data = png(pixels, PQ, LEVELS, MASTERING, *fallback, primaries=12)
    if bands == 4:
        data = Photo.from_bytes(data).with_pixels(np.dstack([pixels, pixels[..., 0]])).to_bytes()
    source = Photo.from_bytes(data)
    made = source.encode("avif")
    assert made.left_out == ()
    told = properties(made.data)
    assert told[b"colr"] == b"nclx" + struct.pack(">HHHB", 12, PQ, 6, 0x80)
    assert told[b"clli"] == struct.pack(">HH", 1000, 200)
    assert told[b"mdcv"] == struct.pack(">8H2I", 3, 4, 5, 6, 1, 2, 7, 8, 10_000_000, 50)  # green and blue first
    again = Photo.from_bytes(made.data)
    assert np.abs(again.pixels.astype(int) - source.pixels).mean() < 1500
    assert again.encode().left_out == ()
    chunks = again.to_bytes("png")
    for name, content in ((b"cICP", bytes([12, PQ, 0, 1])), LEVELS, MASTERING):
        assert chunks.count(name + content) == 1


def test_other_decoders_find_the_colours_in_the_coded_data_too(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="FFmpeg decodes the picture here")
    path = tmp_path / "photo.avif"
    Photo.from_bytes(png(textured(HEIGHT, WIDTH, dtype=np.uint16), HLG)).save(path)
    with av.open(str(path)) as file:
        frame = next(file.decode(video=0))
        assert (frame.color_primaries, frame.color_trc, frame.color_range) == (9, HLG, 2)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"colrnclx", b"freenclx"))
    with av.open(str(path)) as file:
        frame = next(file.decode(video=0))
        assert (frame.color_primaries, frame.color_trc, frame.color_range) == (9, HLG, 2)


def test_ten_bits_stay_ten_bits_whose_white_is_white() -> None:
    pixels = np.repeat(np.linspace(0, 65_535, WIDTH).astype(np.uint16)[None, :, None], 3, axis=2)
    pixels = np.repeat(pixels, HEIGHT, axis=0)
    for data in (
        heic(pixels, color_primaries=9, transfer_characteristics=PQ),
        Photo.from_bytes(png(pixels, PQ)).to_bytes("avif", quality=100),
    ):
        photo = Photo.from_bytes(with_code_points(data, 9, PQ))
        assert photo.pixels.max() == 65_535
        result = Photo.from_bytes(photo.to_bytes("avif", quality=100))
        assert properties(result.to_bytes("avif"))[b"av1C"][2] == properties(photo.to_bytes("avif"))[b"av1C"][2]
        step = 65_535 / (4095 if data[8:12] == b"avif" else 1023)
        assert np.abs(result.pixels / step - np.rint(result.pixels / step)).max() < 0.1
        assert np.abs(result.pixels.astype(int) - photo.pixels).mean() < 2 * step


@pytest.mark.parametrize("format", ["jpeg", "webp", "tiff"])
def test_formats_without_hdr_are_refused(format: str) -> None:
    with pytest.raises(UnshutterError, match=r"cannot hold HDR colours \(HLG\): save it as AVIF or PNG") as error:
        Photo.from_bytes(png(drawn(dtype=np.uint16), HLG)).to_bytes(format)
    one_line(error)


def test_png_of_limited_range_is_refused() -> None:
    whole = png(drawn(dtype=np.uint16), PQ)
    with pytest.raises(UnshutterError, match="of limited range: convert it first"):
        Photo.from_bytes(png_with_chunks(whole[:33] + whole[49:], (b"cICP", bytes([9, PQ, 0, 0]))))


@pytest.mark.parametrize("primaries", [1, 9])
def test_copies_show_pq_as_sdr(primaries: int) -> None:
    """Up to half of white's light, they show what SDR would; the rest is darker by a shoulder, never by hue."""
    picture = textured(HEIGHT, WIDTH)
    photo = Photo.from_bytes(png(pq(picture), PQ, primaries=primaries))
    shown, grey = photo.screen_copy().astype(int), photo.grey().astype(int)
    if primaries == 1:
        dark = picture.max(axis=2) < 180
        assert dark.mean() > 0.2 and np.abs(shown - picture)[dark].max() <= 3
    assert np.abs(grey - cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)).mean() < 12
    assert np.array_equal(photo.upright(), photo.screen_copy())


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_brighter_code_values_are_brighter_in_copies(transfer: int) -> None:
    ramp = np.repeat(np.linspace(0, 65_535, 256).astype(np.uint16)[None, :, None], 3, axis=2).repeat(64, axis=0)
    photo = Photo.from_bytes(png(ramp, transfer))
    for copy in (photo.screen_copy()[0, :, 0], photo.grey()[0]):
        steps = np.diff(copy.astype(int))
        assert steps.min() >= 0 and copy[0] == 0 and copy[-1] >= 254
    code = 0.58 if transfer == PQ else 0.75  # of 203 cd/m2
    assert abs(int(photo.screen_copy()[0, round(255 * code), 0]) - 233) <= 4


def test_grey_hdr_stays_grey() -> None:
    pixels = textured(HEIGHT, WIDTH, 1, np.uint16)
    data = png_with_chunks(cv2.imencode(".png", pixels)[1].tobytes(), (b"cICP", bytes([9, PQ, 0, 1])))
    photo = Photo.from_bytes(data)
    assert photo.bands == 1 and Photo.from_bytes(photo.to_bytes()).bands == 1
    assert photo.screen_copy().shape == (HEIGHT, WIDTH, 3)
    assert Photo.from_bytes(photo.to_bytes("avif")).format == "avif"


def test_colours_that_are_stated_already_are_replaced() -> None:
    """As newer versions of libvips may do."""
    made = Photo.from_array(textured(HEIGHT, WIDTH)).to_bytes("avif")
    stream = io.BytesIO(made)
    state_colours(stream, CodePoints(1, 13))
    state_colours(stream, CodePoints(9, PQ, ((b"clli", bytes(4)),)))
    data = stream.getvalue()
    assert data.count(b"colrnclx") == 1 and properties(data)[b"colr"][4:8] == bytes([0, 9, 0, PQ])
    assert properties(data)[b"clli"] == bytes(4)
    assert Photo.from_bytes(data).pixels.shape == (HEIGHT, WIDTH, 3)
