"""The predecessor's networks, their key rows, their training."""

import csv

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")
nn = torch.nn

from unshutter.errors import UsageError
from unshutter.photo import Photo
from unshutter.single.estimator import View
from unshutter.single.register import load
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.rengarajan2017 import KEY_ROWS, Rengarajan2017Config, RengarajanRecipe, build, quadratic
from unshutter_lab.training.train import run

torch.set_num_threads(1)
CPU = torch.device("cpu")
DATA = {"drawn": 3, "held_out": 1, "validation_motions": 1}


def make(**about) -> nn.Module:
    with torch.device("meta"):  # sizes only: RowColCNN is large
        return build(Rengarajan2017Config(**about))


@pytest.mark.parametrize("kind", ["vanilla", "rowcol"])
@pytest.mark.parametrize("batch_norm", [False, True])
def test_sizes_are_those_of_the_program(kind, batch_norm):
    network = make(network=kind, batch_norm=batch_norm)
    out = network(torch.empty(2, 3, 256, 256, device="meta"))  # fails where a layer does not fit
    assert out.shape == (2, 2, 15)
    norms = sum(isinstance(m, nn.BatchNorm2d) for m in network.modules())
    assert norms == (0 if not batch_norm else {"vanilla": 4, "rowcol": 2 + 2 * 3}[kind])
    weights = sum(w.numel() for w in network.parameters())
    assert weights == pytest.approx({"vanilla": 9.97e6, "rowcol": 62.6e6}[kind], rel=0.02)


def test_banks_look_along_columns_and_rows():
    network = make(network="rowcol")
    kernels = [[m.kernel_size for m in bank if isinstance(m, nn.Conv2d)] for bank in (network.rows, network.columns)]
    assert kernels == [[(64, 3), (36, 3), (19, 3)], [(3, 64), (3, 36), (3, 19)]]


def test_key_rows():
    assert [row + 1 for row in KEY_ROWS] == [1, 19, 37, 55, 73, 91, 109, 127, 145, 163, 181, 199, 217, 235, 253]


def test_outputs_are_in_units_of_100_px_and_radians():
    network = build(Rengarajan2017Config())
    last = network.head[-1]
    nn.init.zeros_(last.weight)
    with torch.no_grad():
        last.bias.copy_(torch.arange(30.0) / 100)
    out = network.eval()(torch.rand(1, 3, 256, 256))
    torch.testing.assert_close(out[0, 0], torch.arange(15.0))  # px
    torch.testing.assert_close(out[0, 1], torch.arange(15.0, 30.0) / 100)


def test_the_mean_picture_is_subtracted():
    network = build(Rengarajan2017Config(batch_norm=False)).eval()
    seen = []
    network.features.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    network.mean.copy_(torch.rand(3, 256, 256))
    network(network.mean[None])
    assert not seen[0].any()


def test_quadratic_through_the_key_rows():
    rows = np.arange(256)
    true = np.stack([3 - 0.1 * rows + 0.0007 * rows**2, 0.01 + 1e-4 * rows - 3e-7 * rows**2])
    keys = torch.from_numpy(true[None, :, list(KEY_ROWS)])
    np.testing.assert_allclose(quadratic(keys)[0], true, atol=1e-9)
    noise = np.random.default_rng(0).standard_normal((1, 2, 15))
    fit = np.polynomial.Polynomial.fit(KEY_ROWS, noise[0, 1], 2)(rows)
    np.testing.assert_allclose(quadratic(torch.from_numpy(noise))[0, 1], fit, atol=1e-9)


@pytest.mark.thorough
def test_training_and_export(tmp_path):
    import onnxruntime

    config = tmp_path / "vanilla.toml"
    config.write_text(
        'model = "rengarajan2017"\nsteps = 2\nbatch = 2\noptimiser = "sgd"\nlearning_rate = 0.5\nweight_decay = 1e-4\n'
        'schedule = "stairs"\nstair = 1\nlog_every = 1\naverage = 0.0\n'
        "[data]\ndrawn = 3\nheld_out = 1\nvalidation_motions = 1\n"
    )
    folder = run(config, tmp_path, device="cpu")
    (first, last) = csv.DictReader((folder / "log.csv").read_text().splitlines())
    assert float(first["loss"]) > 0 and float(last["val_epe_nothing"]) > 0 and float(last["val_epe_median"]) > 0
    state = torch.load(folder / "checkpoint.pt", weights_only=True)["network"]
    assert 0.05 < state["mean"].mean() < 0.95 and state["mean"].std() > 0.005
    network = build(Rengarajan2017Config())
    network.load_state_dict(state)
    rs = torch.rand(2, 3, 256, 256)
    session = onnxruntime.InferenceSession(str(folder / "model.onnx"), providers=["CPUExecutionProvider"])
    (theirs,) = session.run(["key_rows"], {"rs": rs.numpy()})
    with torch.no_grad():
        ours = network.eval()(rs)
    np.testing.assert_allclose(theirs, ours.numpy(), atol=1e-3)  # px

    pixels = (rs[0].permute(1, 2, 0).numpy() * 65535).round().astype(np.uint16)
    found = load(f"rengarajan2017@{folder / 'model.onnx'}").estimate(View(Photo.from_array(pixels)))
    expected = quadratic(ours)[0].numpy()
    np.testing.assert_allclose(found.tx_px, expected[0] - expected[0, 0], atol=0.01)
    np.testing.assert_allclose(found.rz_rad, expected[1] - expected[1, 0], atol=1e-4)


def test_rowcol_takes_a_step():
    network = {"network": "rowcol", "bank_units": 16}
    recipe = RengarajanRecipe(TrainConfig("rengarajan2017", batch=2, network=network, data=DATA), CPU)
    torch.manual_seed(0)
    net = recipe.build()
    loss, _ = recipe.loss(net, 0, torch.Generator().manual_seed(0))
    loss.backward()
    assert all(w.grad is not None and w.grad.any() for w in net.rows.parameters() if w.dim() > 1)


def test_bad_requests():
    with pytest.raises(UsageError, match="vanilla or rowcol"):
        from_table(Rengarajan2017Config, {"network": "plain"}, "[network]")
    with pytest.raises(UsageError, match="256"):
        RengarajanRecipe(TrainConfig("rengarajan2017", data={"size": 128, "canvas": 178}), CPU)
