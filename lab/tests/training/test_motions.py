"""Random motions of all kinds."""

import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from unshutter.errors import UsageError
from unshutter_lab.training.motions import MotionConfig, draw_kind, draw_mixture, draw_motions


def dice(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_without_shares_all_are_quadratics():
    for ours, theirs in zip(draw_mixture(8, dice(), MotionConfig()), draw_motions(8, dice()), strict=True):
        assert torch.equal(ours, theirs)


def test_kinds_come_in_their_shares():
    tx, rz = draw_mixture(8000, dice(), MotionConfig(hand=0.3, pan=0.2))
    cubic = (tx[:, 2] != 0).float().mean().item()  # quadratics have no third power
    assert cubic == pytest.approx(0.5, abs=0.02)
    turning = rz[tx[:, 2] != 0, 0].abs()
    assert (turning > 0.012).float().mean().item() == pytest.approx(0.6 * 0.55, abs=0.05)  # three fifths are hands


@pytest.mark.parametrize(("kind", "tx_width", "rz_width"), [("hand", 0.05, 0.02), ("pan", 0.06, 0.004)])
def test_widths_of_hands_and_pans(kind, tx_width, rz_width):
    tx, rz = draw_kind(kind, 4000, dice())
    assert tx[:, 0].std().item() == pytest.approx(tx_width, rel=0.05)
    assert rz[:, 0].std().item() == pytest.approx(rz_width, rel=0.05)
    assert (tx.std(0).diff() < 0).all() and (rz.std(0).diff() < 0).all()  # even more than uneven


def test_bad_shares():
    with pytest.raises(UsageError, match="more than 1"):
        MotionConfig(hand=0.7, pan=0.5)
    with pytest.raises(UsageError, match="negative"):
        MotionConfig(hand=-0.1)
