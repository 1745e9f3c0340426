"""Speeds worked out from motions: known ones, and the same from every kind and reference row."""

import json
from pathlib import Path

import numpy as np
import pytest

from unshutter import Finding, Motion, RowMotion, UnshutterError, UsageError
from unshutter.cli import main
from unshutter.motion import RotationMotion
from unshutter.motion.verdict import Speed, json_with_speed


def test_a_steady_turn_and_shift() -> None:
    """3 degrees and 60 px in 30 ms are 100 deg/s and 2000 px/s."""
    motion = RowMotion.from_polynomials([0, 60], [0, np.radians(3)], 301, 400)
    speed = Speed.of(motion, 30)
    assert speed.angular_deg_s == pytest.approx(np.full(301, 100), abs=1e-6)
    assert speed.velocity_px_s[:, 0] == pytest.approx(np.full(301, 2000), abs=0.5)
    # Eq. 1 turns about a centre that t_x has carried off to the right: the middle goes up
    assert speed.velocity_px_s[:, 1] == pytest.approx(-np.radians(100) * motion.tx_px, abs=0.5)
    assert speed.summary()["angular_deg_s"]["mean"] == pytest.approx(100)
    assert speed.summary()["velocity_px_s"]["peak"] == pytest.approx(np.hypot(2000, 104.7), abs=0.5)


def test_the_sign_of_the_peak() -> None:
    motion = RowMotion.from_polynomials([0], [0, 0.01, -0.08], 200, 300)
    summary = Speed.of(motion, 20).summary()
    assert summary["angular_deg_s"]["peak"] == pytest.approx(np.degrees(0.01 - 0.16) / 0.02, rel=0.01)


@pytest.mark.parametrize("reference", ["middle", "last"])
def test_the_reference_row_does_not_matter(reference) -> None:
    motion = RowMotion.from_polynomials([0, 60, -90], [0, 0.02, 0.05], 300, 400)
    speed, other = Speed.of(motion, 25), Speed.of(motion.rereferenced(reference), 25)
    assert other.angular_deg_s == pytest.approx(speed.angular_deg_s, abs=1e-6)
    assert other.velocity_px_s == pytest.approx(speed.velocity_px_s, abs=1e-3)


def test_rows_that_curve() -> None:
    motion = RowMotion.from_polynomials([0, 60, -90], [0, 0.02, 0.05], 300, 400)
    speed, u = Speed.of(motion, 25), np.arange(300) / 299
    assert speed.velocity_px_s[1:-1, 0] == pytest.approx(((60 - 180 * u) / 0.025)[1:-1], abs=2)
    assert speed.angular_deg_s[1:-1] == pytest.approx((np.degrees(0.02 + 0.1 * u) / 0.025)[1:-1], abs=0.01)


@pytest.mark.parametrize("reference", ["first", "middle"])
def test_a_camera_that_turns(reference) -> None:
    """1, 2 and 3 degrees about x, y and z in 30 ms."""
    rotations = np.radians([[1, 2, 3]]) * np.linspace(0, 1, 300)[:, None]
    motion = RotationMotion(400, rotations=rotations, focal_px=500).rereferenced(reference)
    speed = Speed.of(motion, 30)
    assert speed.angular_deg_s == pytest.approx(np.full(300, 100), abs=0.01)
    expected = 500 * np.radians([2, -1]) / 0.03
    assert speed.velocity_px_s == pytest.approx(np.tile(expected, (300, 1)), abs=0.1)


def test_a_file_with_speed_is_still_a_motion_file() -> None:
    motion = RowMotion.from_polynomials([0, 60], [0, 0.05], 300, 400)
    text = json_with_speed(Finding(motion), 30)
    assert json.loads(text)["speed"]["readout_ms"] == 30
    assert np.array_equal(Motion.from_json(text).tx_px, motion.tx_px)


def test_the_command_prints_and_plots_it(
    tmp_path: Path, rolling_facade: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    from unshutter.photo import Photo

    photo, plain, wide = tmp_path / "street.png", tmp_path / "plain.png", tmp_path / "wide.png"
    Photo.from_array(rolling_facade).save(photo)
    assert main(["estimate", str(photo), "--json", "--plot", str(plain)]) == 0
    assert "speed" not in json.loads(capsys.readouterr().out)
    assert main(["estimate", str(photo), "--json", "--readout-ms", "30", "--plot", str(wide)]) == 0
    printed = capsys.readouterr().out
    assert json.loads(printed)["speed"] == Speed.of(Motion.from_json(printed), 30).summary()
    assert Photo.open(wide).width > 1.5 * Photo.open(plain).width
    saved = tmp_path / "m.json"
    assert main(["estimate", str(photo), "--readout-ms", "30", "-o", str(saved)]) == 0
    assert json.loads(saved.read_text()) == json.loads(printed)


@pytest.mark.parametrize("wrong", ["0", "nan"])
def test_a_time_that_is_none(tmp_path: Path, rolling_facade: np.ndarray, wrong: str, capsys) -> None:
    from unshutter.photo import Photo

    photo = tmp_path / "street.png"
    Photo.from_array(rolling_facade).save(photo)
    assert main(["estimate", str(photo), f"--readout-ms={wrong}"]) == 2
    assert "--readout-ms must be above 0" in capsys.readouterr().err


def test_too_few_rows() -> None:
    with pytest.raises(UsageError, match="must be above 0"):
        Speed.of(RowMotion.zero(5, 5), -1)
    with pytest.raises(UnshutterError, match="two rows"):
        Speed.of(RowMotion.zero(1, 5), 10)
