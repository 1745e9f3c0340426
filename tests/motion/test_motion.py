import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unshutter import Finding, Motion, RowMotion, ScanDirection, UnshutterError, UsageError, __version__
from unshutter.reasons import Reason


def wavy(height: int = 60, width: int = 80, **about) -> Motion:
    return RowMotion.from_polynomials([0, 12, -5], [0, 0.08, -0.03], height, width, **about)


def test_polynomials_run_from_the_first_to_the_last_row() -> None:
    motion = RowMotion.from_polynomials([0, 10], [0, 0.2, -0.1], 101, 50)
    assert motion.height == 101
    assert motion.tx_px[[0, 50, 100]] == pytest.approx([0, 5, 10])
    assert motion.rz_rad[[0, 50, 100]] == pytest.approx([0, 0.075, 0.1])


def test_key_rows_linear_and_fitted() -> None:
    rows = [0, 10, 20]
    linear = RowMotion.from_key_rows(rows, [0, 1, 4], [0, 0, 0], 31, 30)
    assert linear.tx_px[[5, 15, 30]] == pytest.approx([0.5, 2.5, 7.0])  # the last slope goes on
    fitted = RowMotion.from_key_rows(rows, [0, 1, 4], [0, 0.1, 0.4], 31, 30, degree=2)
    assert fitted.tx_px[30] == pytest.approx(9)
    assert fitted.rz_rad[30] == pytest.approx(0.9)
    with pytest.raises(UnshutterError, match="increasing"):
        RowMotion.from_key_rows([0, 5, 5], [0, 1, 2], [0, 0, 0], 31, 30)


def test_samples_cannot_be_changed() -> None:
    motion = wavy()
    with pytest.raises(ValueError, match="read-only"):
        motion.tx_px[0] = 1


def test_round_trip_of_points() -> None:
    motion = wavy()
    col, row = np.meshgrid(np.arange(0, 80, 7.0), np.arange(0, 60, 7.0))
    back = motion.rs_to_gs(*motion.gs_to_rs(col, row))
    np.testing.assert_allclose(back, (col, row), atol=1e-6)


@settings(deadline=None, max_examples=40)
@given(reference=st.sampled_from(["first", "middle", "last"]), then=st.sampled_from(["first", "middle", "last"]))
def test_another_reference_is_the_same_picture_moved_rigidly(reference, then) -> None:
    """The reason for center_shift_px: straight lines stay straight whatever row is the reference."""
    motion = wavy().rereferenced(reference)
    assert motion.tx_px[motion.reference_row] == 0
    assert motion.rz_rad[motion.reference_row] == 0
    rng = np.random.default_rng(0)
    col, row = rng.uniform(10, 70, 20), rng.uniform(10, 50, 20)
    one = np.stack(wavy().rs_to_gs(col, row))
    two = np.stack(motion.rereferenced(then).rs_to_gs(col, row))

    def distances(p):
        return np.hypot(*(p[:, :, None] - p[:, None, :]))

    np.testing.assert_allclose(distances(one), distances(two), atol=1e-9)


def test_going_back_to_the_first_reference_is_exact() -> None:
    motion = wavy()
    back = motion.rereferenced("last").rereferenced("middle").rereferenced("first")
    np.testing.assert_allclose(back.tx_px, motion.tx_px, atol=1e-12)
    np.testing.assert_allclose(back.rz_rad, motion.rz_rad, atol=1e-12)
    assert back.center_shift_px == pytest.approx(0, abs=1e-12)


