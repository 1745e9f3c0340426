"""Losses: numbers worked out by hand, OpenCV's Sobel, gradcheck."""

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from unshutter_lab.training.kandula2020_losses import edge_loss, sobel, visible_mse
from unshutter_lab.training.recipes import motion_distance, motion_mse

torch.set_num_threads(1)


def picture(rows) -> torch.Tensor:
    return torch.tensor(rows, dtype=torch.float64)[None, None]


def test_visible_mse_by_hand():
    warped = picture([[1.0, 2.0], [0.0, 4.0]])
    target = picture([[1.0, 4.0], [9.0, 1.0]])
    mask = picture([[1.0, 1.0], [0.0, 1.0]])
    # differences 0, -2, (not seen), 3 over three pixels
    assert visible_mse(warped, target, mask).item() == pytest.approx((0 + 4 + 9) / 3)


def test_visible_mse_counts_pixels_not_batch_size():
    warped, target = torch.full((1, 3, 4, 4), 0.5), torch.full((1, 3, 4, 4), 0.25)
    once = visible_mse(warped, target, torch.ones(1, 1, 4, 4))
    thrice = visible_mse(*(t.repeat(3, 1, 1, 1) for t in (warped, target)), torch.ones(3, 1, 4, 4))
    assert once.item() == thrice.item() == pytest.approx(0.0625)


def test_nothing_seen_costs_nothing():
    zero = torch.zeros(1, 1, 4, 4)
    assert visible_mse(zero, torch.rand(1, 1, 4, 4), zero).item() == 0


def test_sobel_of_ramps_by_hand():
    col = torch.arange(5.0)[None, None, None].expand(1, 1, 5, 5)
    both = sobel(3 * col + 2 * col.mT)[0]
    # 1 + 2 + 1 = 4 times a difference over two pixels
    torch.testing.assert_close(both[0, :, 1:-1], torch.full((5, 3), 4 * 2 * 3.0))
    torch.testing.assert_close(both[1, 1:-1], torch.full((3, 5), 4 * 2 * 2.0))


def test_sobel_is_that_of_opencv():
    noise = np.random.default_rng(0).standard_normal((9, 7))
    ours = sobel(torch.from_numpy(noise)[None, None])[0].numpy()
    np.testing.assert_allclose(ours[0], cv2.Sobel(noise, cv2.CV_64F, 1, 0), atol=1e-12)
    np.testing.assert_allclose(ours[1], cv2.Sobel(noise, cv2.CV_64F, 0, 1), atol=1e-12)


def test_edge_loss_by_hand():
    flat, step = torch.zeros(1, 1, 5, 6), torch.zeros(1, 1, 5, 6)
    step[..., 3:] = 1.0  # a vertical edge: d_col = 4 in columns 2 and 3, d_row = 0
    everywhere = torch.ones(1, 1, 5, 6)
    by_hand = 2 * 5 * 4**2 / (2 * 5 * 6)  # two columns of five pixels, over all derivatives
    assert edge_loss(step, flat, everywhere).item() == pytest.approx(by_hand)
    everywhere[..., 0] = 0  # column 0 shows nothing: columns 0 and 1 do not count, four columns are left
    assert edge_loss(step, flat, everywhere).item() == pytest.approx(2 * 5 * 4**2 / (2 * 5 * 4))


def test_edge_where_the_warped_picture_ends_is_no_edge():
    scene = torch.ones(1, 1, 8, 8)
    mask = torch.ones(1, 1, 8, 8)
    mask[..., :3] = 0
    assert edge_loss(scene * mask, scene, mask).item() == 0


def test_motion_mse_by_hand():
    zero = torch.zeros(1, 2)
    tx, rz = torch.tensor([[10.0, 0.0]]), torch.tensor([[0.0, 0.3]])
    # (0.1^2 + 0 + 0 + 0.3^2) / 4 values
    assert motion_mse(tx, rz, zero, zero).item() == pytest.approx((0.01 + 0.09) / 4)


@pytest.mark.parametrize("loss", [visible_mse, edge_loss])
def test_gradients(loss):
    dice = torch.Generator().manual_seed(1)
    warped, target = (torch.rand(2, 3, 5, 6, dtype=torch.float64, generator=dice) for _ in range(2))
    mask = (torch.rand(2, 1, 5, 6, generator=dice) < 0.9).double()
    assert torch.autograd.gradcheck(lambda w: loss(w * mask, target, mask), warped.requires_grad_())


def test_motion_gradients():
    values = [torch.rand(2, 5, dtype=torch.float64) for _ in range(4)]
    assert torch.autograd.gradcheck(motion_mse, [v.requires_grad_() for v in values])


def test_motion_distance_by_hand():
    zero = torch.zeros(1, 2)
    found = motion_distance(torch.tensor([[3.0, 0.0]]), torch.tensor([[0.04, 0.1]]), zero, zero)
    assert found.item() == pytest.approx((0.05 + 0.1) / 2, rel=1e-4)
