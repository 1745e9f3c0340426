"""The row map by itself, and what strangers may write into a motion file for one."""

import base64
import json
import math
import pickle
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from unshutter import Motion, RowMotion, ScanDirection, UnshutterError, UsageError
from unshutter.motion.warp import straighten
from unshutter_lab.methods import row_map as row_map_module
from unshutter_lab.methods.row_map import RowMapMotion, gs_to_rs_by_row_map

ROW_MAP = (np.linspace(-1, 1, 12).reshape(3, 4), (10, 0), (60, 60))
COL, ROW = np.meshgrid(np.arange(0, 80, 7.0), np.arange(0, 60, 7.0))


def motion(*row_map, **common) -> RowMapMotion:
    plain = RowMotion.from_polynomials([0, 12, -5], [0, 0.08], 60, 80)
    return RowMapMotion(80, plain.tx_px, plain.rz_rad, *(row_map or ROW_MAP), **common)


def test_with_the_true_rows_eq_1_is_the_exact_inverse() -> None:
    plain = motion().row_motion
    seen = plain.gs_to_rs(COL, ROW)
    tx, rz, _ = plain.at(seen[1])
    np.testing.assert_allclose(gs_to_rs_by_row_map(COL, ROW, tx, rz, plain.center), seen, atol=1e-9)


def test_a_map_of_no_residual_looks_up_the_row_itself() -> None:
    flat = motion(np.zeros((2, 2)), (0, 0), (80, 60))
    col, row = flat.gs_to_rs(20.0, 30.0)
    rz = flat.rz_rad[30]
    x, y = 20 - 39.5, 30 - 29.5
    assert col == pytest.approx(x * np.cos(rz) - y * np.sin(rz) + flat.tx_px[30] + 39.5)
    assert row == pytest.approx(x * np.sin(rz) + y * np.cos(rz) + 29.5)


def test_the_residual_is_interpolated_and_goes_on_at_its_border() -> None:
    still = RowMapMotion(30, np.zeros(20), np.zeros(20), [[0, 0, 4], [0, 0, 4]], (0, 0), (30, 20))
    col = np.array([-50.0, 4.5, 14.5, 19.5, 24.5, 90.0])
    np.testing.assert_allclose(still.row_at(col, np.full(6, 9.5)) - 9.5, [0, 0, 0, 2, 4, 4], atol=1e-6)


def test_it_is_a_value_that_survives_pickling() -> None:
    back = pickle.loads(pickle.dumps(motion()))
    assert back == motion() and hash(back) == hash(motion()) and back != motion().scaled(0.5)
    assert not back.residual_px.flags.writeable and not back.tx_px.flags.writeable


@pytest.mark.parametrize("reference", ["first", "middle", "last"])
def test_another_reference_sees_the_same_scene_from_another_pose(reference) -> None:
    """What stood at p in the first row's picture stands at R p + t in the other's: both look at one RS position."""
    first = motion(scan_direction=ScanDirection.LEFT_TO_RIGHT)
    other = first.rereferenced(reference)
    tx, rz = first.tx_px[other.reference_row], first.rz_rad[other.reference_row]
    x, y = COL - 39.5, ROW - 29.5
    moved = x * np.cos(rz) - y * np.sin(rz) + tx + 39.5, x * np.sin(rz) + y * np.cos(rz) + 29.5
    np.testing.assert_allclose(other.gs_to_rs(*moved), first.gs_to_rs(COL, ROW), atol=1e-9)
    np.testing.assert_allclose(other.rereferenced("first").gs_to_rs(COL, ROW), first.gs_to_rs(COL, ROW), atol=1e-9)
    assert (other.reference, other.scan_direction, other.tx_px[other.reference_row]) == (
        reference,
        first.scan_direction,
        0,
    )


def test_it_is_resized_exactly() -> None:
    """Where the reference row does not move, twice the size is the same picture to the last digit but float32."""
    tx = np.concatenate([np.zeros(30), np.linspace(0, 9, 30)])
    small = RowMapMotion(80, tx, np.zeros(60), *ROW_MAP, pose=(3, 0.02))
    large = small.resized(120, 160)
    straight = ROW < 48  # beyond, rows past the last one are looked up
    for one, two in zip(large.gs_to_rs(2 * COL + 0.5, 2 * ROW + 0.5), small.gs_to_rs(COL, ROW), strict=True):
        np.testing.assert_allclose(((one - 0.5) / 2)[straight], two[straight], atol=0.06)
    assert small.resized(60, 80) is small
    with pytest.raises(UnshutterError):
        small.resized(80, 60)


def test_scaled() -> None:
    middle = motion().rereferenced("middle")
    assert middle.scaled(1) == middle and middle.scaled(0).is_zero and not middle.is_zero
    np.testing.assert_allclose(middle.scaled(0).gs_to_rs(COL, ROW), (COL, ROW), atol=1e-9)
    with pytest.raises(UsageError, match="strength"):
        middle.scaled(-0.1)


