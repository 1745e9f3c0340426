"""Photos turned upright: the homography against a camera written down by its axes, and what is undone or refused."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.batches import make_photos, rectify
from support.shaken_scenes import shake
from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.grid import gs_to_rs_map, rs_to_gs_map
from unshutter.motion.upright import Angle, Pose
from unshutter.motion.verdict import judge
from unshutter.motion.warp import edge_decision, straighten, validity_mask
from unshutter.options import Camera, Rectify, Undo
from unshutter.orientation import Orientation, ScanDirection
from unshutter.page.sentences import verdict_json
from unshutter.photo import Photo
from unshutter.photo.attitude import Attitude
from unshutter.reasons import Cause, Code, Reason
from unshutter.run.report import about
from unshutter.single.estimator import View
from unshutter.single.methods import find_candidates
from unshutter.single.register import load

HEIGHT, WIDTH, FOCAL = 300, 400, 1.3
HELD = Pose(2.3, 6.0, FOCAL, roll_error_deg=0.4)


def seen(points, roll_deg, tilt_deg):
    """Columns and rows of points [N, 3] (right, down, ahead) for a camera turned clockwise and tilted up."""
    roll, tilt = np.radians([roll_deg, tilt_deg])
    ahead = np.array([0, -np.sin(tilt), np.cos(tilt)])
    flat, below = np.array([1.0, 0, 0]), np.array([0, np.cos(tilt), np.sin(tilt)])
    right, down = np.cos(roll) * flat + np.sin(roll) * below, np.cos(roll) * below - np.sin(roll) * flat
    col, row = (FOCAL * HEIGHT * (points @ axis) / (points @ ahead) for axis in (right, down))
    return col + (WIDTH - 1) / 2, row + (HEIGHT - 1) / 2


@pytest.mark.parametrize("tilt_deg", [-20.0, 0.0, 13.0])
@pytest.mark.parametrize("roll_deg", [-4.0, 7.0])
def test_verticals_come_out_vertical_and_level_lines_level(roll_deg: float, tilt_deg: float) -> None:
    pose = Pose(roll_deg, tilt_deg, FOCAL)
    along = np.linspace(-0.8, 0.8, 9)[:, None]
    for across in (-0.9, 0.1, 0.7):
        for vertical in (True, False):
            start, way = (
                (np.array([across, 0, 2.0]), [0, 1, 0]) if vertical else (np.array([0, across, 2.0]), [1, 0, 0])
            )
            line = seen(start + along * way, roll_deg, tilt_deg)
            col, row = pose.leaning(*line, HEIGHT, WIDTH, back=True)
            np.testing.assert_allclose(col if vertical else row, (col if vertical else row)[0], atol=1e-6)
            np.testing.assert_allclose(pose.leaning(col, row, HEIGHT, WIDTH), line, atol=1e-6)
    if tilt_deg == 0:
        middle = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
        np.testing.assert_allclose(pose.leaning(*middle, HEIGHT, WIDTH), middle)
        sides = pose.leaning(np.array([middle[0] - 0.5, middle[0] + 0.5]), np.full(2, middle[1]), HEIGHT, WIDTH)
        assert np.hypot(*np.diff(sides, axis=1)) == pytest.approx(1, abs=1e-5)  # as large as before


@pytest.mark.parametrize("tilt_deg", [-20.0, 3.0, 24.0])
@pytest.mark.parametrize("up", [(0, -1), (1, 0)])
def test_a_tower_keeps_its_crown_and_its_foot(tilt_deg: float, up: tuple[int, int]) -> None:
    """Where both ends of the photo's middle lie in the upright picture, and how much of the photo does."""
    pose = Pose(0.0, tilt_deg, FOCAL, up)
    last = np.array([WIDTH, HEIGHT]) - 1
    middle = last / 2
    ends = np.array([middle - middle * np.abs(up), middle + middle * np.abs(up)]).T
    there = np.array(pose.leaning(ends[0], ends[1], HEIGHT, WIDTH, back=True))
    assert (there >= -1).all() and (there <= last[:, None] + 1).all()
    if tilt_deg > 5:  # none of the picture is wasted above or below
        along = there[int(up == (0, -1))]
        np.testing.assert_allclose(np.sort(along), [0, last[int(up == (0, -1))]], atol=1)
    col, row = np.meshgrid(np.linspace(0, last[0], 41), np.linspace(0, last[1], 41))
    seen_col, seen_row = pose.leaning(col, row, HEIGHT, WIDTH, back=True)
    kept = (seen_col >= -1) & (seen_col <= WIDTH) & (seen_row >= -1) & (seen_row <= HEIGHT)
    assert kept.mean() > 0.97


