"""A camera whose roll and tilt are known: told by the user, or by a drone's gimbal."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.tagged_files import jpeg_of_drone
from unshutter import Motion
from unshutter.cli import main
from unshutter.errors import UsageError
from unshutter.photo import Photo


@pytest.fixture
def leaning() -> np.ndarray:
    """Poles before a camera that was turned clockwise by 4 degrees: all lean to the left."""
    picture = np.full((480, 480), 220, np.uint8)
    lean = math.tan(math.radians(4))
    for at in range(40, 460, 28):
        ends = [(round((at + lean * (row - 240)) * 16), row * 16) for row in (30, 450)]
        cv2.line(picture, *ends, 60, 5, cv2.LINE_AA, shift=4)
    return picture


@pytest.mark.parametrize("name", ["manhattan", "segment-manhattan"])
def test_a_known_roll_is_not_taken_for_motion(name: str, leaning: np.ndarray) -> None:
    known = unshutter.estimate(leaning, estimator=name, roll_deg=4, tilt_deg=0)
    assert np.abs(known.motion.tx_px).max() < 4
    upright = unshutter.estimate(leaning, estimator=name, roll_deg=0, tilt_deg=0)
    last = upright.motion.tx_px[-1]
    assert last == pytest.approx(480 * math.tan(math.radians(4)), rel=0.4)  # hands rarely move so fast
    again = unshutter.rectify(leaning, estimator=name, roll_deg=4, tilt_deg=0)
    assert np.abs(again.array.astype(int) - leaning).mean() < 6


def test_roll_and_tilt_from_the_command_line(
    tmp_path: Path, leaning: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, out = tmp_path / "p.png", tmp_path / "m.json"
    Photo.from_array(leaning).save(photo)
    told = ["--roll-deg", "4", "--tilt-deg", "0"]
    assert main(["estimate", str(photo), "--estimator", "manhattan", *told, "-o", str(out)]) == 0
    assert np.abs(Motion.load(out).tx_px).max() < 4
    assert main(["rectify", str(photo), "--estimator", "manhattan", *told, "-o", str(tmp_path / "r.png")]) == 0
    capsys.readouterr()
    assert main(["rectify", str(photo), "--motion", str(out), "--tilt-deg", "3"]) == 2
    assert "are for finding a motion: leave them out" in capsys.readouterr().err
    assert main(["estimate", str(photo), "--roll-deg", "60"]) == 2
    assert "--roll-deg must lie between -45 and 45" in capsys.readouterr().err
    with pytest.raises(UsageError, match="leave them out"):
        unshutter.rectify(leaning, motion=Motion.load(out), roll_deg=1.0)


def test_the_gimbals_roll_is_not_taken_for_motion(leaning: np.ndarray) -> None:
    told, untold = jpeg_of_drone(leaning, "+4.00", "0"), jpeg_of_drone(leaning, "0", "0")
    assert np.abs(unshutter.estimate(told, estimator="manhattan").motion.tx_px).max() < 4
    (moved, *_) = unshutter.candidates(untold, estimator="manhattan", moving="yes")
    assert np.abs(moved.motion.tx_px).max() > 15