def test_rates_and_single_rows() -> None:
    turning, velocity = motion().rates()
    assert (turning.shape, velocity.shape) == ((60,), (60, 2))
    single = replace(motion(), tx_px=motion().tx_px[:1], rz_rad=motion().rz_rad[:1])
    single.check_unfolded()
    assert Motion.from_json(single.to_json()) == single


def test_a_file_gives_back_the_same_motion_and_picture(tmp_path: Path) -> None:
    """In another process, too, where nothing has imported the laboratory."""
    motion().save(tmp_path / "m.json")
    assert Motion.load(tmp_path / "m.json") == motion()
    script = "import sys, unshutter; print(type(unshutter.Motion.load(sys.argv[1])).__name__)"
    done = subprocess.run([sys.executable, "-c", script, tmp_path / "m.json"], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("RowMapMotion\n", "")
    pixels = np.random.default_rng(1).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    loaded = straighten(pixels, Motion.load(tmp_path / "m.json"))[0]
    assert np.array_equal(loaded, straighten(pixels, motion())[0])
    assert not np.array_equal(loaded, straighten(pixels, motion().row_motion)[0])


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ((np.zeros((1, 5)), (0, 0), (9, 9)), "rows and columns"),
        ((np.zeros(5), (0, 0), (9, 9)), "rows and columns"),
        ((np.full((2, 2), np.nan), (0, 0), (9, 9)), "finite"),
        ((np.full((2, 2), 1e7), (0, 0), (9, 9)), "moves"),
        ((np.zeros((2, 2)), (0, np.inf), (9, 9)), "finite"),
        ((np.zeros((2, 2)), (0, 0), (9, 0)), "larger than nothing"),
        ((np.zeros((2, 2)), (0, 0), (9, 9), (1e9, 0)), "moves"),
        ((np.zeros((2, 2)), (0, 0), (9, 9), (0, 9)), "turns"),
    ],
)
def test_maps_that_are_none(wrong: tuple, says: str) -> None:
    with pytest.raises(UnshutterError, match=says):
        motion(*wrong)


def packed(values: bytes) -> str:
    return base64.b64encode(zlib.compress(values)).decode()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"residual_px": packed(bytes(47))}, "shape"),
        ({"residual_px": packed(bytes(49))}, "shape"),
        ({"residual_px": packed(bytes(48))[:-8]}, "shape|not a usable"),
        ({"residual_px": packed(b"\xff" * 48)}, "finite"),
        ({"residual_px": base64.b64encode(b"no zlib").decode()}, "damaged"),
        ({"residual_px": "no base64!"}, "not a usable"),
        ({"residual_px": 7}, "not a usable"),
        ({"residual_px": None}, "not a usable"),
        ({"shape": [4, 4]}, "shape"),
        ({"shape": [12]}, "rows and columns"),
        ({"shape": [3, 4, 1]}, "rows and columns"),
        ({"shape": [-3, -4]}, "rows and columns"),
        ({"shape": [10**9, 10**9]}, "rows and columns"),
        ({"shape": ["a", 4]}, "not a usable"),
        ({"corner": [0]}, "not a usable"),
        ({"corner": "ab"}, "not a usable"),
        ({"size": [0, 60]}, "larger"),
        ({"size": [1e-9, 60]}, "larger"),
        ({"pose": [0, float("nan")]}, "finite"),
    ],
)
def test_bad_row_maps_in_files_get_one_clear_line(change: dict, says: str) -> None:
    data = json.loads(motion().to_json())
    data["row_map"] |= change
    with pytest.raises(UnshutterError, match=says) as caught:
        Motion.from_json(json.dumps(data))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("row_map", [None, [], "map", {}])
def test_row_maps_that_are_no_maps(row_map) -> None:
    data = json.loads(motion().to_json()) | {"row_map": row_map}
    with pytest.raises(UnshutterError, match="not a"):
        Motion.from_json(json.dumps(data))


def test_what_is_longer_than_its_shape_is_refused(monkeypatch) -> None:
    """It is unpacked no further than a byte more than the shape says."""
    data = json.loads(motion().to_json())
    row_map = data["row_map"]
    size = 4 * math.prod(row_map["shape"])
    row_map["residual_px"] = base64.b64encode(zlib.compress(bytes(size + 100))).decode()
    asked = []

    class Noted:
        def __init__(self) -> None:
            self.unpacker = zlib.decompressobj()

        def decompress(self, packed: bytes, most: int) -> bytes:
            asked.append(most)
            return self.unpacker.decompress(packed, most)

        eof = False

    monkeypatch.setattr(row_map_module, "zlib", mock.Mock(decompressobj=Noted, error=zlib.error))
    with pytest.raises(UnshutterError, match="shape"):
        Motion.from_json(json.dumps(data))
    assert asked == [size + 1]