def test_level_undoes_the_roll_alone() -> None:
    level = HELD.undone_for("level", None, None)
    assert isinstance(level, Pose)
    assert (level.roll_deg, level.tilt_deg) == (HELD.roll_deg, None)
    col, row = level.leaning(np.array([199.5, 299.5]), np.array([149.5, 149.5]), HEIGHT, WIDTH)
    # the camera is turned clockwise, so what is level rises to the right in the photo
    assert np.degrees(np.arctan2(row[0] - row[1], col[1] - col[0])) == pytest.approx(2.3)
    assert HELD.undone_for("full", None, Angle(6.0)) == HELD


@pytest.mark.parametrize(
    ("pose", "wish", "stated", "code"),
    [
        (replace(HELD, roll_deg=-8.1), "level", (False, True), Code.TOO_ASKEW),
        (replace(HELD, roll_deg=-8.1), "full", (True, False), None),
        (replace(HELD, tilt_deg=25.1), "full", (True, False), Code.TOO_STEEP),
        (replace(HELD, tilt_deg=-60.0), "full", (False, True), None),
        (replace(HELD, tilt_deg=90.0), "full", (True, True), Code.TOO_STEEP),
        (replace(HELD, tilt_deg=60.0), "level", (False, False), None),
        (replace(HELD, tilt_deg=None), "full", (False, False), Code.POSE_UNKNOWN),
        (replace(HELD, tilt_deg=None), "level", (False, False), None),
    ],
)
def test_what_is_too_much_is_left_unless_it_was_stated(pose: Pose, wish, stated, code: Code | None) -> None:
    undone = pose.undone_for(wish, *(Angle(0.0, each) for each in stated))
    assert (undone.code if isinstance(undone, Reason) else None) == code


@pytest.mark.parametrize("orientation", [1, 6, 8])
def test_a_turned_photo_is_made_upright_as_if_it_stood(orientation: int) -> None:
    view = View(Photo.from_array(np.zeros((HEIGHT, WIDTH, 3), np.uint8)))
    view = replace(view, photo=replace(view.photo, orientation=orientation))
    turned = replace(HELD, up=view.up)
    size = Orientation(orientation).size(HEIGHT, WIDTH)
    across, down = 0.8, 0.3
    col, row = (share * (side - 1) for share, side in zip((across, down), (WIDTH, HEIGHT), strict=True))
    there = turned.leaning(col, row, HEIGHT, WIDTH)
    shares = [at / (side - 1) for at, side in zip(there, (WIDTH, HEIGHT), strict=True)]
    upright = Orientation(orientation).upright_point(across, down)
    standing = replace(HELD, focal=FOCAL * HEIGHT / size[0])
    expected = standing.leaning(upright[0] * (size[1] - 1), upright[1] * (size[0] - 1), *size)
    found = Orientation(orientation).upright_point(*shares)
    np.testing.assert_allclose([found[0] * (size[1] - 1), found[1] * (size[0] - 1)], expected, atol=1e-6)


def test_motion_and_pose_are_undone_in_one_warp() -> None:
    motion, at = shake(HEIGHT, WIDTH), (np.array([60.0, 200, 333]), np.array([40.0, 150, 222]))
    there = gs_to_rs_map(motion, HELD)(*at)
    np.testing.assert_allclose(there, motion.gs_to_rs(*HELD.leaning(*at, HEIGHT, WIDTH)))
    np.testing.assert_allclose(rs_to_gs_map(motion, HELD)(*there), at, atol=1e-3)
    pixels = np.full((HEIGHT, WIDTH), 200, np.uint8)
    cropped, decision = straighten(pixels, motion, "crop", upright=HELD)
    assert (cropped == 200).all() and cropped.shape != pixels.shape
    assert edge_decision(motion, "crop", HELD).area_left == decision.area_left
    kept = straighten(pixels, RowMotion.zero(HEIGHT, WIDTH), "keep", upright=HELD)[0]
    outside = ~validity_mask(RowMotion.zero(HEIGHT, WIDTH), HELD)
    assert outside.sum() > 0 and (kept[cv2.erode(outside.astype(np.uint8), np.ones((5, 5))) > 0] == 0).all()


