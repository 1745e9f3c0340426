"""What single pictures are made of and what estimates of them score."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest
import skimage.metrics as skimage

from support.drawn_photos import textured
from support.fixed_estimator import Fixed
from support.looking_back import backward_map
from unshutter import Motion, RowMotion
from unshutter.motion import RotationMotion
from unshutter.motion.finding import Finding
from unshutter.motion.warp import validity_mask
from unshutter.photo import Photo
from unshutter.single.estimator import Estimator, View
from unshutter.single.register import load
from unshutter_lab.evaluation.case import Disturbance, disturbed, true_attitude
from unshutter_lab.evaluation.synthetic import Suite, SyntheticCase


class Broken:
    name = "broken"
    candidates = Estimator.candidates

    def estimate(self, view: View) -> Motion:
        raise ValueError("not of\nthis world")


@pytest.fixture(scope="session")
def photo(tmp_path_factory: pytest.TempPathFactory, facade: np.ndarray) -> Path:
    path = tmp_path_factory.mktemp("photos") / "facade.png"
    Photo.from_array(facade).save(path)
    return path


def case(photo: Path, suite: Suite, draw: int = 0, logs: tuple[Path, ...] = ()) -> SyntheticCase:
    return SyntheticCase(suite, "drawn", photo.name, photo, draw, 0, logs)


# ---- pictures with known motion -----------------------------------------------------------------------------


def test_doing_nothing_scores_as_the_input(photo: Path) -> None:
    (record,) = case(photo, Suite("256 px")).judge(["none"], load)
    assert record["epe"] == record["epe_nothing"] > 1
    assert record["psnr"] == record["psnr_input"] < record["psnr_oracle"]
    assert record["ssim"] == record["ssim_input"] < record["ssim_oracle"] <= 1
    assert record["most_tx"] == record["most_rz"] == 0
    assert record["declined"] and not record["failed"]


def test_the_truth_scores_as_the_oracle(photo: Path) -> None:
    made = case(photo, Suite("256 px"))
    truth = made.show([], load).curves["truth"]
    (record,) = made.judge(["truth"], lambda name: Fixed(truth))
    assert record["epe"] == pytest.approx(0, abs=1e-6)
    assert record["psnr"] == record["psnr_oracle"] > record["psnr_input"] + 5
    assert record["most_tx"] == pytest.approx(np.abs(truth.tx_px).max())


def test_a_record_holds_the_confidence_that_the_motion_states(photo: Path) -> None:
    made = case(photo, Suite("256 px"))
    sure = Finding(RowMotion.from_polynomials([0, 20], [0], 256, 256), confidence=0.25)
    (record,) = made.judge(["sure"], lambda name: Fixed(sure))
    assert record["confidence"] == 0.25
    silent = RowMotion.from_polynomials([0, 20], [0], 256, 256)
    for estimator in (Fixed(silent), load("none"), Broken()):  # says nothing, declines, fails
        (record,) = made.judge([estimator.name], lambda name, estimator=estimator: estimator)
        assert record["confidence"] is None
    (record,) = made.judge(["manhattan"], load)
    assert 0 < record["confidence"] < 1


@pytest.mark.parametrize(
    ("px", "confidence", "cause"),
    [
        (9, 0.9, ""),
        (9, 0.01, "not sure"),
        (0.4, 0.9, "no motion"),
        (0.4, 0.3, "no motion"),
        (0.4, None, "less than half a pixel"),
        (9, None, ""),
        (0, 0.9, "no motion"),
    ],
)
def test_a_record_says_whether_rectify_would_leave_the_photo_alone(
    px: float, confidence: float | None, cause: str, photo: Path
) -> None:
    finding = Finding(RowMotion.from_polynomials([0, px], [0], 256, 256), confidence=confidence)
    (record,) = case(photo, Suite("still", still=True)).judge(["fixed"], lambda name: Fixed(finding))
    assert record["left_alone"] == cause
    assert (record["epe"] > 0.1) == (px > 0)  # of the motion found, undone or not


def test_who_declines_or_fails_leaves_the_photo_alone(photo: Path) -> None:
    for estimator in (load("none"), Broken()):
        (record,) = case(photo, Suite("256 px")).judge(["x"], lambda name, estimator=estimator: estimator)
        assert record["left_alone"]


def test_pictures_are_compared_where_truth_and_estimate_see_something(photo: Path) -> None:
    """The same figures from OpenCV's warp and scikit-image, in half a decibel: their bicubics differ."""
    made = case(photo, Suite("256 px"), draw=1)
    shear = RowMotion.from_polynomials([0, 20], [0], 256, 256)
    (record,) = made.judge(["shear"], lambda name: Fixed(shear))
    shown = made.show([], load)
    rs, gs = (dict(shown.pictures)[k] for k in (shown.pictures[0][0], "truth"))
    seen = validity_mask(shear) & validity_mask(shown.curves["truth"])
    warped = cv2.remap(rs, *backward_map(shear), cv2.INTER_CUBIC)
    by_others = skimage.peak_signal_noise_ratio(gs[seen], warped[seen])
    assert record["seen"] == pytest.approx(seen.mean())
    assert record["psnr"] == pytest.approx(by_others, abs=0.5)
    assert record["psnr_input"] == pytest.approx(skimage.peak_signal_noise_ratio(gs[seen], rs[seen]), rel=1e-9)


