"""No result of any default has a pixel that the photo, or its neighbours, did not have.

Photos are painted with their own coordinates: each pixel of a result tells where in the photo it was taken from. By the
exact geometry, that must be where the scene was seen, and in the photo; a mirrored or black pixel is somewhere else.
"""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.batches import rectify
from support.covering import covering
from support.frame_pairs import HEIGHT, WIDTH, Scene
from support.hand_held import clip, pan
from support.looking_back import backward_map
from support.shaken_scenes import shake
from unshutter.motion import Motion, RotationMotion, RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.grid import gs_to_rs_map
from unshutter.motion.upright import Pose
from unshutter.motion.verdict import Verdict
from unshutter.motion.warp import straighten, validity_mask
from unshutter.page import photo_jobs
from unshutter.page.opened import OpenFile
from unshutter.page.settings import PhotoOptions
from unshutter.photo import Photo
from unshutter.rectification.rectified import Result, render

EXAMPLES = Path(__file__).parents[1] / "examples"
SIZES = [(480, 640), (640, 480), (301, 450)]
_STEP, _FIRST, _BLACK = 64, 4000, 1000  # per pixel, at the first one, and what no pixel has
_SLACK_PX = 1.05  # at an edge, the last pixel is repeated for less than a pixel


def painted(height: int, width: int) -> np.ndarray:
    """A photo [H, W, 3] uint16 of its own columns and rows."""
    row, col = np.mgrid[:height, :width]
    return np.stack([col * _STEP + _FIRST, row * _STEP + _FIRST, col * 0 + _FIRST], axis=-1).astype(np.uint16)


def drawn_motions(height: int, width: int) -> list[Motion]:
    """Motions from slight to violent; the last ones leave less than 60 % of the photo."""
    rng = np.random.default_rng(height)
    polynomials = [shake(height, width, share) for share in (0.05, 0.3, 1.0, 2.5, -6.0)]
    sideways = [RowMotion.from_polynomials([0, share * width], [0], height, width) for share in (0.003, 0.2, -0.45)]
    u = np.linspace(0, 1, height)[:, None]
    turns = [speed * u + 0.5 * change * u**2 for speed, change in rng.normal(0, 0.06, (4, 2, 3))]
    return [*polynomials, *sideways, *(RotationMotion(width, turn, 1.2 * width) for turn in turns)]


