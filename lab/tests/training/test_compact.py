"""Networks made small: what is left out is what does not count, and files hold the same network in fewer bits."""

import tempfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")
nn = torch.nn

from unshutter.errors import UsageError
from unshutter.single.register import method, names
from unshutter_lab.training.compact import compact, narrow, store_in_fewer_bits
from unshutter_lab.training.train import run
from unshutter_lab.training.weights import export_onnx

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
looks = 2
[data]
size = 64
canvas = 88
drawn = 5
held_out = 2
validation_motions = 1
"""


def exported(network: nn.Sequential, given: torch.Tensor) -> onnx.ModelProto:
    with tempfile.TemporaryDirectory() as folder:
        export_onnx(network.eval(), given, Path(folder, "model.onnx"), ["answer"])
        return onnx.load(Path(folder, "model.onnx"))


def answer_of(model: onnx.ModelProto, given: torch.Tensor) -> np.ndarray:
    onnx.checker.check_model(model)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return np.asarray(session.run(None, {"rs": given.numpy()})[0])


@pytest.mark.parametrize(("rank", "same"), [(5, True), (2, False)])
def test_directions_that_no_output_takes_are_left_out(rank: int, same: bool) -> None:
    torch.manual_seed(0)
    wide = nn.Linear(40, 60)  # its outputs vary in five directions, about a mean that is none of them
    with torch.no_grad():
        wide.weight.copy_(torch.randn(60, 5) @ torch.randn(5, 40))
        wide.bias.normal_()
    network, given = (
        nn.Sequential(nn.Linear(7, 40), nn.Tanh(), wide, nn.Tanh(), nn.Linear(60, 3)),
        torch.randn(4, 50, 7),
    )
    model, new = exported(network, given[0]), torch.randn(30, 7)
    before = answer_of(model, new)
    narrow(model, (batch.numpy() for batch in given), rank)
    shapes = sorted(tuple(weights.dims) for weights in model.graph.initializer if len(weights.dims) == 2)
    assert shapes == sorted([(40, 7), (rank, 40), (60, rank), (3, 60)])  # 7 is below four times either rank
    assert np.allclose(answer_of(model, new), before, atol=1e-4) == same


@pytest.mark.parametrize(("eight_bits", "share", "off"), [(False, 0.6, 2e-3), (True, 0.4, 2e-2)])
def test_a_file_holds_the_same_network_in_fewer_bits(eight_bits: bool, share: float, off: float) -> None:
    torch.manual_seed(0)
    network = nn.Sequential(nn.Conv2d(3, 32, 5), nn.ReLU(), nn.Conv2d(32, 8, 5), nn.Flatten(), nn.Linear(512, 4))
    given = torch.rand(2, 3, 16, 16)
    model = exported(network, given)
    size, before = model.ByteSize(), answer_of(model, given)
    store_in_fewer_bits(model, eight_bits)
    assert model.ByteSize() < share * size
    assert 0 < np.abs(answer_of(model, given) - before).max() < off * np.abs(before).max()


def test_weights_beyond_16_bits_stay_as_they_are() -> None:
    network, given = nn.Sequential(nn.Linear(20, 20)), torch.rand(2, 20)
    with torch.no_grad():
        network[0].weight[0, 0] = 1e5
    model = exported(network, given)
    before = answer_of(model, given)
    store_in_fewer_bits(model)
    np.testing.assert_array_equal(answer_of(model, given), before)


ONE_PICTURE = SMALL.replace("row_width = 4\nlooks = 2", "row_layers = 0\nshown = 64")  # as the shipped one is exported


@pytest.mark.thorough
@pytest.mark.parametrize("text", [SMALL, ONE_PICTURE], ids=["any batch", "one picture"])
def test_a_run_becomes_a_small_file(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "small.toml"
    config.write_text(text)
    folder = run(config, tmp_path / "runs")
    compact(folder / "model.onnx", config, None, rank=8, eight_bits=True, target=tmp_path / "compact.onnx")
    assert (tmp_path / "compact.onnx").stat().st_size < 0.7 * (folder / "model.onnx").stat().st_size
    told = capsys.readouterr().out
    assert "before: {'val_epe_median'" in told and "after: {'val_epe_median'" in told
    given = {"rs": np.random.default_rng(0).random((1, 3, 64, 64), np.float32)}
    whole, small = (
        onnxruntime.InferenceSession(path).run(["motion"], given)[0]
        for path in (folder / "model.onnx", tmp_path / "compact.onnx")
    )
    np.testing.assert_allclose(small, whole, atol=0.05 * np.abs(whole).max())
    config.write_text(text.replace("= 64", "= 128").replace("= 88", "= 152"))
    with pytest.raises(UsageError, match=r"reads pictures of 64 px, the configuration trains on 128 px"):
        compact(folder / "model.onnx", config, None, 8, False, tmp_path / "other.onnx")


@pytest.mark.parametrize(
    ("name", "rank", "told"),
    [
        ("kandula2020", 8, "no such file"),
        ("kandula2020", 512, "--rank must lie between 0 and 511"),
        ("segment-transformer", 8, "segment-transformer does not read pixels"),
    ],
)
def test_what_cannot_be_made_small_is_refused(name: str, rank: int, told: str, tmp_path: Path) -> None:
    config = tmp_path / "small.toml"
    config.write_text(SMALL if name == "kandula2020" else f'model = "{name}"\n')
    with pytest.raises(UsageError, match=told):
        compact(tmp_path / "none.onnx", config, None, rank, False, tmp_path / "small.onnx")
    assert not (tmp_path / "small.onnx").exists()


def test_a_file_that_holds_no_network_is_refused(tmp_path: Path) -> None:
    config, text = tmp_path / "small.toml", tmp_path / "text.onnx"
    config.write_text(SMALL)
    text.write_text("no network")
    with pytest.raises(UsageError, match=r"text\.onnx contains no network"):
        compact(text, config, None, 0, False, tmp_path / "small.onnx")
    assert not (tmp_path / "small.onnx").exists()


def test_what_ships_is_small() -> None:
    files = {known.weights for name in names() if (known := method(name)).weights}
    assert len(files) == 5
    assert sum(path.stat().st_size for path in files) < 13e6
