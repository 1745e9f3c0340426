"""A run that starts from an exported network computes what the network did."""

from dataclasses import replace
from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="training needs torch")
nn = torch.nn

import unshutter_lab
from support.small_kandula2020 import DATA, NETWORK
from unshutter.errors import UsageError
from unshutter_lab.training.compact import Stored, narrow, store_in_fewer_bits
from unshutter_lab.training.config import TrainConfig
from unshutter_lab.training.recipes import make_recipe
from unshutter_lab.training.train import Trainer
from unshutter_lab.training.weights import load_exported

torch.set_num_threads(1)
LARGE = {**DATA, "size": 256, "canvas": 356}  # what the predecessor's networks read
WEIGHTS = Path(unshutter_lab.__file__).parent / "weights"


@pytest.fixture(scope="module")
def recipe():
    return make_recipe(TrainConfig("kandula2020", network=NETWORK, data=DATA), torch.device("cpu"))


@pytest.fixture(scope="module")
def pictures(recipe):
    return recipe.pictures(32, torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def trained(recipe, pictures):
    """A network whose normalisations are not those of the start."""
    torch.manual_seed(0)
    network = recipe.build()
    nn.init.normal_(network.row_block.layers[-1].weight, std=0.1)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.weight, 0.5, 2.0)
            nn.init.normal_(module.bias)
    for _ in range(20):
        network(pictures)
    return network.eval()


@pytest.mark.parametrize("eight_bits", [False, True])
def test_the_network_is_the_same_in_use_and_in_training(recipe, pictures, trained, tmp_path, eight_bits):
    import onnx

    path = tmp_path / "model.onnx"
    recipe.export(trained, path)
    model = onnx.load(path)
    if eight_bits:
        narrow(model, [pictures.numpy()], 4)
    store_in_fewer_bits(model, eight_bits)
    onnx.save(model, path)
    network = recipe.build()
    load_exported(network, path, pictures)
    assert network.training
    with torch.no_grad():
        expected = Stored(path)(pictures)[0]
        in_training, in_use = network(pictures)[0], network.eval()(pictures)[0]
        unit = expected.std(dim=(0, 2))[:, None]
    assert ((in_use - expected) / unit).abs().max() < 0.01
    assert ((in_training - in_use) / unit).abs().max() < 0.1


def test_a_network_with_more_channels_answers_as_the_exported_one_and_learns_with_all(
    recipe, pictures, trained, tmp_path
):
    recipe.export(trained, tmp_path / "model.onnx")
    wide = make_recipe(replace(recipe.config, network=NETWORK | {"late_width": 20, "hidden": 40}), torch.device("cpu"))
    network = wide.build()
    load_exported(network, tmp_path / "model.onnx", pictures)
    motion, row_map = network.eval()(pictures)
    with torch.no_grad():
        expected_motion, expected_map = trained(pictures)
    torch.testing.assert_close(motion, expected_motion, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(row_map, expected_map, rtol=1e-3, atol=1e-2)
    motion.square().mean().backward()
    for name in ("tx", "rz"):
        (*_, hidden, _, last) = getattr(network.motion_block, name)
        narrow = recipe.build().motion_block.tx[-1].in_features
        assert last.weight.grad[:, narrow:].any() and hidden.weight.shape[0] == 40


def test_a_network_that_looks_twice_starts_from_its_file(recipe, pictures, trained, tmp_path):
    import onnx

    twice = make_recipe(replace(recipe.config, network=NETWORK | {"looks": 2}), torch.device("cpu"))
    network, begun = twice.build(), twice.build()
    network.load_state_dict(trained.state_dict())
    twice.export(network.eval(), tmp_path / "model.onnx")
    model = onnx.load(tmp_path / "model.onnx")
    store_in_fewer_bits(model)
    onnx.save(model, tmp_path / "model.onnx")
    load_exported(begun, tmp_path / "model.onnx", pictures)
    with torch.no_grad():
        expected, motion = network(pictures)[0], begun.eval()(pictures)[0]
    assert ((motion - expected) / expected.std(dim=(0, 2))[:, None]).abs().max() < 0.1


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["rowcol", "vanilla"])
def test_the_predecessors_networks_start_from_what_ships(kind):
    """Convolutions with biases, a mean picture, and pairs that were exported as sequences."""
    name = {"rowcol": "rengarajan2017", "vanilla": "rengarajan2017-vanilla"}[kind]
    config = TrainConfig("rengarajan2017", network={"network": kind, "batch_norm": True, "dropout": 0.0}, data=LARGE)
    recipe = make_recipe(config, torch.device("cpu"))
    pictures = recipe.pictures(2, torch.Generator().manual_seed(0))
    network = recipe.build()
    load_exported(network, WEIGHTS / f"{name}.onnx", pictures)
    with torch.no_grad():
        expected, in_use = Stored(WEIGHTS / f"{name}.onnx")(pictures), network.eval()(pictures)
    unit = expected.std(dim=(0, 2))[:, None]
    assert ((in_use - expected) / unit).abs().max() < 0.01


def test_other_files_are_refused(recipe, pictures, tmp_path):
    text = tmp_path / "text.onnx"
    text.write_text("no network")
    with pytest.raises(UsageError, match="cannot start from"):
        load_exported(recipe.build(), text, pictures)
    with pytest.raises(UsageError, match="cannot start from"):
        load_exported(recipe.build(), tmp_path / "missing.onnx", pictures)


def test_another_network_is_refused(recipe, pictures, trained, tmp_path):
    recipe.export(trained, tmp_path / "model.onnx")
    with pytest.raises(UsageError, match="belongs to another network"):
        load_exported(nn.Sequential(nn.Conv2d(3, 1, 1)), tmp_path / "model.onnx", pictures)


def test_a_run_starts_from_an_exported_network(recipe, trained, tmp_path):
    recipe.export(trained, tmp_path / "model.onnx")
    config = replace(recipe.config, steps=1, learning_rate=0.0, warmup=1, optimiser="sgd", weight_decay=0.0)
    trainer = Trainer(config, tmp_path, torch.device("cpu"), tmp_path / "model.onnx")
    for samples in recipe.data.validation():
        with torch.no_grad():
            motion, expected = trainer.network.eval()(samples.rs)[0], trained(samples.rs)[0]
        torch.testing.assert_close(motion, expected, rtol=1e-2, atol=1e-2)
