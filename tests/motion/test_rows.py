import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unshutter.motion import geometry

ROWS = 256


def predecessor_motion(rng: np.random.Generator, rows: int = ROWS) -> tuple[np.ndarray, np.ndarray]:
    """The range of Rengarajan 2017, written down independently of the package: canvas rows 50 ... 305 of 356."""
    i = 50 + np.arange(rows) * 255 / (rows - 1)
    a, b = rng.uniform(-3, 3), rng.uniform(-6, 6)
    c, d = rng.uniform(-0.4, 0.4, 2)
    tx = a * (5 * i / 356) ** 2 + b * (5 * i / 356)
    rz = (c * (i / 356) ** 2 + d * i / 356) * np.pi / 8
    return (tx - tx[0]) * rows / 256, rz - rz[0]


def grid(height: int, width: int, step: int = 8) -> tuple[np.ndarray, np.ndarray]:
    col, row = np.meshgrid(np.arange(0, width, step, dtype=float), np.arange(0, height, step, dtype=float))
    return col, row


def steadily(tx: float, rz: float) -> geometry.MotionAtRow:
    return lambda row: (np.full_like(row, tx), np.full_like(row, rz), np.zeros_like(row))


def test_sign_convention_by_a_drawn_example() -> None:
    # A point 10 px right of the centre; a row with t = 3 px and r = +90 degrees sees it 10 px *below* the
    # centre (clockwise, rows run down), then moved 3 px to the right.
    col, row = geometry.gs_to_rs(np.array(10.0), np.array(0.0), steadily(3.0, np.pi / 2))
    assert (float(col), float(row)) == pytest.approx((3.0, 10.0))
    back = geometry.rs_to_gs(col, row, np.array(3.0), np.array(np.pi / 2))
    assert tuple(map(float, back)) == pytest.approx((10.0, 0.0))


def test_rotation_happens_about_the_given_centre() -> None:
    col, row = geometry.gs_to_rs(np.array(7.0), np.array(5.0), steadily(0.0, 0.3), (7.0, 5.0))
    assert (float(col), float(row)) == pytest.approx((7.0, 5.0))


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(2, 400),
    aspect=st.floats(0.4, 2.4),
    jitter=st.floats(0, 0.002),
)
def test_inverse_of_rough_motions(seed: int, rows: int, aspect: float, jitter: float) -> None:
    """Row-by-row jitter (a shaking phone), not only polynomials; any size; corners, too."""
    rng = np.random.default_rng(seed)
    tx, rz = predecessor_motion(rng, rows)
    tx, rz = tx + rng.normal(size=rows), rz + np.cumsum(rng.normal(size=rows)) * jitter * min(1, 16 / rows)
    width = max(round(rows * aspect), 2)
    center = ((width - 1) / 2, (rows - 1) / 2)
    col, row = (
        np.append(rng.uniform(0, n - 1, 50), ends) for n, ends in ((width, [0, width - 1]), (rows, [0, rows - 1]))
    )
    motion = geometry.row_motion_from_samples(tx, rz)
    x, y = geometry.gs_to_rs(col, row, motion, center)
    t, r, _ = motion(y)
    back = geometry.rs_to_gs(x, y, t, r, center)
    assert np.hypot(back[0] - col, back[1] - row).max() < 1e-3


def test_numpy_and_torch_agree() -> None:
    torch = pytest.importorskip("torch", reason="compares with torch")
    tx, rz = predecessor_motion(np.random.default_rng(4))
    col, row = grid(ROWS, ROWS)
    ours = geometry.gs_to_rs(col, row, geometry.row_motion_from_samples(tx, rz), (127.5, 127.5))
    theirs = geometry.gs_to_rs(
        torch.from_numpy(col),
        torch.from_numpy(row),
        geometry.row_motion_from_samples(torch.from_numpy(tx), torch.from_numpy(rz)),
        (127.5, 127.5),
    )
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b.numpy(), atol=1e-10)


def test_polynomial_and_sampled_motion_agree() -> None:
    tx_coefficients, rz_coefficients = np.array([0.0, 20.0, -35.0, 10.0]), np.array([0.0, 0.1, -0.05, 0.02])
    u = np.arange(4 * ROWS) / (4 * ROWS - 1)
    sampled = geometry.row_motion_from_samples(
        geometry.polynomial(tx_coefficients, u), geometry.polynomial(rz_coefficients, u)
    )
    exact = geometry.row_motion_from_polynomial(tx_coefficients, rz_coefficients, 0, 4 * ROWS - 1)
    col, row = grid(4 * ROWS, 4 * ROWS, 32)
    for a, b in zip(
        geometry.gs_to_rs(col, row, sampled, (511.5, 511.5)),
        geometry.gs_to_rs(col, row, exact, (511.5, 511.5)),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, atol=1e-3)


def test_gradients_by_finite_differences() -> None:
    torch = pytest.importorskip("torch", reason="compares with torch")
    generator = torch.Generator().manual_seed(0)
    tx = torch.tensor([0.0, 5.0, -3.0, 1.0], dtype=torch.float64, requires_grad=True)
    rz = torch.tensor([0.0, 0.2, -0.1, 0.05], dtype=torch.float64, requires_grad=True)
    col = (torch.rand(7, generator=generator, dtype=torch.float64) * 30 + 2).requires_grad_()
    row = (torch.rand(7, generator=generator, dtype=torch.float64) * 30 + 2).requires_grad_()

    def inverse(tx, rz, col, row):
        return geometry.gs_to_rs(col, row, geometry.row_motion_from_polynomial(tx, rz, 0, 34), (17.0, 17.0))

    def forward(tx, rz, col, row):
        t, r, _ = geometry.row_motion_from_polynomial(tx, rz, 0, 34)(row)
        return geometry.rs_to_gs(col, row, t, r, (17.0, 17.0))

    assert torch.autograd.gradcheck(inverse, (tx, rz, col, row))
    assert torch.autograd.gradcheck(forward, (tx, rz, col, row))


def test_a_batch_of_polynomials_is_evaluated_per_sample() -> None:
    coefficients = np.array([[[1.0, 2.0, 0.0]], [[0.0, 0.0, 4.0]]])  # [2, 1, 3]
    u = np.array([[0.0, 0.5, 1.0], [0.0, 0.5, 1.0]])
    np.testing.assert_allclose(geometry.polynomial(coefficients, u), [[1, 2, 3], [0, 1, 4]])


def test_motion_stays_constant_beyond_the_picture() -> None:
    motion = geometry.row_motion_from_samples(np.array([1.0, 2.0, 4.0]), np.array([0.0, 0.1, 0.2]))
    tx, rz, slope = motion(np.array([-5.0, 0.5, 9.0]))
    np.testing.assert_allclose(tx, [1.0, 1.5, 4.0])
    np.testing.assert_allclose(rz, [0.0, 0.05, 0.2])
    np.testing.assert_allclose(slope, [0.0, 0.1, 0.0])
