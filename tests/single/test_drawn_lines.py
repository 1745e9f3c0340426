"""Lines that a person draws: what they say about the motion, and their files."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.line_scenes import lines_as_text
from unshutter import DrawnLine, Motion, RowMotion, UnshutterError, UsageError
from unshutter.cli import main
from unshutter.photo import Photo
from unshutter.reasons import MotionSource
from unshutter.single.drawn_lines import (
    MET_DEG,
    DrawnLikelihood,
    Trouble,
    lines_from_json,
    motion_from_lines,
)
from unshutter.single.estimator import View

HEIGHT, WIDTH = 300, 400


def _grey(height: int = HEIGHT, width: int = WIDTH) -> Photo:
    return Photo.from_array(np.full((height, width), 128, np.uint8))


def _seen(motion: RowMotion, kind: str, ends: list[tuple[float, float]], points: int = 2) -> DrawnLine:
    """A line between two places of the global-shutter picture, as it is drawn in the distorted one."""
    col, row = (np.linspace(a, b, points) for a, b in zip(*ends, strict=True))
    return DrawnLine(kind, tuple(zip(*motion.gs_to_rs(col, row), strict=True)))  # pyright: ignore[reportArgumentType]


def _motion(lean: float, bend: float = 0.0) -> RowMotion:
    return RowMotion.from_polynomials([0, lean * HEIGHT, bend * HEIGHT], [0], HEIGHT, WIDTH)


def _largest_difference(one: Motion, other: Motion) -> float:
    col, row = np.meshgrid(np.linspace(0, WIDTH - 1, 20), np.linspace(0, HEIGHT - 1, 20))
    apart = np.stack(one.gs_to_rs(col, row)) - np.stack(other.gs_to_rs(col, row))
    return float(np.abs(apart).max())


@pytest.mark.parametrize("lean", [-0.08, 0.08])
def test_two_upright_lines_and_a_level_one_straighten_a_lean(lean: float) -> None:
    """In a photo without a single segment, from the lines alone."""
    truth = _motion(lean)
    uprights = [_seen(truth, "upright", [(x, 30), (x, 270)]) for x in (100, 300)]
    level = _seen(truth, "level", [(60, 150), (340, 150)])
    found = motion_from_lines(View(_grey()), [*uprights, level]).finding
    assert found.confidence is None and found.reason is None and found.source is MotionSource.HAND
    assert _largest_difference(found.motion, truth) < 0.02 * HEIGHT < _largest_difference(_motion(0), truth)


def test_a_bent_edge_shows_the_bend() -> None:
    truth = _motion(-0.15, 0.15)  # out and back again: its ends are not moved
    bent = [_seen(truth, "straight", [(x, 5), (x, 295)], 9) for x in (120, 290)]
    uprights = [_seen(truth, "upright", [(x, 0), (x, HEIGHT - 1)]) for x in (120, 290)]
    levels = [_seen(truth, "level", [(60, y), (340, y)]) for y in (40, 150, 260)]  # nothing turned
    without = motion_from_lines(View(_grey()), [*uprights, *levels]).finding.motion
    found = motion_from_lines(View(_grey()), [*uprights, *levels, *bent]).finding.motion
    col, row = found.rs_to_gs(*np.array(bent[0].points).T)
    assert abs(col[4] - (col[0] + (row[4] - row[0]) / (row[-1] - row[0]) * (col[-1] - col[0]))) < 0.5
    assert _largest_difference(found, truth) < _largest_difference(without, truth) / 2


def _leans(motion: Motion, lines: list[DrawnLine]) -> list[float]:
    """Angles between lines in the result and the vertical [degrees]."""
    ends = [motion.rs_to_gs(*np.array(line.points).T) for line in lines]
    return [math.degrees(math.atan2(col[-1] - col[0], row[-1] - row[0])) for col, row in ends]


def test_sloppy_lines_leave_no_lean() -> None:
    """Two hasty lines, 1.4 degrees apart, along a door and a wall that lean by 7: the camera is not taken for askew."""
    points = [((106.4, 107.6), (91.0, 218.0)), ((160.8, 113.0), (148.8, 218.0))]
    lines = [DrawnLine("upright", each) for each in points]
    found = motion_from_lines(View(_grey(256, 256)), lines)
    assert found.troubles == (None, None)
    assert max(map(abs, _leans(found.finding.motion, lines))) < 1.4
    one = motion_from_lines(View(_grey(256, 256)), lines[:1])
    assert abs(_leans(one.finding.motion, lines[:1])[0]) <= MET_DEG


def test_uprights_that_converge_meet_above_the_middle() -> None:
    """As a tilted camera sees them: half of what they differ by is left in each, and no motion is found."""
    uprights = [DrawnLine("upright", ((x, 270.0), (x + (199.5 - x) / 15, 30.0))) for x in (80.0, 319.0)]
    found = motion_from_lines(View(_grey()), uprights)
    assert found.troubles == (None, None)
    assert _largest_difference(found.finding.motion, _motion(0)) < 0.02 * HEIGHT


def test_lines_that_cannot_be_met_are_named() -> None:
    """A level line along something upright counts for nothing; one of three uprights that disagrees is left out."""
    truth = _motion(0.08)
    uprights = [_seen(truth, "upright", [(x, 30), (x, 270)]) for x in (60, 200, 340)]
    across = DrawnLine("level", uprights[0].points)
    found = motion_from_lines(View(_grey()), [*uprights, across])
    assert found.troubles == (None, None, None, Trouble.SIDEWAYS)
    assert found.finding == motion_from_lines(View(_grey()), uprights).finding
    receding = DrawnLine("level", ((60, 80), (340, 140)))  # 12 degrees: no camera turns like that
    found = motion_from_lines(View(_grey()), [*uprights, receding])
    assert found.troubles == (None, None, None, Trouble.CONTRADICTS)
    assert motion_from_lines(View(_grey()), [receding]).troubles == (Trouble.CONTRADICTS,)
    wrong = DrawnLine("upright", ((200, 30), (250, 270)))
    found = motion_from_lines(View(_grey()), [*uprights, wrong])
    assert found.troubles == (None, None, None, Trouble.CONTRADICTS)


def test_derivatives() -> None:
    """The gradient of the energy of all kinds of lines, compared with differences."""
    rng = np.random.default_rng(1)
    lines = [
        DrawnLine("upright", ((100, 20), (110, 150), (118, 280))),
        DrawnLine("level", ((50, 100), (350, 112))),
        DrawnLine("straight", ((300, 20), (312, 150), (300, 280))),
    ]
    likelihood = DrawnLikelihood(View(_grey()), np.zeros((0, 4)), (HEIGHT, WIDTH), lines)
    at = np.concatenate([rng.normal(0, 0.02, 6), [0.01, 0.1, 0.5, 0.7]])[None]
    _, gradient, _ = likelihood.expanded(at)
    for k, step in enumerate(1e-6 * np.eye(10)):
        difference = (likelihood.energy(at + step) - likelihood.energy(at - step)) / 2e-6
        assert gradient[0, k] == pytest.approx(difference[0], rel=1e-3, abs=1e-2), k


def test_turned_photos_take_positions_of_their_stored_pixels() -> None:
    truth = _motion(0.08)
    lines = [_seen(truth, "upright", [(x, 30), (x, 270)]) for x in (100, 300)]
    upside_down = [
        DrawnLine(line.kind, tuple((WIDTH - 1 - col, HEIGHT - 1 - row) for col, row in line.points)) for line in lines
    ]
    one = unshutter.estimate(_grey(), lines=lines)
    other = unshutter.estimate(_grey(), lines=upside_down, readout="bottom-to-top")
    assert other.motion.tx_px == pytest.approx(one.motion.tx_px, abs=1.0)


def test_files(tmp_path: Path) -> None:
    lines = (DrawnLine("upright", ((1.5, 2.0), (3.0, 40.0))), DrawnLine("straight", ((0, 0), (5, 20), (0, 40))))
    assert lines_from_json(lines_as_text(lines)) == lines
    file = tmp_path / "lines.json"
    file.write_text(lines_as_text(lines))
    found = unshutter.estimate(_grey(), lines=file)
    assert found.estimator == "drawn-lines" and found.motion.height == HEIGHT


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no JSON", "not a file of drawn lines"),
        ("[]", "not a file of drawn lines"),
        (json.dumps({"format": "unshutter-lines/2", "lines": []}), "not a file of drawn lines"),
        (json.dumps({"format": "unshutter-lines/1", "lines": [{"kind": "upright"}]}), "not a file of drawn lines"),
        (json.dumps({"format": "unshutter-lines/1", "lines": []}), "at least one line"),
        (
            json.dumps({"format": "unshutter-lines/1", "lines": [{"kind": "a", "points": [[0, 0], [1, 1]]}]}),
            "unknown kind",
        ),
        (
            json.dumps({"format": "unshutter-lines/1", "lines": [{"kind": "level", "points": [[0, 0]]}]}),
            "2 to 100 points",
        ),
    ],
)
def test_files_that_are_none(text: str, message: str) -> None:
    with pytest.raises(UnshutterError, match=message):
        lines_from_json(text)


def test_lines_that_cannot_be() -> None:
    with pytest.raises(UsageError, match="3 to 100 points"):
        DrawnLine("straight", ((0, 0), (1, 1)))
    with pytest.raises(UsageError, match="positions in the photo"):
        DrawnLine("upright", ((0, 0), (1, math.nan)))


def _estimate(*arguments: object) -> int:
    return main(["estimate", *map(str, arguments)])


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    _grey().save(tmp_path / "grey.png")
    lines = [DrawnLine("upright", ((x, 30), (x + 20, 270))) for x in (100, 300)]
    (tmp_path / "lines.json").write_text(lines_as_text([*lines, DrawnLine("level", ((60, 150), (340, 150)))]))
    assert _estimate(tmp_path / "grey.png", "--json", "--lines", tmp_path / "lines.json") == 0
    motion = Motion.from_json(capsys.readouterr().out)
    assert motion.tx_px[-1] == pytest.approx(25, abs=4)
    (tmp_path / "lines.json").write_text("{}")
    assert _estimate(tmp_path / "grey.png", "--lines", tmp_path / "lines.json") == 1
    assert "not a file of drawn lines" in capsys.readouterr().err
    many = _estimate(tmp_path, "-o", tmp_path / "out", "--lines", tmp_path / "lines.json")
    assert many == 2 and "is for one photo only" in capsys.readouterr().err
