"""RotationMotion and the row homographies behind it; rotations are checked against SciPy's."""

import json
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.looking_back import backward_map
from unshutter import Motion, RowMotion, UnshutterError
from unshutter.motion import RotationMotion
from unshutter.motion import rotations as rotation_geometry

FOCAL = 400.0


def turning(
    degrees=((6, -8, 5), (-3, 4, 6)), height: int = 240, width: int = 320, focal_px: float = FOCAL, **about
) -> RotationMotion:
    """Rotations of so many degrees of u and u^2 about x, y and z, u = row / (height - 1)."""
    u = np.arange(height)[:, None] / (height - 1)
    rotations = sum(np.radians(d) * u ** (k + 1) for k, d in enumerate(degrees))
    return RotationMotion(width=width, rotations=rotations, focal_px=focal_px, **about)


def grid(motion: Motion, step: float = 13.0) -> tuple[np.ndarray, np.ndarray]:
    col, row = np.meshgrid(np.arange(0, motion.width, step), np.arange(0, motion.height, step))
    return col, row


def test_matrices_and_vectors_are_scipys() -> None:
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(200, 3)) * 10.0 ** rng.uniform(-12, 0, (200, 1))
    vectors[:3] = [[0, 0, 0], [1e-300, 0, 0], [0, 0, 3.1]]
    matrices = rotation_geometry.rotation_matrix(vectors)
    np.testing.assert_allclose(matrices, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-14)
    short = np.linalg.norm(vectors, axis=1) < np.pi
    np.testing.assert_allclose(rotation_geometry.rotation_vector(matrices)[short], vectors[short], atol=1e-13)


def test_positions_follow_the_homography_of_their_row() -> None:
    """K R K^-1 written out with SciPy's rotation, at rows that exist."""
    motion = turning()
    col, row = np.array([0.0, 319.0, 100.5, 12.0]), np.array([0.0, 239.0, 120.0, 33.0])
    k = np.array([[FOCAL, 0, 159.5], [0, FOCAL, 119.5], [0, 0, 1]])
    found = np.stack(motion.rs_to_gs(col, row), axis=-1)
    for x, y, gs in zip(col, row, found, strict=True):
        homography = k @ Rotation.from_rotvec(motion.rotations[int(y)].copy()).as_matrix() @ np.linalg.inv(k)
        rs = homography @ [*gs, 1]
        np.testing.assert_allclose(rs[:2] / rs[2], (x, y), atol=1e-9)


def test_turning_about_z_alone_is_the_papers_rotation() -> None:
    rz = 0.2 * np.sin(np.arange(240) / 90)
    plain = RowMotion(320, np.zeros(240), rz)
    turned = RotationMotion(width=320, rotations=np.stack([0 * rz, 0 * rz, rz], axis=1), focal_px=FOCAL)
    for reference in ("first", "middle", "last"):
        one, two = plain.rereferenced(reference), turned.rereferenced(reference)
        np.testing.assert_allclose(two.tx_px, 0, atol=1e-12)
        np.testing.assert_allclose(two.rz_rad, one.rz_rad, atol=1e-14)
        col, row = np.meshgrid(np.linspace(-20, 340, 19), np.linspace(-30, 270, 31))  # beyond the borders, too
        np.testing.assert_allclose(two.gs_to_rs(col, row), one.gs_to_rs(col, row), atol=1e-9)
        np.testing.assert_allclose(two.rs_to_gs(col, row), one.rs_to_gs(col, row), atol=1e-9)
    one, two = plain.resized(480, 640).scaled(0.5), turned.resized(480, 640).scaled(0.5)
    np.testing.assert_allclose(two.rz_rad, one.rz_rad, atol=1e-12)
    assert two.focal_px == 2 * FOCAL


@pytest.mark.parametrize(("axis", "moves"), [(0, (0, -1)), (1, (1, 0))])
def test_signs_of_the_other_axes(axis: int, moves: tuple[int, int]) -> None:
    """r_y > 0 moves the centre f tan(r_y) columns to the right, r_x > 0 as many rows up."""
    rotations = np.zeros((201, 3))
    rotations[1:, axis] = 0.05
    motion = RotationMotion(width=301, rotations=rotations, focal_px=FOCAL)
    col, row = motion.gs_to_rs(150.0, 100.0)
    assert (col - 150, row - 100) == pytest.approx(FOCAL * np.tan(0.05) * np.array(moves))
    assert motion.tx_px[100] == pytest.approx(FOCAL * np.tan(0.05) * moves[0])
    assert motion.rz_rad[100] == 0


