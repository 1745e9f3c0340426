import math
from dataclasses import replace

import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from unshutter.errors import UsageError
from unshutter.single.network import undo_motion
from unshutter_lab.training.motions import draw_motions
from unshutter_lab.training.scenes import SceneConfig, draw_scenes


def scenes(batch: int = 64, seed: int = 0, **changes):
    return draw_scenes(batch, replace(SceneConfig(), **changes), torch.Generator().manual_seed(seed))


def lean(ends: torch.Tensor) -> torch.Tensor:
    """Angle from the vertical [deg], of segments [N, 4]."""
    dx, dy = ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1]
    return torch.rad2deg(torch.atan(dx / dy))


def test_the_same_seed_draws_the_same_scenes() -> None:
    one, two, other = scenes(), scenes(), scenes(seed=1)
    assert torch.equal(one.tokens, two.tokens)
    assert torch.equal(one.mask, two.mask)
    assert not torch.equal(one.tokens, other.tokens)


def test_segments_lie_in_the_frame_and_aspects_in_their_range() -> None:
    drawn = scenes(256)
    half_width = (drawn.aspect / 2)[:, None]
    x, y = drawn.tokens[..., 0:4:2], drawn.tokens[..., 1:4:2]
    assert (y.abs().amax(-1)[drawn.mask] <= 0.5).all()
    assert (x.abs().amax(-1) <= half_width)[drawn.mask].all()
    assert 1 / 2.4 <= drawn.aspect.min() < 0.6
    assert 1.7 < drawn.aspect.max() <= 2.4
    assert 0.3 < (drawn.aspect == 1).float().mean() < 0.5
    assert drawn.mask.any(1).all()


def test_motions_have_the_predecessors_range() -> None:
    """Medians and 95th percentiles over the draws that move at all; bounds worked out from the formula."""
    tx, rz = draw_motions(20000, torch.Generator().manual_seed(0))
    u = torch.linspace(0, 1, 256)
    powers = torch.stack([u, u**2, u**3])
    most_tx = (tx @ powers).abs().amax(1) * 256
    most_rz = torch.rad2deg((rz @ powers).abs().amax(1))
    assert (most_tx == 0).float().mean() == pytest.approx(1 / 6, abs=0.01)
    assert (most_rz == 0).float().mean() == pytest.approx(1 / 6, abs=0.01)
    a, b = 306 / 356, 50 / 356
    assert most_tx.max() <= 3 * 25 * (a**2 - b**2) + 6 * 5 * (a - b) + 1e-3
    assert most_rz.max() <= math.degrees(0.4 * math.pi / 8 * ((a**2 - b**2) + (a - b))) + 1e-3
    moving = most_tx[most_tx > 0]
    assert moving.median() == pytest.approx(26.9, abs=1.0)
    assert moving.quantile(0.95) == pytest.approx(59.8, abs=1.0)


def test_shares_of_still_pictures() -> None:
    still = scenes(600, zero_motion=0.5)
    assert ((still.tx == 0) & (still.rz == 0)).all(1).float().mean() == pytest.approx(0.5, abs=0.08)
    assert (scenes(50, zero_motion=1.0).tx == 0).all()


def test_undoing_the_true_motion_straightens_the_verticals() -> None:
    drawn = scenes(200, zero_motion=0, small_motion=0, sideways=0, clutter_max=0.0, tokens=200, drawn=500)
    ends = undo_motion(drawn.tokens, torch.stack([drawn.tx, drawn.rz], 1))
    straightened = ends.permute(0, 2, 3, 1).flatten(2)  # x1, y1, x2, y2
    better = total = 0
    for i in range(200):
        upright = drawn.camera[i, 1].abs() < math.radians(5)  # hardly converging
        if not upright or drawn.tx[i].sum().abs() < 0.1:
            continue
        after = lean(straightened[i][drawn.mask[i]])
        near = after.abs() < 25
        before = lean(drawn.tokens[i, :, :4][drawn.mask[i]])
        total += 1
        better += (after[near].abs().median() < before[near].abs().median()).item()
    assert total > 30
    assert better / total > 0.9


def test_up_is_given_for_scenes_on_their_side() -> None:
    drawn = scenes(100, sideways=1.0, clutter_max=0.0, zero_motion=1.0)
    up = drawn.tokens[:, 0, 4:]
    assert (up[:, 0].abs() == 1).all()
    assert (up[:, 1] == 0).all()
    assert {-1.0, 1.0} == set(up[:, 0].tolist())


def test_hands_and_pans_move_scenes_in_their_shares() -> None:
    drawn = scenes(2000, tokens=4, drawn=8, zero_motion=0.5, motions={"hand": 0.3, "pan": 0.2})
    cubic = drawn.tx[:, 2] != 0  # quadratics have no third power
    still = ((drawn.tx == 0) & (drawn.rz == 0)).all(1)
    assert cubic.float().mean().item() == pytest.approx(0.5, abs=0.04)
    assert still.float().mean().item() == pytest.approx(0.25, abs=0.04)
    with pytest.raises(UsageError, match=r"\[data.motions\]: unknown setting 'shake'"):
        scenes(2, motions={"shake": 0.3})


@pytest.mark.parametrize(("shares", "lowest", "highest"), [((1.0, 0.0), -6, 25), ((0.0, 1.0), 15, 50)])
def test_shares_of_tilted_and_steep_cameras(shares: tuple[float, float], lowest: float, highest: float) -> None:
    tilts = torch.rad2deg(scenes(400, tokens=4, drawn=8, tilted=shares[0], steep=shares[1]).camera[:, 1])
    assert lowest <= tilts.min() < lowest + 3
    assert highest - 3 < tilts.max() <= highest
