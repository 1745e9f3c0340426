"""A photo that an editor turned or mirrored, its readout direction named, comes out as it would have before."""

import dataclasses
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps

import unshutter
from support.camera_files import AS_STORED, MIRRORED, ORIENTATIONS, dng, heic, linear
from support.covering import covering, thorough
from support.drawn_photos import encoded, textured
from support.tagged_files import exif_blob
from unshutter import Motion, RowMotion, ScanDirection
from unshutter.cli import main
from unshutter.motion.warp import distort_pixels
from unshutter.photo import Photo

# Which side of the picture is read first, and where the reading goes: (rows, columns).
WAYS = {
    ScanDirection.TOP_TO_BOTTOM: (1, 0),
    ScanDirection.BOTTOM_TO_TOP: (-1, 0),
    ScanDirection.LEFT_TO_RIGHT: (0, 1),
    ScanDirection.RIGHT_TO_LEFT: (0, -1),
}


def turned_readout(readout: ScanDirection, orientation: int) -> ScanDirection:
    """The readout direction of stored pixels, from that of the picture that a viewer shows: where its rows went."""
    row, col = np.mgrid[0:8, 0:8]
    down, right = WAYS[readout]
    stored_time = AS_STORED[orientation](down * row + right * col)
    way = (np.sign(stored_time[1, 0] - stored_time[0, 0]), np.sign(stored_time[0, 1] - stored_time[0, 0]))
    return next(candidate for candidate, its in WAYS.items() if its == way)


def mirrored(motion: Motion) -> Motion:
    return dataclasses.replace(motion, tx_px=-motion.tx_px, rz_rad=-motion.rz_rad)


def each_way(orientations):
    return pytest.mark.parametrize(
        ("taken", "orientation"), covering([*ScanDirection], orientations), indirect=["taken"]
    )


@pytest.fixture(scope="module")
def taken(request: pytest.FixtureRequest, facade_canvas: np.ndarray) -> tuple[np.ndarray, Motion]:
    """A photo as a viewer shows it, 360 x 500 px, and its motion, for each direction in which it was read."""
    readout = request.param
    height, width = facade_canvas.shape[:2]
    motion = RowMotion.from_polynomials(
        [0, 40, -70], [0, 0.05], *readout.frame_size(height, width), scan_direction=readout
    )
    distorted = distort_pixels(facade_canvas, motion)
    return distorted[120:480, 120:620].copy(), RowMotion.from_polynomials(
        [0, 30, -50], [0, 0.05, -0.02], *readout.frame_size(360, 500), scan_direction=readout
    )


def write_turned(path: Path, upright: np.ndarray, orientation: int) -> Path:
    path.write_bytes(encoded(np.ascontiguousarray(AS_STORED[orientation](upright)), "PNG", exif=exif_blob(orientation)))
    return path


def rectified(path: Path, readout: ScanDirection, *more: str) -> np.ndarray:
    """The stored pixels that the command makes of a file, whose orientation stays."""
    out = path.with_suffix(".out.png")
    assert main(["rectify", "--edges", "keep", str(path), "-o", str(out), "--readout", readout, *more]) == 0
    result, photo = Photo.open(out), Photo.open(path)
    assert result.orientation == photo.orientation
    return result.to_array()


def all_but_few_differ_by(one: np.ndarray, other: np.ndarray) -> float:
    """The difference in grey levels that all but a thousandth of the values stay below."""
    assert one.shape == other.shape
    return float(np.quantile(np.abs(one.astype(int) - other.astype(int)), 0.999))


