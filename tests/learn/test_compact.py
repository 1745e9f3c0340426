"""Networks made small: what is left out is what does not count, and files hold the same network in fewer bits."""

from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch
from torch import nn

from unshutter.errors import UsageError
from unshutter.estimators.register import METHODS
from unshutter.learn.compact import compact, narrow
from unshutter.learn.onnx_export import export_onnx, store_small
from unshutter.learn.train import run

torch.set_num_threads(1)

SMALL = """
model = "kandula2020"
steps = 2
batch = 2
[network]
size = 64
width = 4
hidden = 32
row_width = 4
[data]
size = 64
canvas = 88
drawn = 5
held_out = 2
validation_motions = 1
"""


def network_of_rank(rank: int) -> nn.Sequential:
    """Its wide layer answers in so many directions, about a mean that is none of them."""
    torch.manual_seed(0)
    wide = nn.Linear(40, 60)
    with torch.no_grad():
        wide.weight.copy_(torch.randn(60, rank) @ torch.randn(rank, 40))
        wide.bias.normal_()
    return nn.Sequential(nn.Linear(7, 40), nn.Tanh(), wide, nn.Tanh(), nn.Linear(60, 3)).eval()


@pytest.mark.parametrize(("rank", "same"), [(5, True), (2, False)])
def test_directions_that_no_answer_takes_are_left_out(rank: int, same: bool) -> None:
    network, given = network_of_rank(5), torch.randn(4, 50, 7)
    before = network(given[0])
    narrow(network, iter(given), rank)
    assert [tuple(layer.weight.shape) for layer in network[2]] == [(rank, 40), (60, rank)]
    assert isinstance(network[0], nn.Linear)  # not wide: 7 is below four times either rank
    new = torch.randn(30, 7)
    assert torch.allclose(network(given[0]), before, atol=1e-4) == same
    assert torch.allclose(network(new), network_of_rank(5)(new), atol=1e-4) == same


@pytest.mark.parametrize(("eight_bits", "share", "off"), [(False, 0.6, 2e-3), (True, 0.4, 2e-2)])
def test_a_file_holds_the_same_network_in_fewer_bits(
    eight_bits: bool, share: float, off: float, tmp_path: Path
) -> None:
    torch.manual_seed(0)
    network = nn.Sequential(nn.Conv2d(3, 32, 5), nn.ReLU(), nn.Conv2d(32, 8, 5), nn.Flatten(), nn.Linear(512, 4)).eval()
    given = torch.rand(2, 3, 16, 16)
    path = tmp_path / "network.onnx"
    export_onnx(network, (given,), path, ["rs"], ["answer"], {"rs": {0: "batch"}})
    size = path.stat().st_size
    store_small(path, eight_bits)
    assert path.stat().st_size < share * size
    answer = onnxruntime.InferenceSession(path).run(None, {"rs": given.numpy()})[0]
    expected = network(given).detach().numpy()
    assert 0 < np.abs(answer - expected).max() < off * np.abs(expected).max()


def test_a_run_becomes_a_small_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "small.toml"
    config.write_text(SMALL)
    folder = run(config, tmp_path / "runs")
    compact(config, folder, None, rank=8, eight_bits=True, target=tmp_path / "compact.onnx")
    assert (tmp_path / "compact.onnx").stat().st_size < 0.7 * (folder / "model.onnx").stat().st_size
    told = capsys.readouterr().out
    assert "before: {'val_epe_median'" in told and "after: {'val_epe_median'" in told
    given = {"rs": np.random.default_rng(0).random((1, 3, 64, 64), np.float32)}
    whole, small = (
        onnxruntime.InferenceSession(path).run(["motion"], given)[0]
        for path in (folder / "model.onnx", tmp_path / "compact.onnx")
    )
    np.testing.assert_allclose(small, whole, atol=0.05 * np.abs(whole).max())


@pytest.mark.parametrize(
    ("change", "rank", "told"),
    [
        ("", 0, "not a checkpoint"),
        ("width = 8", 0, "of another network"),
        ("", 512, "--rank must lie between 0 and 511"),
    ],
)
def test_what_cannot_be_made_small_is_refused(change: str, rank: int, told: str, tmp_path: Path) -> None:
    config = tmp_path / "small.toml"
    config.write_text(SMALL)
    folder = run(config, tmp_path / "runs") if change else tmp_path
    config.write_text(SMALL.replace("width = 4", change or "width = 4", 1))
    with pytest.raises(UsageError, match=told):
        compact(config, folder, None, rank, False, tmp_path / "none.onnx")
    assert not (tmp_path / "none.onnx").exists()


def test_what_ships_is_small() -> None:
    files = {known.weights_path for known in METHODS if known.weights_path}
    assert len(files) == 4
    assert sum(path.stat().st_size for path in files) < 9e6