def test_motions_are_the_same_at_every_size(photo: Path) -> None:
    sizes = [Suite("256 px"), Suite("native", rows=None), Suite("128 px", rows=128), Suite("600 px", rows=600)]
    epes = [case(photo, suite).judge(["none"], load)[0]["epe"] for suite in sizes]
    assert epes == pytest.approx([epes[0]] * 4, rel=0.03)


def test_draws_depend_on_seed_draw_and_photo_only(photo: Path) -> None:
    made = case(photo, Suite("256 px"))
    assert made.judge(["none"], load) == made.judge(["none"], load)
    others = [replace(made, draw=1), replace(made, seed=1)]
    epes = {other.judge(["none"], load)[0]["epe"] for other in (made, *others)}
    assert len(epes) == 3
    renamed = replace(made, photo="other.png", group="elsewhere")
    assert renamed.judge(["none"], load)[0]["epe"] in epes


def test_undistorted_photos_have_no_motion(photo: Path) -> None:
    for rows in (256, None):
        (record,) = case(photo, Suite("still", rows=rows, still=True)).judge(["none"], load)
        assert record["epe"] == 0 and "psnr" not in record


def test_portrait_photos_lie_on_their_side_and_say_so(photo: Path) -> None:
    upright = case(photo, Suite("a", still=True)).show([], load).pictures[0][1]
    for turned, orientation, up in ((1, 6, (-1, 0)), (-1, 8, (1, 0)), (1, 1, (0, -1))):
        suite = Suite("b", turned=turned, orientation=orientation, still=True)
        estimator = Fixed(RowMotion.zero(256, 256))
        shown = case(photo, suite).show(["fixed"], lambda name, e=estimator: e)
        np.testing.assert_array_equal(shown.pictures[0][1], np.rot90(upright, turned))
        assert estimator.seen[0].up == up


def test_estimators_are_given_the_focal_length_of_the_whole_photo(photo: Path) -> None:
    """420 x 560 px give 0.85 * 980; the middle 302 px of it are shown at 256."""
    estimator = Fixed(RowMotion.zero(256, 256))
    case(photo, Suite("256 px")).judge(["fixed"], lambda name: estimator)
    assert estimator.seen[0].focal_px() == pytest.approx(0.85 * 980 * 256 / 302)


def test_rotations_are_judged_by_where_they_look(photo: Path) -> None:
    """A tilt has neither t_x nor r_z at the centre, but moves rows: it must not look like nothing."""
    tilt = RotationMotion(width=256, rotations=np.linspace([0, 0, 0], [0.02, 0, 0], 256), focal_px=400)
    (record,) = case(photo, Suite("still", still=True)).judge(["tilt"], lambda name: Answering(tilt))
    assert record["epe"] > 2
    assert record["most_tx"] == pytest.approx(0, abs=1e-9)


class Answering(Fixed):
    def estimate(self, view: View) -> Motion:
        return self.motion


def test_an_estimator_that_breaks_is_on_record_and_stops_nobody(photo: Path) -> None:
    estimators = {"broken": Broken(), "none": load("none")}
    broken, none = case(photo, Suite("256 px")).judge(["broken", "none"], estimators.__getitem__)
    assert broken["failed"] == "ValueError: not of this world"
    assert broken["epe"] == none["epe"] and not none["failed"]


def test_a_motion_that_cannot_be_undone_leaves_the_input(photo: Path) -> None:
    folding = RowMotion(256, np.zeros(256), np.where(np.arange(256) % 2, 0.5, 0.0))
    (record,) = case(photo, Suite("256 px")).judge(["folding"], lambda name: Fixed(folding))
    assert record["psnr"] == record["psnr_input"]
    assert np.isfinite(record["epe"]) and record["epe"] > record["epe_nothing"]


