import json
from pathlib import Path

import pytest

from unshutter import Finding, Motion, RowMotion, ScanDirection, UnshutterError, __version__


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