def test_small_turns_about_y_are_the_papers_translation_near_the_centre() -> None:
    rotations = np.zeros((240, 3))
    rotations[:, 1] = np.linspace(0, 0.002, 240)
    motion = RotationMotion(width=320, rotations=rotations, focal_px=4000.0)
    plain = RowMotion(320, motion.tx_px, motion.rz_rad)
    assert np.abs(plain.tx_px).max() == pytest.approx(8, rel=1e-3)
    np.testing.assert_allclose(motion.gs_to_rs(*grid(motion)), plain.gs_to_rs(*grid(motion)), atol=0.03)


def test_inverse_residual_over_many_motions() -> None:
    rng = np.random.default_rng(0)
    worst, tested = 0.0, 0
    for _ in range(120):
        motion = turning(rng.uniform(-7.5, 7.5, (2, 3)), focal_px=rng.uniform(200, 800))
        try:
            motion.check_unfolded()
        except UnshutterError:
            continue
        tested += 1
        col, row = grid(motion, 39.75)
        back = motion.rs_to_gs(*motion.gs_to_rs(col, row))
        worst = max(worst, np.abs(np.stack(back) - (col, row)).max())
    assert tested > 100
    assert worst < 1e-3


def test_jitter_from_row_to_row_is_inverted_too() -> None:
    rotations = turning().rotations + np.cumsum(np.random.default_rng(1).normal(0, 3e-4, (240, 3)), axis=0)
    motion = RotationMotion(width=320, rotations=rotations, focal_px=FOCAL)
    motion.check_unfolded()
    back = motion.rs_to_gs(*motion.gs_to_rs(*grid(motion)))
    np.testing.assert_allclose(back, grid(motion), atol=1e-3)


@pytest.mark.parametrize("reference", ["middle", "last"])
def test_another_reference_is_the_same_picture_turned_as_a_whole(reference) -> None:
    motion = turning()
    other = motion.rereferenced(reference)
    assert not other.rotations[other.reference_row].any()
    rng = np.random.default_rng(0)
    col, row = rng.uniform(0, 319, 50), rng.uniform(-20, 260, 50)  # between rows and beyond them
    one, two = (
        np.stack([x - 159.5, y - 119.5, np.full(50, FOCAL)]) for x, y in (m.rs_to_gs(col, row) for m in (motion, other))
    )
    one, two = one / np.linalg.norm(one, axis=0), two / np.linalg.norm(two, axis=0)
    np.testing.assert_allclose(one.T @ one, two.T @ two, atol=1e-12)  # angles between directions stay
    back = other.rereferenced("first")
    np.testing.assert_allclose(back.rotations, motion.rotations, atol=1e-13)


def test_resizing_scales_positions() -> None:
    motion = turning(height=100, width=150)
    large = motion.resized(400, 600)
    assert large.focal_px == 4 * FOCAL
    assert not large.rotations[0].any()
    col, row = np.array([20.0, 75.0, 140.0]), np.array([20.0, 50.0, 90.0])
    small, big = (
        np.stack(
            [*(np.stack(m.rs_to_gs((col + 0.5) * s - 0.5, (row + 0.5) * s - 0.5)) + 0.5), np.full(3, m.focal_px * f)]
        )
        for m, s, f in ((motion, 1, 1), (large, 4, 1))
    )
    centre = np.array([[75.0], [50.0], [0]])
    one, two = small - centre, big - 4 * centre
    one, two = one / np.linalg.norm(one, axis=0), two / np.linalg.norm(two, axis=0)
    # the same up to the turn from the first row's centre to that of the large picture's first row
    np.testing.assert_allclose(one.T @ one, two.T @ two, atol=2e-6)
    with pytest.raises(UnshutterError, match="aspect ratio"):
        motion.resized(150, 100)