def check(pixels: np.ndarray, col: np.ndarray, row: np.ndarray) -> None:
    """Compares a result of a painted photo with where the exact map [H, W] looks, wherever it was cropped."""
    height, width = col.shape
    found = [(pixels[..., band].astype(float) - _FIRST) / _STEP for band in (0, 1)]
    assert (pixels[..., 2] > _BLACK).all()  # nothing is black
    middle = tuple(side // 2 for side in pixels.shape[:2])
    at = np.unravel_index(np.hypot(col - found[0][middle], row - found[1][middle]).argmin(), col.shape)
    top, left = (int(a) - b for a, b in zip(at, middle, strict=True))
    window = np.s_[top : top + pixels.shape[0], left : left + pixels.shape[1]]
    assert min(top, left) >= 0 and col[window].shape == pixels.shape[:2]
    for told, exact, last in zip(found, (col[window], row[window]), (width - 1, height - 1), strict=True):
        assert exact.min() >= -_SLACK_PX and exact.max() <= last + _SLACK_PX
        assert np.abs(told - exact.clip(0, last)).max() < 0.3


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_in_python(height: int, width: int) -> None:
    for motion in drawn_motions(height, width):
        result = unshutter.rectify(painted(height, width), motion=motion)
        check(result.array, *backward_map(motion))
        whole = result.array.shape[0] * result.array.shape[1] / (height * width)
        assert result.needs_a_look == (whole < 0.6) and result.area_left == pytest.approx(whole)


@pytest.mark.parametrize("pose", [Pose(2.0, None, 1.2), Pose(-3.0, 18.0, 1.2), Pose(1.0, -25.0, 0.8, up=(1, 0))])
def test_of_photos_turned_upright(pose: Pose) -> None:
    for motion in (RowMotion.zero(*SIZES[0]), shake(*SIZES[0])):
        verdict = Verdict(Finding(motion), motion.largest_px, upright=pose)
        result = render(Photo.from_array(painted(*SIZES[0])), verdict)
        row, col = np.mgrid[: SIZES[0][0], : SIZES[0][1]].astype(float)
        check(result.pixels, *gs_to_rs_map(motion, pose)(col, row))


def test_what_is_checked_can_fail() -> None:
    motion = shake(*SIZES[0])
    for edges in ("fill", "keep"):
        with pytest.raises(AssertionError):
            check(straighten(painted(*SIZES[0]), motion, edges)[0], *backward_map(motion))


def test_on_the_command_line_in_folders_and_on_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One photo and a folder, from the command line; saved from the page, and seen there in the frame of the crop."""
    motion = shake(*SIZES[0], 2.0)
    given, photo = tmp_path / "motion.json", tmp_path / "photos" / "a.png"
    photo.parent.mkdir()
    motion.save(given)
    for path in (photo, photo.with_name("b.png")):
        Photo.from_array(painted(*SIZES[0])).save(path)
    assert rectify(photo, "-o", tmp_path / "one.png", "--motion", given) == 0
    assert rectify(photo.parent, "-o", tmp_path / "out", "--motion", given) == 0
    monkeypatch.setattr(photo_jobs, "_find_motion", lambda *_: Finding(motion))
    opened = OpenFile("a", "photo", "a.png", photo, 10**9)
    photo_jobs.save(opened, tmp_path / "saved.png", None, PhotoOptions())
    results = [tmp_path / "one.png", tmp_path / "saved.png", *(tmp_path / "out").glob("*.png")]
    assert len(results) == 4
    for path in results:
        check(Photo.open(path).pixels, *backward_map(motion))
    _, shown = photo_jobs.after(opened, PhotoOptions(), None)
    left, top, right, bottom = np.array(shown["crop"]) * [*SIZES[0][::-1], *SIZES[0][::-1]]
    saved = Photo.open(results[0])
    assert (right - left, bottom - top) == pytest.approx((saved.width, saved.height)) and shown["edges"] == "crop"
    col, row = backward_map(motion)
    told = (saved.pixels[0, 0, :2].astype(float) - _FIRST) / _STEP
    assert told == pytest.approx((col[round(top), round(left)], row[round(top), round(left)]), abs=0.3)


@pytest.mark.parametrize(("size", "longest"), covering(SIZES, [None, 570, 320, 97]))
def test_small_copies_on_the_page_have_nothing_black_in_the_crop_or_next_to_it(
    size: tuple[int, int], longest: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The crop cuts through their pixels, and a browser that enlarges them reads one beyond."""
    (height, width), path = size, tmp_path / "grey.png"
    Photo.from_array(np.full((height, width, 3), 128, np.uint8)).save(path)
    for number, motion in enumerate(drawn_motions(height, width)):
        monkeypatch.setattr(photo_jobs, "_find_motion", lambda *_, motion=motion: Finding(motion))
        opened = OpenFile(str(number), "photo", "grey.png", path, 10**9)
        jpeg, shown = photo_jobs.after(opened, PhotoOptions(), longest)
        pixels = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        if shown["crop"] is None:
            continue
        across, down = (np.array(shown["crop"]).reshape(2, 2) * pixels.shape[::-1]).T
        left, top = (max(math.floor(each[0] + 1e-6) - 1, 0) for each in (across, down))
        right, bottom = (math.ceil(each[1] - 1e-6) + 1 for each in (across, down))
        assert pixels[top:bottom, left:right].min() > 100


def test_sets_keep_their_coordinates_and_are_empty_where_nothing_was_seen(tmp_path: Path) -> None:
    motion, given, photo = shake(*SIZES[0]), tmp_path / "motion.json", tmp_path / "a.png"
    motion.save(given)
    Photo.from_array(painted(*SIZES[0])).save(photo)
    out, masks = tmp_path / "out", tmp_path / "masks"
    for words in (["--masks", masks], ["--save-motion", tmp_path / "motions"], ["--keep-names"]):
        assert rectify(photo, "-o", f"{out}/", "--motion", given, "--overwrite", *words) == 0
        (made,) = out.glob("*.png")
        pixels = Photo.open(made).pixels
        made.unlink()
        seen = validity_mask(motion)
        assert pixels.shape[:2] == SIZES[0] and (pixels[seen] > _BLACK).all()
        beyond = cv2.dilate(seen.astype(np.uint8), np.ones((7, 7))) == 0
        assert beyond.any() and not pixels[beyond].any()
    (mask,) = masks.glob("*.png")
    np.testing.assert_array_equal(Photo.open(mask).pixels[..., 0] > 0, validity_mask(motion))


# ---- with neighbours ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("before", "after"), [(True, True), (True, False), (False, True)])
def test_what_a_frame_did_not_see_is_borrowed(tmp_path: Path, before: bool, after: bool) -> None:
    """By flow: a wall that moves, with the exact picture; what is mirrored there is off by far more."""
    scene = Scene(speed=(20, 3))
    paths = [tmp_path / f"{number}.png" for number in range(3)]
    for number, path in enumerate(paths):
        Photo.from_array(scene.frame(number, 0.8)).save(path)
    words = ["--before", paths[0]] * before + ["--after", paths[2]] * after
    out = tmp_path / "out.png"
    assert rectify(paths[1], "-o", out, "--readout-ratio", 0.8, "--model", "dense", *words) == 0
    assert worst_part(Photo.open(out).pixels, scene.at(1)) < 6
    filled = tmp_path / "filled.png"
    assert rectify(paths[1], "-o", filled, "--readout-ratio", 0.8, "--edges", "fill", *words) == 0
    assert worst_part(Photo.open(filled).pixels, scene.at(1)) > 12
    assert not before or not after or Photo.open(out).width > 0.97 * WIDTH > Photo.open(filled).height == HEIGHT


def test_what_a_turning_camera_did_not_see_is_borrowed() -> None:
    """By the camera's motion: frames of a wall from a pan, with what a global shutter shows at their first rows."""
    frames, exact = (clip(pan(45.0), ratio, frames=8, noise=0)[1] for ratio in (0.8, 1e-6))
    borrowed, filled = [], []
    for number in range(1, 7):
        result = with_neighbours(*(Photo.from_array(frame) for frame in frames[number - 1 : number + 2]))
        if result.edges == "borrow":
            assert result.motion is not None
            assert result.pixels.size > straighten(frames[number], result.motion, "crop")[0].size
            borrowed.append(worst_part(result.pixels, exact[number]))
            filled.append(worst_part(straighten(frames[number], result.motion, "fill")[0], exact[number]))
    assert len(borrowed) > 3
    assert max(borrowed) < 3 < max(filled)


def with_neighbours(before: Photo, photo: Photo, after: Photo) -> Result:
    """The photo's result, as the command line makes it."""
    from unshutter.options import Undo
    from unshutter.orientation import ScanDirection
    from unshutter.readout_time import ReadoutRatio
    from unshutter.rectification.sequences import SequenceOptions, rectify_between

    options = SequenceOptions(ReadoutRatio(0.8), Undo(), ScanDirection.TOP_TO_BOTTOM, model="camera")
    return rectify_between(photo, before, after, options)


def worst_part(pixels: np.ndarray, truth: np.ndarray, side: int = 16) -> float:
    """The largest root mean square difference of any square, where the result lies in the truth [grey levels]."""
    pixels, truth = (each.reshape(*each.shape[:2], -1).astype(np.float32) for each in (pixels, truth))
    _, _, (left, top), _ = cv2.minMaxLoc(cv2.matchTemplate(truth, pixels, cv2.TM_SQDIFF))
    there = truth[top : top + pixels.shape[0], left : left + pixels.shape[1]]
    squares = cv2.blur(np.square(pixels - there).mean(-1), (side, side))[side // 2 : -side // 2, side // 2 : -side // 2]
    return float(np.sqrt(squares.max()))


# ---- the examples ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["demo.jpg", "original/basilica.webp", "burst/a.jpg", "burst/b.jpg", "burst/c.jpg"])
def test_the_examples_have_pixels_of_their_own(name: str) -> None:
    result = unshutter.rectify(EXAMPLES / name)
    if not result.changed:
        assert np.array_equal(result.pixels, result.original.pixels)
        return
    kept = straighten(result.original.pixels, result.motion, "keep")[0]
    match = cv2.matchTemplate(kept, result.pixels, cv2.TM_SQDIFF)
    top, left = np.unravel_index(match.argmin(), match.shape)
    window = np.s_[top : top + result.pixels.shape[0], left : left + result.pixels.shape[1]]
    assert np.abs(kept[window].astype(int) - result.pixels).max() <= 4  # positions are rounded tile by tile
    seen = cv2.dilate(validity_mask(result.motion).astype(np.uint8), np.ones((3, 3))) > 0
    assert seen[window].all() and result.edges == "crop"


def test_the_demo_keeps_four_fifths() -> None:
    result = unshutter.rectify(EXAMPLES / "demo.jpg")
    assert result.area_left is not None and result.area_left > 0.8 and not result.needs_a_look
