import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import unshutter
from support.covering import thorough
from support.line_scenes import (
    FOCAL,
    HEIGHT,
    WIDTH,
    U,
    check_exact,
    drawn_picture,
    manhattan_segments,
    motion_of,
    seen_curves,
    turning,
)
from unshutter.cli import main
from unshutter.motion import Motion
from unshutter.photo import Photo
from unshutter_lab.methods.purkait2017 import fit_rate, line_polynomials, solve_four


@pytest.mark.parametrize("rate", [thorough(0.0), 0.05, thorough(-0.3), 0.8])
def test_four_segments_give_the_rate_to_the_last_digits(rate: float) -> None:
    """Samples whose segments belong to the vanishing points as the solver supposes: two, one, one; or two, two."""
    hits = 0
    for seed in range(20):
        segments = manhattan_segments(rate, seed, count=60)
        polynomials = line_polynomials(segments)
        rng = np.random.default_rng(seed)
        samples = np.stack([rng.permutation(60)[:4] for _ in range(30)])
        rates, frames = solve_four(polynomials[samples])
        np.testing.assert_allclose(frames @ frames.swapaxes(1, 2), np.broadcast_to(np.eye(3), frames.shape), atol=1e-6)
        hits += (np.abs(rates - rate) < 1e-6).any()
    assert hits == 20


@pytest.mark.parametrize("rate", [0.0, 0.1, -0.3])
def test_the_rate_of_a_manhattan_world(rate: float) -> None:
    found, share = fit_rate(manhattan_segments(rate, 0))
    assert found == pytest.approx(rate, abs=1e-6)
    assert share == 1
    noisy, share = fit_rate(manhattan_segments(rate, 1, noise=0.001))
    assert noisy == pytest.approx(rate, abs=0.02)
    assert share > 0.95
    cluttered, share = fit_rate(manhattan_segments(rate, 2, noise=0.001, clutter=0.4))
    assert cluttered == pytest.approx(rate, abs=0.03)
    assert share < 0.85  # so that the estimator declines, or nearly


@pytest.mark.parametrize("degrees", [3, 6, -8])
def test_a_true_rotation_is_found_although_the_model_is_of_first_order(degrees: float) -> None:
    truth = turning((0, 0, degrees))
    curves = seen_curves(truth, 0, count=150)
    ends = np.stack(truth.rs_to_gs(*np.moveaxis(curves[:, [0, -1]], -1, 0)), axis=-1)
    upright = np.abs(ends[:, 1] - ends[:, 0]).min(axis=-1) < 1e-3  # verticals and horizontals of the scene
    center = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    rate, share = fit_rate(((curves[upright][:, [0, -1]] - center) / FOCAL).reshape(-1, 4))
    assert share == 1
    check_exact(motion_of(np.stack([0 * U, 0 * U, -rate * U * HEIGHT / FOCAL], axis=1)), truth)


def test_a_world_without_three_directions_is_declined() -> None:
    """Strokes in all directions: fewer than 75 % fit."""
    grey = np.full((400, 500), 200, np.uint8)
    rng = np.random.default_rng(0)
    for _ in range(150):
        at, along = rng.uniform(0, 400, 2), rng.uniform(-60, 60, 2)
        cv2.line(grey, *(tuple(map(int, p)) for p in (at, at + along)), color=60, thickness=2, lineType=cv2.LINE_AA)
    found = unshutter.estimate(grey, estimator="purkait2017")
    assert found.motion.is_zero
    assert "fit a Manhattan world" in str(found.reason)


def test_the_focal_length_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo, out = tmp_path / "p.png", tmp_path / "m.json"
    Photo.from_array(drawn_picture(turning((0, 0, 5)))).save(photo)
    options = ["--estimator", "purkait2017", "--focal-px", "450"]
    assert main(["estimate", str(photo), *options, "-o", str(out)]) == 0
    assert json.loads(out.read_text())["focal_px"] == 450
    saved = tmp_path / "saved.json"
    kept = ["--edges", "keep"]
    out = tmp_path / "r.png"
    assert main(["rectify", str(photo), *options, *kept, "-o", str(out), "--save-motion", str(saved)]) == 0
    np.testing.assert_array_equal(Motion.load(saved).rz_rad, Motion.load(tmp_path / "m.json").rz_rad)
    again = tmp_path / "again.png"  # the saved motion gives the same picture
    assert main(["rectify", str(photo), "--motion", str(saved), *kept, "-o", str(again)]) == 0
    assert Photo.open(again).to_array().tobytes() == Photo.open(out).to_array().tobytes()
    capsys.readouterr()
    assert main(["estimate", str(photo), "--focal-px", "-1"]) == 2
    assert "--focal-px must lie between" in capsys.readouterr().err
