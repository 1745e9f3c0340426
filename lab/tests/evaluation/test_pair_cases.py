"""Pairs and frames: what estimates of them score."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from support.covering import thorough
from support.drawn_photos import textured
from support.fixed_estimator import Fixed
from unshutter import Motion, RowMotion
from unshutter.photo import Photo
from unshutter.single.register import load
from unshutter_lab.evaluation.case import in_8_bits
from unshutter_lab.evaluation.ceiling import fit_to_pair
from unshutter_lab.evaluation.clip_cases import VideoCase, agreeing_matches
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.evaluation.pair_cases import Frame, PairCase
from unshutter_lab.synthesis.pairs import synthesize
from unshutter_lab.synthesis.row_motions import draw_quadratic

# ---- pairs --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Frame, dict[str, Motion]]:
    """A scene of which a rolling shutter saw the middle, and global shutters at the moments of two of its rows."""
    folder = tmp_path_factory.mktemp("pair")
    scene = cv2.GaussianBlur(textured(280, 280), (0, 0), 2.0)
    drawn = draw_quadratic(np.random.default_rng(5), 200, 280)
    rs, gs = synthesize(scene, drawn)
    motions = {reference: drawn.crop.rereferenced(reference) for reference in ("first", "middle")}
    col, row = np.meshgrid(np.arange(200.0), np.arange(200.0))
    at = drawn.crop.rs_to_gs(*motions["middle"].gs_to_rs(col, row))  # where the middle row's picture sees the first's
    x, y = ((a + drawn.margin).astype(np.float32) for a in at)
    pictures = {"rs_0": rs, "gs_0_first": gs, "gs_0_middle": cv2.remap(scene, x, y, cv2.INTER_CUBIC)}
    for name, picture in pictures.items():
        Photo.from_array(picture).save(folder / f"{name}.png")
    files = {reference: folder / f"gs_0_{reference}.png" for reference in motions}
    return Frame("pair", 0, folder / "rs_0.png", files), motions


@pytest.mark.parametrize("reference", [thorough("first"), "middle"])
def test_the_ceiling_finds_the_motion_of_a_pair(pair: tuple[Frame, dict[str, Motion]], reference: str) -> None:
    frame, motions = pair
    rs, gs = (in_8_bits(Photo.open(path)) for path in (frame.rs, frame.gs[reference]))
    found = fit_to_pair(rs, gs, reference)
    assert found.reference == reference
    assert motion_error(found, motions[reference]).epe < 0.25


def test_pairs_are_compared_at_their_reference_row(pair: tuple[Frame, dict[str, Motion]]) -> None:
    frame, motions = pair
    truth = Fixed(motions["first"])
    records = PairCase("drawn", frame).judge(["none", "truth"], lambda name: load("none") if name == "none" else truth)
    assert [(r["suite"], r["estimator"]) for r in records] == [
        ("first row", "none"),
        ("middle row", "none"),
        ("first row", "truth"),
        ("middle row", "truth"),
    ]
    for none, best in zip(records[:2], records[2:], strict=True):
        assert none["psnr"] == none["psnr_input"] < best["psnr"] - 8
        assert best["psnr"] > 33 and best["ssim"] > 0.97


# ---- |R_F| --------------------------------------------------------------------------------------------------


def seen(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return picture, np.ones(picture.shape[:2], bool)


def spotted(height: int, width: int) -> np.ndarray:
    """Blobs of a few pixels, as SIFT likes them."""
    noise = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 1, (height, width, 3)), (0, 0), 2.0)
    return np.clip(128 + 100 * noise / np.abs(noise).max(), 0, 255).astype(np.uint8)


def test_matches_that_agree_are_counted_and_repeat() -> None:
    scene = spotted(260, 340)
    left, right = seen(scene[:, :-20]), seen(scene[:, 20:])
    first = agreeing_matches(left, right, seed=0)
    assert first == agreeing_matches(left, right, seed=0)
    assert first[1] > 50 and first[0] > 0.95 * first[1]


def test_wobble_makes_matches_disagree() -> None:
    """Rows displaced to and fro by 8 px, across and along: no fundamental matrix explains that."""
    scene = spotted(260, 340)
    col, row = np.meshgrid(np.arange(340, dtype=np.float32), np.arange(260, dtype=np.float32))
    wobbling = cv2.remap(scene, col + 8 * np.sin(row / 9), row + 8 * np.sin(col / 13), cv2.INTER_LINEAR)
    still, wobble = (agreeing_matches(seen(scene), seen(p), seed=0) for p in (scene, wobbling))
    assert wobble[0] < 0.7 * still[0]


def test_pictures_without_features_have_no_matches() -> None:
    flat = np.full((100, 100, 3), 90, np.uint8)
    assert agreeing_matches(seen(flat), seen(flat), seed=0) == (0, 0)


def test_frames_of_a_video(tmp_path: Path) -> None:
    for name, picture in {"rs_0": spotted(120, 160), "gs_0_middle": spotted(120, 160)}.items():
        Photo.from_array(picture).save(tmp_path / f"{name}.png")
    frame = Frame("video", 0, tmp_path / "rs_0.png", {"middle": tmp_path / "gs_0_middle.png"})
    case = VideoCase("drawn", (frame, replace(frame, number=1)), 0)
    assert case.oracles == ("true global shutter",)
    sheared = Fixed(RowMotion.from_polynomials([0, 9], [0], 120, 160))
    records = case.judge(["none", "fixed", *case.oracles], lambda name: load("none") if name == "none" else sheared)
    assert [r["estimator"] for r in records] == ["none", "fixed", "true global shutter"]
    assert records[0]["inliers"] == records[0]["inliers_input"] > 20
    assert all(r["inliers"] <= r["matches"] for r in records)
