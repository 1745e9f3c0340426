"""The paper's system: its blocks and its losses."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")
nn = torch.nn

from support.small_kandula2020 import DATA, NETWORK, PICTURE_LOSSES
from unshutter.errors import UsageError
from unshutter.motion import RowMotion
from unshutter_lab.training.config import from_table
from unshutter_lab.training.kandula2020 import (
    Kandula2020,
    Kandula2020Config,
    Trajectory,
    rectified_so_far,
    rectify,
    regenerate,
)
from unshutter_lab.training.kandula2020_losses import LossConfig, picture_losses
from unshutter_lab.training.pixels import PixelConfig, PixelData, from_first_row, rs_positions

torch.set_num_threads(1)
CPU = torch.device("cpu")
SMALL = Kandula2020Config(**NETWORK)


def small_samples(count: int = 4):
    config = PixelConfig(**DATA)
    return PixelData(config, CPU).batch(count, torch.Generator().manual_seed(0))


def small_motion(count: int = 2, seed: int = 0) -> torch.Tensor:
    """[count, 2, 64] cubics of a few px and degrees, zero at the first row."""
    c = 2 * torch.rand(count, 2, 3, generator=torch.Generator().manual_seed(seed)) - 1
    u = torch.arange(64) / 63
    values = torch.einsum("bmk,kr->bmr", c, torch.stack([u, u**2, u**3]))
    return values * torch.tensor([3.0, 0.05])[:, None]


# ---- blocks -----------------------------------------------------------------------------------------------


def layers(block: nn.Module, kind: type) -> int:
    return sum(isinstance(m, kind) for m in block.modules())


def test_layers_are_those_of_the_paper():
    network = Kandula2020(Kandula2020Config())
    motion = network.motion_block
    assert layers(motion.base, nn.Conv2d) == layers(motion.base, nn.BatchNorm2d) == 3
    for branch in (motion.tx, motion.rz):
        assert layers(branch, nn.Conv2d) == layers(branch, nn.BatchNorm2d) == 3
        fully_connected = [m for m in branch.modules() if isinstance(m, nn.Linear)]
        assert len(fully_connected) == 2 and fully_connected[-1].out_features == 256
    assert layers(network.row_block, nn.Conv2d) == 5
    assert layers(Kandula2020(Kandula2020Config(row_layers=3)).row_block, nn.Conv2d) == 3
    assert sum(w.numel() for w in network.parameters()) * 4 < 20e6  # exported at most 20 MB


def test_shapes_and_the_row_map_before_training():
    network = Kandula2020(SMALL)
    motion, row_map = network(torch.rand(2, 3, 64, 64))
    assert motion.shape == (2, 2, 64)
    expected = torch.arange(64.0)[:, None].expand(2, 64, 64)
    assert torch.equal(row_map, expected)  # A(i, j) = i
    assert network(torch.rand(2, 3, 64, 64), rows=False)[1] is None


@pytest.mark.parametrize(
    "change", [{"size": 100}, {"late_width": "wide"}, {"row_input": "both"}, {"row_layers": 1}, {"first_stride": 3}]
)
def test_impossible_networks_are_refused(change):
    with pytest.raises(UsageError):
        from_table(Kandula2020Config, change, "[network]")


def test_the_mirror_average_answers_to_mirror_images_alike():
    torch.manual_seed(0)
    network = Kandula2020(Kandula2020Config(**NETWORK, mirror_average=True, row_input="trajectory")).eval()
    nn.init.normal_(network.row_block.layers[-1].weight, std=0.1)
    rs = torch.rand(3, 3, 64, 64)
    with torch.no_grad():
        (motion, row_map), (other, other_map) = network(rs), network(rs.flip(-1))
        once = Kandula2020(Kandula2020Config(**NETWORK, row_input="trajectory")).eval()
        once.load_state_dict(network.state_dict())
        first, second = once(rs)[0], once(rs.flip(-1))[0]
    torch.testing.assert_close(other, -motion)
    torch.testing.assert_close(other_map, row_map.flip(-1))
    torch.testing.assert_close(motion, (first - second) / 2)


def test_a_second_look_sees_the_rectified_picture_and_counts_where_it_finds_less():
    network = Kandula2020(Kandula2020Config(**NETWORK, looks=2)).eval()
    rs, first = torch.rand(2, 3, 64, 64), small_motion()
    more = first * torch.tensor([0.4, 0.6])[:, None, None]
    seen = []

    def one_look(pictures, mirrored=False):
        seen.append(pictures)
        return more if len(seen) == 2 else first

    network.one_look = one_look
    with torch.no_grad():
        motion = network(rs)[0]
    torch.testing.assert_close(motion[0], first[0] + more[0])
    torch.testing.assert_close(motion[1], first[1])  # 0.6 of the first is too much
    torch.testing.assert_close(seen[1], rectified_so_far(rs, first))


def test_trajectory_is_the_least_squares_cubic():
    noise = torch.randn(3, 2, 40, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    module = Trajectory(40, 3).double()
    fitted = module(noise)
    rows = np.arange(40)
    expected = np.polynomial.Polynomial.fit(rows, noise[1, 0].numpy(), 3)(rows)
    np.testing.assert_allclose(fitted[1, 0].numpy(), expected, atol=1e-5)
    torch.testing.assert_close(module(fitted), fitted, atol=1e-5, rtol=0)
    assert not list(module.parameters())
    assert torch.autograd.gradcheck(module, noise.requires_grad_())


def test_exact_inverse_is_that_of_motion():
    motion = small_motion()
    x, y = rs_positions(motion, None)
    row, col = np.mgrid[0:64, 0:64].astype(float)
    for i in range(2):
        expected = RowMotion(64, *motion[i].double().numpy()).gs_to_rs(col, row)
        seen = (expected[1] >= 0) & (expected[1] <= 63)  # beyond, the two carry the motion on differently
        np.testing.assert_allclose(x[i][seen], expected[0][seen], atol=2e-4)
        np.testing.assert_allclose(y[i][seen], expected[1][seen], atol=2e-4)


def test_row_map_of_the_true_rows_is_the_exact_inverse():
    motion = small_motion()
    x, y = rs_positions(motion, None)
    by_map = rs_positions(motion, y)
    torch.testing.assert_close(by_map[0], x, atol=1e-3, rtol=0)
    torch.testing.assert_close(by_map[1], y, atol=1e-3, rtol=0)


def test_row_map_chooses_the_motion():
    motion = torch.zeros(1, 2, 64)
    motion[0, 0] = torch.arange(64.0) ** 2 / 100
    x, y = rs_positions(motion, torch.full((1, 64, 64), 10.5))
    col = torch.arange(64.0).expand(64, 64)
    torch.testing.assert_close(x[0] - col, torch.full((64, 64), (1.0 + 1.21) / 2))  # between rows 10 and 11
    torch.testing.assert_close(y[0], col.mT)


def test_from_first_row_is_rereferenced():
    motion = small_motion(1) + torch.tensor([4.0, 0.03])[:, None]
    relative, shift = from_first_row(motion)
    expected = RowMotion(64, *motion[0].double().numpy()).rereferenced("first")
    np.testing.assert_allclose(relative[0, 0], expected.tx_px, atol=1e-5)
    np.testing.assert_allclose(relative[0, 1], expected.rz_rad, atol=1e-6)
    assert shift.item() == pytest.approx(expected.center_shift_px)
    row, col = np.mgrid[0:64, 0:64].astype(float)
    expected_col, expected_row = expected.gs_to_rs(col, row)
    seen = (expected_row >= 0) & (expected_row <= 63)
    found_col = rs_positions(relative, None, shift)[0][0].numpy()
    np.testing.assert_allclose(found_col[seen], expected_col[seen], atol=1e-3)


def test_regeneration_by_the_true_motion_gives_the_rs_picture():
    samples = small_samples()
    picture, mask = regenerate(samples.gs, torch.stack(samples.row_motion(), 1))
    assert mask.mean() > 0.7
    assert ((picture - samples.rs) * mask).abs().max() < 1e-3


def test_rectification_by_the_true_motion_gives_the_gs_picture():
    samples = small_samples(8)
    motion = torch.stack(samples.row_motion(), 1)
    picture, mask = rectify(samples.rs, samples.rs_valid, motion, None)
    error = (((picture - samples.gs) * mask) ** 2).sum((1, 2, 3))
    before = (((samples.rs - samples.gs) * mask) ** 2).sum((1, 2, 3))
    moved = motion.abs().amax((1, 2)) > 1
    assert moved.sum() >= 4
    assert (error[moved] < 0.4 * before[moved]).all()  # what remains is the grain that two samplings smooth


def test_rectification_gradients_flow_through_motion_and_row_map():
    size = 8
    dice = torch.Generator().manual_seed(3)
    rs = torch.rand(1, 1, size, size, dtype=torch.float64, generator=dice)
    motion = torch.rand(1, 2, size, dtype=torch.float64, generator=dice) * 0.2 + 0.05
    row_map = torch.rand(1, size, size, dtype=torch.float64, generator=dice) * 6 + 0.3
    valid = torch.ones_like(rs)
    inputs = [motion.requires_grad_(), row_map.requires_grad_()]
    assert torch.autograd.gradcheck(lambda m, v: rectify(rs, valid, m, v)[0], inputs, eps=1e-7, atol=1e-5)
    assert torch.autograd.gradcheck(lambda m: regenerate(rs, m)[0], inputs[:1], eps=1e-7, atol=1e-5)


# ---- losses -----------------------------------------------------------------------------------------------


def test_losses_are_least_at_the_truth():
    samples = small_samples(8)
    motion = torch.stack(samples.row_motion(), 1)
    truth = picture_losses(samples, motion, None, LossConfig())
    nothing = picture_losses(samples, torch.zeros_like(motion), None, LossConfig())
    assert tuple(sorted(truth)) == tuple(sorted(PICTURE_LOSSES))
    assert all(truth[name] < 0.5 * nothing[name] for name in ("rectified", "regenerated"))
    assert all(truth[name] < nothing[name] for name in PICTURE_LOSSES)


def test_losses_of_parts_are_nearly_those_of_the_whole():
    samples = small_samples(8)
    motion = 0.7 * torch.stack(samples.row_motion(), 1)
    whole = picture_losses(samples, motion, None, LossConfig())
    parts = picture_losses(samples, motion, None, LossConfig(at_a_time=3))
    by_hand = [picture_losses(samples[a:b], motion[a:b], None, LossConfig()) for a, b in ((0, 3), (3, 6), (6, 8))]
    for name, value in parts.items():
        expected = sum(w * p[name] for w, p in zip((3 / 8, 3 / 8, 2 / 8), by_hand, strict=True))
        torch.testing.assert_close(value, expected)
        assert value.item() == pytest.approx(whole[name].item(), rel=0.1)  # their valid pixels differ in number


def test_a_black_pixel_of_the_scene_is_valid():
    samples = small_samples(1)
    half = torch.ones(64)
    half[:32] = 0
    rs = (0.1 + 0.9 * samples.rs) * half
    samples = replace(samples, rs=rs, gs=torch.full_like(rs, 0.5), rs_valid=torch.ones(1, 1, 64, 64))
    still = torch.zeros(1, 2, 64)
    losses = picture_losses(samples, still, None, LossConfig())
    # the pictures differ by 0.5 in the black half
    right = ((samples.rs[..., 32:] - 0.5) ** 2).mean().item()
    assert losses["rectified"].item() == pytest.approx((right + 0.25) / 2, rel=1e-4)


def test_all_blocks_learn_from_the_pictures():
    torch.manual_seed(0)
    network, samples = Kandula2020(SMALL), small_samples()
    before = {name: w.clone() for name, w in network.named_parameters()}
    optimiser = torch.optim.Adam(network.parameters(), 1e-3)
    for _ in range(2):  # the row block's last layer starts at zero and lets gradients pass from the second step
        losses = picture_losses(samples, *network(samples.rs), LossConfig())
        optimiser.zero_grad()
        torch.stack(list(losses.values())).sum().backward()
        optimiser.step()
    assert not [name for name, w in network.named_parameters() if torch.equal(w, before[name])]


def test_it_can_learn_a_few_pictures_by_heart():
    torch.manual_seed(0)
    network, samples = Kandula2020(SMALL), small_samples()
    true = torch.stack(samples.row_motion(), 1)
    optimiser = torch.optim.Adam(network.parameters(), 3e-3)

    def error() -> torch.Tensor:
        return ((network(samples.rs, rows=False)[0] - true) / torch.tensor([10.0, 0.1])[:, None]).square().mean()

    first = error().item()
    for _ in range(60):
        optimiser.zero_grad()
        error().backward()
        optimiser.step()
    assert error().item() < 0.2 * first