def test_the_pose_is_that_of_the_reference_row() -> None:
    found = Finding(RowMotion.from_polynomials([0, 20], [0, 0.1], HEIGHT, WIDTH), held=HELD)
    moved = found.rereferenced("last")
    at = np.array([50.0, 250]), np.array([80.0, 220])
    first, last = (rs_to_gs_map(each.motion, each.held)(*at) for each in (found, moved))
    angles = [np.arctan2(row[1] - row[0], col[1] - col[0]) for col, row in (first, last)]
    assert moved.held is not None and moved.held.roll_deg == pytest.approx(HELD.roll_deg - np.degrees(0.1))
    assert angles[0] == pytest.approx(angles[1], abs=0.01)  # both upright; turned about another point
    assert Finding.from_json(moved.to_json()) == moved


@pytest.mark.parametrize(
    "wrong", ['"roll_deg": 1e400', '"focal": 0', '"up": [1, 1]', '"up": 3', '"focal": "x"', '"a": 1']
)
def test_a_wrong_pose_in_a_motion_file_is_one_line(wrong: str) -> None:
    text = Finding(RowMotion.zero(4, 4), held=Pose(0.0, None, 1.0)).to_json()
    with pytest.raises(UnshutterError):
        Finding.from_json(text.replace('"held": {', f'"held": {{{wrong}, ').replace('"roll_deg": 0.0, ', "", 1))


def posed(found: Finding, **more) -> Finding:
    return replace(found, held=HELD, held_at_rest=replace(HELD, roll_deg=-1.4), **more)


STILL = Finding(RowMotion.zero(HEIGHT, WIDTH), reason=Reason(Code.NO_VISIBLE_MOTION), confidence=0.93)
MOVED = Finding(RowMotion.from_polynomials([0, 20], [0], HEIGHT, WIDTH), confidence=0.97)


@pytest.mark.parametrize(
    ("found", "wish", "words"),
    [
        (posed(STILL), "level", "levelled by 1.4 degrees; no visible motion"),
        (posed(MOVED), "level", "levelled by 2.3 degrees; points moved by up to 20 px, confidence 0.97: sure"),
        (
            posed(MOVED),
            "full",
            "made upright: turned by 2.3 degrees, tilted by 6.0; points moved by up to 20 px, confidence 0.97: sure",
        ),
    ],
)
def test_a_photo_that_is_turned_is_changed(found: Finding, wish, words: str) -> None:
    verdict = judge(found, Undo(upright=wish))
    assert verdict.described() == words
    assert verdict.changes and verdict.as_json()["changed"] and verdict.cause is None
    assert verdict.motion.is_zero == found.motion.is_zero
    assert not judge(found, Undo()).upright


