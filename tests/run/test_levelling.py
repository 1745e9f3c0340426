"""Photos of cameras that were held askew: by how much is known where photos show it, and hints work as typed."""

import json
import shlex
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest

from support.batches import rectify
from support.covering import thorough
from unshutter.cli import main
from unshutter.motion.verdict import Verdict, judge
from unshutter.options import Find, Undo
from unshutter.page.sentences import verdict_json
from unshutter.photo import Photo
from unshutter.rectification.find import find


def turned(pixels: np.ndarray, roll_deg: float) -> np.ndarray:
    """What a camera turned clockwise sees."""
    height, width = pixels.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), roll_deg, 1.15)  # no corner is empty
    return cv2.warpAffine(pixels, matrix, (width, height), flags=cv2.INTER_CUBIC)


def verdict_of(pixels: np.ndarray) -> Verdict:
    return judge(find(Photo.from_array(pixels), Find()), Undo())


@pytest.mark.parametrize("roll_deg", [-5.0, -2.0, 0.0, 1.6, 3.0, 6.0])
def test_a_roll_is_offered_with_its_error(facade: np.ndarray, roll_deg: float) -> None:
    verdict = verdict_of(turned(facade, roll_deg))
    if roll_deg == 0:
        assert verdict.lean is None
        return
    assert verdict.lean is not None and verdict.lean.error_deg is not None
    assert 0.3 <= verdict.lean.error_deg < 1
    assert abs(verdict.lean.deg - abs(roll_deg)) < 2 * verdict.lean.error_deg


def plaque(turn_deg: float, up_deg: float, slant_px: int = 0) -> np.ndarray:
    """An inscribed plaque on a bare wall, seen from the side by a camera that is held level; letters may slant."""
    flat = np.full((600, 600), 200, np.uint8)
    cv2.rectangle(flat, (150, 180), (450, 420), 90, -1)
    for row in range(200, 410, 22):
        for col in range(170, 425, 16):
            letter = [(col + slant_px, row), (col + 9, row), (col + 9 - slant_px, row + 11), (col, row + 11)]
            cv2.fillPoly(flat, [np.array(letter, np.int32)], (210,))
    sideways, upwards = np.radians([turn_deg, up_deg])
    about_y = np.array([[np.cos(sideways), 0, np.sin(sideways)], [0, 1, 0], [-np.sin(sideways), 0, np.cos(sideways)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(upwards), np.sin(upwards)], [0, -np.sin(upwards), np.cos(upwards)]])
    seen = about_x @ about_y
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) @ seen.T + [0, 0, 2.6]
    there = (600 * corners[:, :2] / corners[:, 2:] + 300).astype(np.float32)
    matrix = cv2.getPerspectiveTransform(np.array([[0, 0], [600, 0], [600, 600], [0, 600]], np.float32), there)
    return cv2.warpPerspective(flat, matrix, (600, 600), flags=cv2.INTER_LINEAR, borderValue=(200,))[60:540]


def test_a_plaque_from_the_side_is_not_off_level() -> None:
    """Every other one lies on its side."""
    most = [0.0, 0.0]
    for k, seen in enumerate(product((0, 4), (-40, 15, 45), (-12, 0, 12))):
        picture = plaque(turn_deg=seen[1], up_deg=seen[2], slant_px=seen[0])
        verdict = verdict_of(np.rot90(picture).copy() if k % 2 else picture)
        assert verdict.lean is None, (seen, verdict.lean)
        pose = verdict.finding.held_at_rest
        if pose is not None and not verdict.undoes:
            most[k % 2] = max(most[k % 2], abs(pose.roll_deg))
    assert min(most) > 2  # slanted letters are the likeliest verticals: the likeliest roll alone would be offered


