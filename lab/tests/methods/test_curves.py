import numpy as np

from support.line_scenes import FOCAL, HEIGHT, WIDTH, seen_curves, turning
from unshutter_lab.methods.curves import POINTS, RotatedCurves, find_curves, link, principal_lines


def test_segments_end_to_end_are_one_curve() -> None:
    chain = np.array([[10, 10, 50, 12], [52, 12.2, 90, 17], [91, 17, 130, 26]], dtype=float)
    other_side = chain[1, [2, 3, 0, 1]]  # bright on the other side
    beside = chain[0] + [0, 6, 0, 6]
    turned = np.array([132, 27, 140, 60], dtype=float)
    segments = np.stack([chain[2], beside, chain[0], other_side, chain[1], turned])
    assert sorted(link(segments)) == [[1], [2, 4, 0], [3], [5]]
    assert link(np.zeros((0, 4))) == []


def test_a_ring_of_segments_is_opened() -> None:
    """Forty chords of a circle: each continues the one before, none is the first."""
    a = np.linspace(0, 2 * np.pi, 41)
    points = 100 + 80 * np.stack([np.cos(a), np.sin(a)], axis=1)
    (chain,) = link(np.concatenate([points[:-1], points[1:]], axis=1))
    assert sorted(chain) == list(range(40))


def test_a_drawn_arc_is_found_with_its_bend() -> None:
    row, col = np.mgrid[0:900, 0:900] / 3 - 1 / 3
    big = np.where(np.hypot(col + 800, row - 150) < 960, 220.0, 40.0)  # edge near column 160, sagitta about 9 px
    grey = big.reshape(300, 3, 300, 3).mean(axis=(1, 3)).astype(np.uint8)
    curves = find_curves(grey, 200)
    assert curves.shape == (1, POINTS, 2)
    np.testing.assert_allclose(np.hypot(curves[..., 0] + 800, curves[..., 1] - 150), 960, atol=0.25)
    assert find_curves(np.full((100, 100), 128, np.uint8), 5).shape == (0, POINTS, 2)


def test_bends_are_measured_in_the_picture_as_it_is() -> None:
    """Squeezing the rectified picture makes distances no smaller: noise is no reason for a motion."""
    curves = seen_curves(turning((0, 0, 0)), 0, noise=0.5)
    still = RotatedCurves(curves, HEIGHT, WIDTH, FOCAL)
    bends = still.undone(lambda u: np.zeros((*u.shape, 3)))[1]
    np.testing.assert_allclose(bends, principal_lines(curves)[0], rtol=1e-6, atol=1e-9)
    squeezed = still.undone(lambda u: np.stack([0.3 * u, 0 * u, 0 * u], axis=-1))[1]
    assert np.sqrt((squeezed**2).mean()) > 0.95 * np.sqrt((bends**2).mean())