@pytest.mark.parametrize(("stated", "levelled"), [({"tilt_deg": 0}, False), ({"roll_deg": 15, "tilt_deg": 0}, True)])
def test_a_measured_roll_is_not_taken_for_a_stated_one(stated: dict, levelled: bool, monkeypatch) -> None:
    """A measured roll of 15 degrees is meant, or a mistake: only a stated one is undone."""
    photo = Photo.from_array(np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    monkeypatch.setattr(Photo, "attitude", Attitude(15.0, 0.0, "accelerometer (Acme)", ScanDirection.TOP_TO_BOTTOM))
    view = View(photo, Camera(**stated))
    verdict = judge(view.noted(view.no_motion("me", Reason(Code.NO_VISIBLE_MOTION))), Undo(upright="level"))
    assert verdict.changes == levelled
    assert (verdict.not_upright is None) == levelled
    assert levelled or verdict.not_upright.code is Code.TOO_ASKEW


def test_what_is_upright_already_or_unknown_is_left_byte_for_byte() -> None:
    upright = replace(STILL, held_at_rest=Pose(0.05, 0.0, FOCAL, roll_error_deg=0.3))
    verdict = judge(upright, Undo(upright="full"))
    assert not verdict.changes and verdict.cause is Cause.NO_MOTION
    verdict = judge(STILL, Undo(upright="level"))
    assert not verdict.changes
    assert verdict.described().startswith("the photo does not show how the camera was held; no visible motion")
    assert verdict.as_json()["not_upright"]["code"] == "pose-unknown"


def test_a_photo_that_leans_says_what_levels_it() -> None:
    unsure = posed(replace(STILL, reason=Reason.of(Code.UNSURE_WHETHER_MOVED, confidence=0.7)))
    for found in (unsure, posed(STILL), replace(unsure, roll=Angle(1.4))):
        assert "off level by 1.4 degrees, give or take 0.4" in about(judge(found, Undo()))
        assert "off level" not in about(judge(found, Undo(upright="level")))
        offered = verdict_json(judge(found, Undo()))
        assert offered["advice"][0] == "adviceLevel"
        assert (offered["lean_deg"], offered["lean_error_deg"]) == (1.4, 0.4)
    for other in (
        posed(MOVED),
        posed(replace(STILL, reason=Reason(Code.WHICH_WAY))),  # it moved, so it was not held like that
        replace(unsure, roll=Angle(1.4, stated=True)),
        replace(unsure, held_at_rest=replace(HELD, roll_deg=0.9)),
        replace(unsure, held_at_rest=replace(HELD, roll_error_deg=1.1)),
        replace(unsure, held_at_rest=replace(HELD, roll_error_deg=None)),
        replace(unsure, held_at_rest=replace(HELD, roll_deg=9.0)),  # which is not undone unless it is stated
    ):
        assert "off level" not in about(judge(other, Undo()))
        assert "adviceLevel" not in verdict_json(judge(other, Undo())).get("advice", ())


def test_the_page_and_the_command_line_round_alike() -> None:
    found = posed(STILL, roll=None)
    found = replace(found, held_at_rest=replace(HELD, roll_deg=-1.2468))
    assert "off level by 1.2 degrees" in about(judge(found, Undo()))
    assert verdict_json(judge(found, Undo()))["lean_deg"] == 1.2
    levelled = judge(found, Undo(upright="level"))
    assert levelled.described().startswith("levelled by 1.2 degrees")
    assert verdict_json(levelled)["upright"]["roll_deg"] == -1.2


def test_what_shows_its_roll_badly_is_not_levelled() -> None:
    found = replace(posed(STILL), held_at_rest=replace(HELD, roll_error_deg=None))
    assert judge(found, Undo(upright="level")).as_json()["not_upright"]["code"] == "pose-unknown"
    assert judge(replace(found, roll=Angle(2.3)), Undo(upright="level")).changes  # measured by the camera


@pytest.mark.parametrize("moves", [False, True])
def test_a_facade_taken_askew_ends_level(facade: np.ndarray, rolling_facade: np.ndarray, moves: bool) -> None:
    straight = rolling_facade if moves else facade
    height, width = facade.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), 3.0, 1)  # the camera, clockwise
    askew = straight if moves else cv2.warpAffine(straight, matrix, (width, height), borderMode=cv2.BORDER_REFLECT)
    result = unshutter.rectify(askew, upright="level", edges="keep", min_confidence=0 if moves else 1)
    turned = 0.0 if result.verdict.upright is None else result.verdict.upright.roll_deg
    assert turned == pytest.approx(0 if moves else 3, abs=2.0 if moves else 0.7)
    assert result.changed and result.motion.is_zero != moves
    again = unshutter.rectify(result.array, upright="level", min_confidence=1)
    assert again.verdict.upright is None or abs(again.verdict.upright.roll_deg) < 0.7


def test_a_measured_attitude_is_used_where_no_lines_are() -> None:
    plain = Photo.from_array(np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    found = unshutter.rectify(plain, roll_deg=12, tilt_deg=-30, upright="full", edges="keep")
    assert found.verdict.upright == Pose(12, -30, found.verdict.upright.focal if found.verdict.upright else 0)
    assert View(plain, Camera(roll_deg=12)).noted(STILL).held_at_rest is not None


@pytest.mark.parametrize(
    "words",
    [["--masks", "masks"], ["--save-motion", "m"], ["--motion", "m.json"], ["--sequence"], ["--upright", "upside"]],
)
def test_what_keeps_coordinates_refuses_it(words: list[str], tmp_path: Path, capsys, monkeypatch) -> None:
    make_photos(tmp_path, ["a.jpg", "b.jpg"])
    MOVED.save(tmp_path / "m.json")
    monkeypatch.chdir(tmp_path)
    assert rectify("a.jpg", "b.jpg", "-o", "out", "--upright", "level", *words) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_python_refuses_it_with_a_motion_too() -> None:
    with pytest.raises(UsageError, match="upright"):
        unshutter.rectify(np.zeros((HEIGHT, WIDTH), np.uint8), motion=MOVED, upright="level")
    with pytest.raises(UsageError, match="upright"):
        Rectify(undo=Undo(upright="level"), motion=Path("m.json")).settled()


def test_a_photo_that_only_its_motion_makes_upright_shows_how_it_was_held() -> None:
    """The sample leans so much that its lines are not those of buildings before its motion is undone."""
    demo = Path(__file__).parents[2] / "examples" / "demo.jpg"
    first = find_candidates(load(), View(Photo.open(demo)))[0].finding
    assert first.held is not None and abs(first.held.roll_deg) < 2
    assert first.held_at_rest is None