def test_resizing_scales_positions() -> None:
    """A point at twice the size is the same point: positions of pixel centres scale as (p + 1/2) s - 1/2."""
    motion = wavy(100, 150)
    large = motion.resized(400, 600)
    assert (large.height, large.width) == (400, 600)
    assert large.tx_px[0] == 0
    col, row = np.array([20.0, 75.0, 140.0]), np.array([20.0, 50.0, 90.0])
    small = np.stack(motion.rs_to_gs(col, row))
    big = np.stack(large.rs_to_gs((col + 0.5) * 4 - 0.5, (row + 0.5) * 4 - 0.5))
    scaled = (small + 0.5) * 4 - 0.5
    assert np.abs(big - scaled).max() < 0.5  # the reference row moved by half a pixel of the small picture,
    apart = [np.hypot(*(p[:, :, None] - p[:, None, :])) for p in (big, scaled)]
    np.testing.assert_allclose(*apart, atol=0.02)  # which only moves the picture as a whole
    with pytest.raises(UnshutterError, match="aspect ratio"):
        motion.resized(150, 100)


def test_strength_scales_both_motions() -> None:
    half = wavy().scaled(0.5)
    np.testing.assert_allclose(half.tx_px * 2, wavy().tx_px)
    np.testing.assert_allclose(half.rz_rad * 2, wavy().rz_rad)
    assert wavy().scaled(0).is_zero
    with pytest.raises(UsageError, match="strength"):
        wavy().scaled(2.5)


def test_the_json_contract() -> None:
    finding = Finding(wavy(scan_direction=ScanDirection.LEFT_TO_RIGHT), estimator="x", confidence=0.25)
    data = json.loads(finding.to_json())
    assert list(data) == [
        "format",
        "kind",
        "height",
        "width",
        "readout",
        "reference",
        "reference_row",
        "largest_px",
        "tx_px",
        "rz_rad",
        "estimator",
        "confidence",
        "unshutter",
    ]
    assert (data["format"], data["kind"]) == ("unshutter-motion/1", "rows")
    assert (data["height"], data["width"], data["readout"]) == (60, 80, "left-to-right")
    assert (data["reference"], data["reference_row"]) == ("first", 0)
    assert len(data["tx_px"]) == len(data["rz_rad"]) == 60
    assert (data["estimator"], data["confidence"], data["unshutter"]) == ("x", 0.25, __version__)
    given = json.loads(finding.motion.to_json())
    assert given == data | {"estimator": "given", "confidence": None} and list(given) == list(data)


def test_saved_and_loaded(tmp_path: Path) -> None:
    motion = wavy().rereferenced("middle")
    Finding(motion, estimator="x", reason=Reason.stated("because")).save(tmp_path / "m.json")
    back = Motion.load(tmp_path / "m.json")
    np.testing.assert_array_equal(back.tx_px, motion.tx_px)
    np.testing.assert_array_equal(back.rz_rad, motion.rz_rad)
    assert (back.width, back.reference) == (80, "middle")
    found = Finding.load(tmp_path / "m.json")
    assert (found.motion, found.estimator, found.reason) == (back, "x", Reason.stated("because"))
    assert back.center_shift_px == pytest.approx(motion.center_shift_px)


def broken(**changes) -> str:
    data = json.loads(wavy().to_json())
    for key, value in changes.items():
        if value is None:
            del data[key]
        else:
            data[key] = value
    return json.dumps(data)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not a motion file"),
        ("[1, 2]", "not a motion file"),
        ("{}", "format"),
        (broken(format="unshutter-motion/2"), "format"),
        (broken(tx_px=None), "tx_px"),
        (broken(tx_px=[0.0]), "shapes"),
        (broken(tx_px=["a"] * 60), "not a usable"),
        (broken(tx_px=[float("nan")] * 60), "finite"),
        (broken(height=61), "61"),
        (broken(width=0), "width"),
        (broken(width="wide"), "not a usable"),
        (broken(reference="tenth"), "reference"),
        (broken(readout="diagonal"), "readout"),
        (broken(confidence=[1]), "not a usable"),
    ],
)
def test_bad_files_get_one_clear_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "m.json"
    path.write_text(text)
    with pytest.raises(UnshutterError, match=says) as caught:
        Finding.load(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_missing_and_binary_files(tmp_path: Path) -> None:
    with pytest.raises(UnshutterError, match="cannot read"):
        Motion.load(tmp_path / "none.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UnshutterError, match="not a text file"):
        Motion.load(tmp_path / "b.json")