def test_recorded_motions(photo: Path, tmp_path: Path) -> None:
    """A camera that turns left at 1 rad/s for 50 ms at f = 256 px: t_x = 256 tan(0.05 * 255 / 256)."""
    t = np.linspace(0, 2, 201)
    log = tmp_path / "left.npz"
    np.savez(log, t_s=t, gyro_rad_s=np.tile([1.0, 0, 0], (201, 1)))
    suite = Suite("50 ms", readout_s=0.05)
    truth = case(photo, suite, logs=(log,)).show([], load).curves["truth"]
    assert truth.tx_px[-1] == pytest.approx(256 * np.tan(0.05 * 255 / 256), rel=1e-3)
    assert np.abs(truth.rz_rad).max() == pytest.approx(0, abs=1e-9)


def test_exposures_blur_the_picture_and_are_told(photo: Path) -> None:
    sharp, short, long = (
        case(photo, Suite(str(time), exposure_s=time)).show([], load) for time in (None, 1 / 1000, 1 / 60)
    )
    assert sharp.curves["truth"] == short.curves["truth"] == long.curves["truth"]
    blurred = [np.abs(np.diff(shown.pictures[0][1].astype(float), axis=1)).mean() for shown in (sharp, short, long)]
    assert blurred[2] < 0.8 * blurred[1] < blurred[0]
    estimator = Fixed(RowMotion.zero(256, 256))
    for suite in (Suite("a", exposure_s=1 / 60), Suite("b", exposure_s=1 / 60, still=True), Suite("c")):
        case(photo, suite).judge(["fixed"], lambda name: estimator)
    told = [(view.exposure_s(), view.camera.readout_ms) for view in estimator.seen]
    assert told == [(pytest.approx(1 / 60), 30), (pytest.approx(1 / 60), 30), (None, None)]


def test_the_attitude_is_told_as_well_as_asked(photo: Path) -> None:
    exact, off = (Fixed(RowMotion.zero(256, 256)) for _ in range(2))
    for draw in range(4):
        case(photo, Suite("a", attitude_deg=0.0), draw).judge(["fixed"], lambda name: exact)
        case(photo, Suite("b", attitude_deg=1.0), draw).judge(["fixed"], lambda name: off)
    truth, told = (np.array([view.attitude_deg() for view in each.seen]) for each in (exact, off))
    assert (truth == truth[0]).all() and np.abs(truth).max() < 1  # the facade is seen straight on
    assert np.abs(told - truth).min() > 0 and np.abs(told - truth).max() <= 1
    plain = case(photo, Suite("c")).show([], load).curves["truth"]
    assert case(photo, Suite("d", attitude_deg=1.0)).show([], load).curves["truth"] == plain


@pytest.mark.parametrize("roll", [-4.0, 3.0])
def test_the_true_attitude_of_a_camera_that_was_turned(facade: np.ndarray, roll: float) -> None:
    """A camera turned clockwise sees the scene turned counter-clockwise, as OpenCV counts angles."""
    height, width = facade.shape[:2]
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), roll, 1)
    seen = cv2.warpAffine(facade, turn, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    told = true_attitude(View(Photo.from_array(seen)))
    assert told is not None and told[0] == pytest.approx(roll, abs=0.5)


def test_a_picture_without_lines_tells_no_attitude() -> None:
    assert true_attitude(View(Photo.from_array(np.full((200, 300), 128, np.uint8)))) is None


# ---- disturbances -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", get_args(Disturbance))
def test_disturbances_repeat_and_change_something(name: str) -> None:
    picture = textured(90, 120)
    before = picture.copy()
    a, b = (disturbed(picture, name, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(picture, before)
    assert a.shape == picture.shape and a.dtype == np.uint8
    assert np.abs(a.astype(int) - picture).mean() > 0.2


def test_disturbances_are_as_strong_as_they_say() -> None:
    grey = np.full((200, 200, 3), 128, np.uint8)
    rng = np.random.default_rng(0)
    assert (disturbed(grey, "noise", rng).astype(float) - 128).std() == pytest.approx(10, rel=0.02)
    night = disturbed(grey, "night", rng).astype(float)
    assert night.mean() == pytest.approx(0.5 * 255 * (128 / 255) ** 2, rel=0.02)
    assert night.std() == pytest.approx(6, rel=0.02)
    edge = np.repeat(np.where(np.arange(100) < 50, 0, 255)[None, :, None], 100, 0).repeat(3, 2).astype(np.uint8)
    step = np.diff(disturbed(edge, "blur", rng)[50, :, 0].astype(float))
    spread = np.sqrt((step * (np.arange(99) - 49) ** 2).sum() / step.sum())
    assert spread == pytest.approx(1.5, rel=0.05)