@pytest.fixture(scope="module")
def plain(taken: tuple[np.ndarray, Motion], tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """What the command makes by that motion of the photo before it is turned."""
    upright, motion = taken
    folder = tmp_path_factory.mktemp("given")
    motion.save(folder / "motion.json")
    return rectified(
        write_turned(folder / "plain.png", upright, 1), motion.scan_direction, "--motion", f"{folder}/motion.json"
    )


ROUNDING = 2  # grey levels, at the sharpest edges: OpenCV rounds positions to 1/32 px


@each_way(ORIENTATIONS)
def test_a_given_motion_does_the_same_to_a_turned_photo(
    tmp_path: Path, taken: tuple[np.ndarray, Motion], plain: np.ndarray, orientation: int
) -> None:
    upright, motion = taken
    turned = turned_readout(motion.scan_direction, orientation)
    same = mirrored(motion) if orientation in MIRRORED else motion
    dataclasses.replace(same, scan_direction=turned).save(tmp_path / "turned.json")
    file = write_turned(tmp_path / "turned.png", upright, orientation)
    result = rectified(file, turned, "--motion", f"{tmp_path}/turned.json")
    assert all_but_few_differ_by(plain, upright) > 100  # much was done
    assert all_but_few_differ_by(result, AS_STORED[orientation](plain)) <= ROUNDING


@pytest.fixture(scope="module")
def found(taken: tuple[np.ndarray, Motion], tmp_path_factory: pytest.TempPathFactory) -> tuple[Motion, np.ndarray]:
    """What the command finds in the photo before it is turned, and makes of it."""
    upright, motion = taken
    folder = tmp_path_factory.mktemp("plain")
    file = write_turned(folder / "plain.png", upright, 1)
    result = rectified(file, motion.scan_direction, *METHOD, "--save-motion", f"{folder}/motion.json")
    return Motion.load(folder / "motion.json"), result


METHOD = ("--estimator", "segment-manhattan")  # the one that asks where the scene's top is


@each_way([2, 3, 5, 8])  # mirrored, turned about, both, and turned
def test_the_same_motion_is_found_in_a_turned_photo(
    tmp_path: Path, taken: tuple[np.ndarray, Motion], found: tuple[Motion, np.ndarray], orientation: int
) -> None:
    upright, motion = taken
    plain_motion, plain = found
    assert np.ptp(plain_motion.tx_px) > 5  # much was found
    file = write_turned(tmp_path / "turned.png", upright, orientation)
    turned = turned_readout(motion.scan_direction, orientation)
    result = rectified(file, turned, *METHOD, "--save-motion", f"{tmp_path}/motion.json")
    again = Motion.load(tmp_path / "motion.json")
    difference = all_but_few_differ_by(result, AS_STORED[orientation](plain))
    if orientation in MIRRORED:  # segments are not found to the last digit alike in a mirrored picture
        np.testing.assert_allclose(mirrored(again).tx_px, plain_motion.tx_px, atol=1.0)
    else:
        np.testing.assert_allclose(again.tx_px, plain_motion.tx_px, atol=1e-6)
        np.testing.assert_allclose(again.rz_rad, plain_motion.rz_rad, atol=1e-9)
        assert difference <= ROUNDING


# ---- files whose decoders turn pictures by themselves ------------------------------------------------------


@pytest.mark.parametrize("orientation", [thorough(each) if each in (2, 3, 5, 7) else each for each in ORIENTATIONS])
def test_heic_is_read_as_the_sensor_was(tmp_path: Path, rolling_facade: np.ndarray, orientation: int) -> None:
    stored = rolling_facade[30:210, 20:270]
    path = tmp_path / "photo.heic"
    path.write_bytes(heic(stored, orientation, quality=100))
    photo = Photo.open(path)
    assert (photo.orientation, photo.height, photo.width) == (orientation, 180, 250)
    assert np.abs(photo.to_array().astype(int) - stored).mean() < 1.5
    motion = RowMotion.from_polynomials([0, 15, -25], [0, 0.05], 180, 250)
    expected = unshutter.rectify(stored, motion=motion, edges="keep").array
    motion.save(tmp_path / "motion.json")
    for name in ("out.png", "out.avif", "out.jpg", "out.tif"):
        out = tmp_path / name
        options = ["--motion", str(tmp_path / "motion.json"), "--quality", "95"]
        assert main(["rectify", "--edges", "keep", str(path), "-o", str(out), *options]) == 0
        result = Photo.open(out)
        assert result.orientation == orientation
        assert np.abs(result.to_array().astype(int) - expected).mean() < 3
    with Image.open(tmp_path / "out.jpg") as picture:  # another program shows it upright
        shown = np.asarray(ImageOps.exif_transpose(picture))
    assert np.abs(AS_STORED[orientation](shown).astype(int) - expected).mean() < 3


def test_boxes_in_another_order_mean_another_orientation() -> None:
    """Mirrored, then turned: libheif follows the order in which the file lists them, and so must we."""
    stored = textured(48, 80)
    data = heic(stored, 5)  # irot, imir
    start = data.index(b"ipma") + 15
    listed = data[start : start + data[start - 1]]
    properties = re.findall(rb"ispe|hvcC|colr|pixi|clap|irot|imir", data[data.index(b"ipco") : start])
    turn, mirror = (properties.index(name) + 1 for name in (b"irot", b"imir"))
    at_turn, at_mirror = (next(i for i, n in enumerate(listed) if n & 127 == p) for p in (turn, mirror))
    swapped = bytearray(listed)
    swapped[at_turn], swapped[at_mirror] = listed[at_mirror], listed[at_turn]
    photo = Photo.from_bytes(data.replace(listed, bytes(swapped)))
    assert photo.orientation == 7
    assert np.abs(photo.to_array().astype(int) - stored).mean() < 4


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_raw_rows_stay_rows_of_the_sensor(tmp_path: Path, rolling_facade: np.ndarray, orientation: int) -> None:
    stored = cv2.GaussianBlur(rolling_facade[30:390, 20:520], (0, 0), 2)  # what a mosaic holds
    stored[:8, :8] = 255  # LibRaw takes the brightest for white if it is near
    path = tmp_path / "photo.dng"
    path.write_bytes(dng(linear(stored), orientation))
    photo = Photo.open(path)
    assert (photo.format, photo.orientation, photo.height, photo.width) == ("raw", orientation, 360, 500)
    assert np.abs(photo.to_array() / 257 - stored).mean() < 4
    motion = RowMotion.from_polynomials([0, 30, -50], [0, 0.05], 360, 500)
    motion.save(tmp_path / "motion.json")
    assert main(["rectify", "--edges", "keep", str(path), "--motion", str(tmp_path / "motion.json")]) == 0
    result = Photo.open(tmp_path / "photo.dng.rectified.tif")
    assert result.orientation == orientation and result.to_array().dtype == np.uint16
    expected = unshutter.rectify(stored, motion=motion, edges="keep").array
    assert np.abs(result.to_array() / 257 - expected).mean() < 4
