"""The row map by itself, and what strangers may write into a motion file for one."""

import base64
import json
import pickle
import tracemalloc
import zlib

import numpy as np
import pytest

from unshutter import Motion, RowMapMotion, RowMotion, UnshutterError
from unshutter.motion import RowMap


def motion(row_map: RowMap | None = None) -> RowMapMotion:
    plain = RowMotion.from_polynomials([0, 12, -5], [0, 0.08], 60, 80)
    row_map = row_map or RowMap(np.linspace(-1, 1, 12).reshape(3, 4), (10, 0), (60, 60))
    return RowMapMotion(80, plain.tx_px, plain.rz_rad, row_map)


def test_a_map_of_no_residual_looks_up_the_row_itself() -> None:
    flat = motion(RowMap(np.zeros((2, 2)), (0, 0), (80, 60)))
    col, row = flat.gs_to_rs(20.0, 30.0)
    rz = flat.rz_rad[30]
    x, y = 20 - 39.5, 30 - 29.5
    assert col == pytest.approx(x * np.cos(rz) - y * np.sin(rz) + flat.tx_px[30] + 39.5)
    assert row == pytest.approx(x * np.sin(rz) + y * np.cos(rz) + 29.5)


def test_the_residual_is_interpolated_and_goes_on_at_its_border() -> None:
    row_map = RowMap([[0, 0, 4], [0, 0, 4]], (0, 0), (30, 20))
    col = np.array([-50.0, 4.5, 14.5, 19.5, 24.5, 90.0])
    found = row_map.row_at(col, np.full(6, 9.5), (14.5, 9.5))
    np.testing.assert_allclose(found - 9.5, [0, 0, 0, 2, 4, 4], atol=1e-6)


def test_pickled_it_stays_read_only() -> None:
    back = pickle.loads(pickle.dumps(motion().row_map))
    assert back == motion().row_map and hash(back) == hash(motion().row_map)
    assert not back.residual_px.flags.writeable
    assert back != motion().row_map.scaled(0.5)
    assert back != "a row map"


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
        RowMap(*wrong)


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


def test_a_bomb_does_not_go_off() -> None:
    """A quarter of a gigabyte of zeros in 250 kB is unpacked no further than the shape says."""
    bomb = zlib.compressobj(9)
    small = b"".join(bomb.compress(bytes(2**20)) for _ in range(256)) + bomb.flush()
    data = json.loads(motion().to_json())
    data["row_map"]["residual_px"] = base64.b64encode(small).decode()
    text = json.dumps(data)
    tracemalloc.start()
    with pytest.raises(UnshutterError, match="shape"):
        Motion.from_json(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10 * 2**20