@pytest.fixture
def holiday(facade: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one photo that is level and two that are not."""
    folder = tmp_path / "my holiday"
    folder.mkdir()
    for name, roll_deg in {"level.png": 0, "left.png": -3, "right.png": 2}.items():
        Photo.from_array(turned(facade, roll_deg)).save(folder / name)
    monkeypatch.chdir(tmp_path)
    return folder


def as_typed(line: str) -> int:
    """Runs the command that ends a line."""
    return main(shlex.split(line[line.index("unshutter rectify ") :])[1:])


def said(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return "".join(capsys.readouterr()).splitlines()


@pytest.mark.parametrize(
    "into", [(), thorough(("-o", "out")), ("-o", "out", "--edges", "keep"), thorough(("-o", "out", "--overwrite"))]
)
def test_a_folder_ends_in_a_command_that_levels_it(holiday: Path, into, capsys) -> None:
    assert rectify("my holiday", *into) == 0
    (line,) = (line for line in said(capsys) if "off level" in line)
    words = shlex.join(["my holiday", *into])
    assert line.startswith("unshutter: 2 are off level by 1 degree or more: unshutter rectify 'my holiday' ")
    assert sorted(shlex.split(line)[-len(shlex.split(words)) - 2 :]) == sorted(
        [*shlex.split(words), "--upright", "level"]
    )
    assert as_typed(line) == 0
    lines = said(capsys)
    assert sum("levelled by" in each for each in lines) >= 2
    assert not any("off level" in each for each in lines)


@pytest.mark.parametrize("into", [(), ("-o", "new.png"), ("-o", "out/"), thorough(("-o", "new.jpg"))])
def test_a_photo_ends_in_a_command_that_levels_it(holiday: Path, into, capsys) -> None:
    assert rectify("my holiday/left.png", *into) == 0
    (line,) = (line for line in said(capsys) if "off level" in line)
    assert ("--overwrite" in line) == (into[-1:] in (("new.png",), ("new.jpg",)))
    assert as_typed(line) == 0
    stated = verdict_json(verdict_of(Photo.open(holiday / "left.png").pixels))
    assert f"off level by {stated['lean_deg']:.1f} degrees, give or take {stated['lean_error_deg']:.1f}" in line
    assert f"levelled by {stated['lean_deg']:.1f} degrees" in said(capsys)[0]


@pytest.mark.parametrize("words", [["--save-motion", "m"], ["--masks", "masks", "-o", "out"]])
def test_what_keeps_coordinates_is_not_told_to_level(holiday: Path, words: list[str], capsys) -> None:
    assert rectify("my holiday", *words) == 0
    assert not any("--upright" in line for line in said(capsys))


def test_the_log_says_by_how_much(holiday: Path) -> None:
    assert rectify("my holiday", "-o", "out", "--json-log", "log.jsonl") == 0
    entries = [json.loads(line) for line in Path("log.jsonl").read_text().splitlines()]
    offered = {Path(each["photo"]).name: each.get("lean_deg") for each in entries if "photo" in each}
    assert offered["level.png"] is None
    assert offered["left.png"] == pytest.approx(3, abs=0.8) and offered["right.png"] == pytest.approx(2, abs=0.8)


def test_a_dry_run_says_which_photos_cannot_have_moved(holiday: Path, capsys) -> None:
    from PIL import Image

    tags = Image.Exif()
    tags[0x010F], tags[0x0110] = "Canon", "Canon PowerShot A70"
    Image.open(holiday / "level.png").save(holiday / "leaf.jpg", exif=tags)
    assert rectify("my holiday", "-o", "out", "--dry-run") == 0
    lines = said(capsys)
    (leaf,) = (line for line in lines if "leaf.jpg ->" in line)
    assert leaf.endswith("(no motion: its camera exposes all rows at once)")
    assert sum("exposes" in line for line in lines) == 1
    assert "unshutter: 1 of them by cameras that expose all rows at once: these have no motion to undo" in lines
    assert "unshutter: others are left unchanged if their pixels do not show clearly that the camera moved" in lines