def test_a_file_that_contradicts_itself_is_refused(tmp_path: Path) -> None:
    motion = turning().rereferenced("middle")
    motion.save(tmp_path / "m.json")
    data = json.loads((tmp_path / "m.json").read_text())
    assert data["format"] == "unshutter-motion/1"
    for change, says in (
        ({"tx_px": [0.0] * 240}, "contradicts"),
        ({"rotations_rad": [[0.0, 0.0]] * 240}, "three rotations"),
        ({"focal_px": -1.0}, "positive"),
        ({"rotations_rad": [[0.0, 2.0, 0.0]] * 240}, "90 degrees"),
        ({"rotations_rad": [[0.0, float("nan"), 0.0]] * 240}, "finite"),
    ):
        with pytest.raises(UnshutterError, match=says):
            Motion.from_json(json.dumps(data | change))
    del data["focal_px"]
    with pytest.raises(UnshutterError, match="focal_px"):
        Motion.from_json(json.dumps(data))


@pytest.mark.parametrize(
    ("degrees", "says"), [((0, 0, 100), "folds?"), ((-80, 0, 0), "fold"), ((0, 80, 0), "behind|fold")]
)
def test_motions_that_fold_are_refused(degrees: tuple[float, float, float], says: str) -> None:
    with pytest.raises(UnshutterError, match=says):
        turning((np.array(degrees) * 0.89,)).check_unfolded()
    turning((np.array(degrees) * 0.1,)).check_unfolded()


def test_rows_at_the_border_fold_before_those_in_the_middle() -> None:
    """A tilt moves a point by f (1 + y^2) times its angle: at y = 1 by twice as much as in the middle."""
    rows = np.arange(240)[:, None] - 119.5
    for per_row, folds in ((-0.7, True), (-0.4, False)):  # of the focal length
        motion = RotationMotion(320, rotations=per_row / 120 * rows * [1.0, 0.0, 0.0], focal_px=120.0)
        with pytest.raises(UnshutterError, match="faster than rows") if folds else nullcontext():
            motion.check_unfolded()


def test_pictures_are_warped_by_the_rotations() -> None:
    motion = turning(((1, -2, 1),))
    col, row = backward_map(motion)
    exact = motion.gs_to_rs(*np.meshgrid(np.arange(320.0), np.arange(240.0)))
    inside = (exact[0] >= 0) & (exact[0] <= 319) & (exact[1] >= 0) & (exact[1] <= 239)
    assert np.abs(col - exact[0])[inside].max() < 0.01
    assert np.abs(row - exact[1])[inside].max() < 0.01
    assert np.abs(row - np.arange(240)[:, None])[inside].max() > 2  # rows move, too


def test_torch_agrees_and_has_gradients() -> None:
    torch = pytest.importorskip("torch", reason="compares with torch")
    motion = turning(height=60, width=80, focal_px=100.0)
    col, row = grid(motion)
    samples = rotation_geometry.rotation_matrix(motion.rotations)
    center = motion.center
    ours = rotation_geometry.rotated_gs_to_rs(
        col, row, rotation_geometry.row_rotation_from_samples(samples), 100.0, center
    )
    theirs = rotation_geometry.rotated_gs_to_rs(
        torch.from_numpy(col),
        torch.from_numpy(row),
        rotation_geometry.row_rotation_from_samples(torch.from_numpy(samples)),
        100.0,
        center,
    )
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b.numpy(), atol=1e-10)

    def positions(vectors, at):
        look_up = rotation_geometry.row_rotation_from_samples(rotation_geometry.rotation_matrix(vectors))
        there = rotation_geometry.rotated_gs_to_rs(at[0], at[1], look_up, 30.0, (9.5, 4.5))
        back = rotation_geometry.rotated_rs_to_gs(at[0], at[1], look_up, 30.0, (9.5, 4.5))
        return torch.stack([*there, *back])

    generator = torch.Generator().manual_seed(0)
    vectors = (torch.rand(10, 3, generator=generator, dtype=torch.float64) * 0.05).requires_grad_()
    at = (torch.rand(2, 5, generator=generator, dtype=torch.float64) * 6 + 1.2).requires_grad_()
    assert torch.autograd.gradcheck(positions, (vectors, at))
