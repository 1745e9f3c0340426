"""The paper's system: both phases of its training, its export, its ablations and the shipped configurations."""

import csv
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")
nn = torch.nn

from support.small_kandula2020 import DATA, NETWORK, PICTURE_LOSSES
from unshutter.errors import UsageError
from unshutter_lab.training.config import TrainConfig, load_config, shipped_configs
from unshutter_lab.training.kandula2020 import Kandula2020Config
from unshutter_lab.training.kandula2020_losses import LossConfig, row_map_error
from unshutter_lab.training.kandula2020_recipe import KandulaRecipe
from unshutter_lab.training.pixels import rs_positions, sample, sampled_motion
from unshutter_lab.training.recipes import make_recipe
from unshutter_lab.training.train import make_optimiser, rate_at, run

torch.set_num_threads(1)
CPU = torch.device("cpu")


# ---- training ---------------------------------------------------------------------------------------------


def write_config(path: Path, loss: str = "regress_steps = 3\nregress_photos = 2", network: str = "") -> Path:
    path.write_text(
        'model = "kandula2020"\nsteps = 6\nbatch = 2\noptimiser = "adam"\nbeta2 = 0.99\nweight_decay = 0.0\n'
        'schedule = "constant"\nlog_every = 1\nvalidate_every = 3\n'
        f"[network]\nsize = 64\nwidth = 4\nhidden = 16\nrow_width = 4\n{network}\n"
        "[data]\nsize = 64\ncanvas = 88\ndrawn = 5\nheld_out = 2\nvalidation_motions = 1\n"
        f"[loss]\n{loss}\n"
    )
    return path


def read_log(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "log.csv").read_text().splitlines()))


def test_training_runs_both_phases_and_resumes(tmp_path):
    config = write_config(tmp_path / "small.toml")
    whole = run(config, tmp_path / "whole", device="cpu")
    log = read_log(whole)
    assert [bool(row["rectified"]) for row in log] == [False] * 3 + [True] * 3
    assert all(
        float(log[-1][name]) > 0 for name in (*PICTURE_LOSSES, "motion", "val_epe_median", "val_epe_exact_inverse")
    )

    stopped = run(config, tmp_path / "parts", steps=4, device="cpu")
    run(config, tmp_path / "parts", device="cpu")
    states = [torch.load(folder / "checkpoint.pt", weights_only=True) for folder in (whole, stopped)]
    for name, weights in states[0]["network"].items():
        torch.testing.assert_close(states[1]["network"][name], weights, msg=name)


def test_the_row_block_learns_the_true_row_map_in_the_first_phase(tmp_path):
    """Given the trajectory it can tell in which row a pixel was seen; the log says how far off it is."""
    config = write_config(
        tmp_path / "rows.toml",
        "regress_steps = 100\nregress_photos = 0\nrow_residual = 1.0",
        'row_input = "trajectory"',
    )
    config.write_text(config.read_text().replace("steps = 6\nbatch = 2", "steps = 40\nbatch = 8\nlearning_rate = 0.01"))
    log = read_log(run(config, tmp_path, device="cpu"))
    first, last = (float(row["row_map"]) for row in (log[0], log[-1]))
    assert last < 0.8 * first
    assert {"train_epe", "train_epe_as_seen"} <= set(log[-1])


def test_layers_that_are_kept_do_not_learn(tmp_path):
    config = write_config(tmp_path / "small.toml", "regress_steps = 100\nagain = 0.5", "kept = 1")
    runs = [run(config, tmp_path / name, steps=steps, device="cpu") for name, steps in (("one", 1), ("all", 6))]
    before, after = (torch.load(folder / "checkpoint.pt", weights_only=True)["network"] for folder in runs)
    changed = {name for name in before if (before[name] != after[name]).any()}
    kept = {name for name in before if "row_block." in name or "base.0." in name}
    assert not changed & kept
    assert {name for name in before if "base.2.0" in name} <= changed


def test_half_of_the_pictures_are_seen_as_the_network_rectifies_them():
    """What is left to find in them is what it did not find at first."""
    torch.manual_seed(0)
    recipe = KandulaRecipe(TrainConfig("kandula2020", batch=4, network=NETWORK, data=DATA, loss={"again": 0.5}), CPU)
    network, seen = recipe.build(), []
    handle = network.register_forward_pre_hook(lambda _, pictures: seen.append(pictures[0]))
    recipe.loss(network, 0, torch.Generator().manual_seed(1))
    handle.remove()
    samples = recipe.data.batch(4, torch.Generator().manual_seed(1), recipe.weights.regress_photos, with_gs=False)
    assert network.training and torch.equal(seen[0][2:], samples.rs[2:])
    truth = torch.stack(samples.row_motion(), 1)
    network.one_look = lambda pictures: truth[: len(pictures)]  # a network that finds everything leaves nothing
    pictures, rest = recipe.seen_again(network, samples.rs, truth, 2)
    assert not rest[:2].any() and torch.equal(rest[2:], truth[2:])
    expected = sample(samples.rs, *rs_positions(truth, None))[0][:2]
    assert (pictures[:2] - expected).abs().mean() < 0.01


def test_row_maps_are_compared_with_the_rows_that_saw_the_pixels():
    samples = next(KandulaRecipe(TrainConfig("kandula2020", network=NETWORK, data=DATA), CPU).data.validation())
    true = rs_positions(torch.stack(samples.row_motion(), 1), None)[1]
    assert row_map_error(true, samples) < 0.003
    assert row_map_error(true + 4, samples).item() == pytest.approx(0.5, abs=0.003)


def test_where_a_motion_has_no_inverse_it_is_no_number():
    """Newton's method may divide by zero there; the places beside it keep their motion."""
    motion = torch.stack([torch.arange(8.0), 0.1 * torch.arange(8.0)])[None]
    rows = torch.tensor([[[2.5, torch.nan, torch.inf]]])
    tx, rz, _ = sampled_motion(motion)(rows)
    torch.testing.assert_close(tx, torch.tensor([[[2.5, torch.nan, 7.0]]]), equal_nan=True)
    torch.testing.assert_close(rz, torch.tensor([[[0.25, torch.nan, 0.7]]]), equal_nan=True)


@pytest.mark.parametrize("more", [{}, {"looks": 3, "mirror_average": True, "row_input": "trajectory"}])
def test_export_is_the_network(tmp_path, more):
    import onnxruntime

    torch.manual_seed(0)
    recipe = KandulaRecipe(TrainConfig("kandula2020", network=NETWORK | more, data=DATA), CPU)
    network = recipe.build()
    nn.init.normal_(network.row_block.layers[-1].weight, std=0.1)
    network(torch.rand(4, 3, 64, 64))  # batch statistics that are not those of the start
    network.eval()
    rs = torch.rand(3, 3, 64, 64)
    with torch.no_grad():
        expected = network(rs)
    recipe.export(network, tmp_path / "model.onnx")
    session = onnxruntime.InferenceSession(str(tmp_path / "model.onnx"), providers=["CPUExecutionProvider"])
    assert [o.name for o in session.get_outputs()] == ["motion", "row_map"]
    for ours, theirs in zip(expected, session.run(None, {"rs": rs.numpy()}), strict=True):
        np.testing.assert_allclose(theirs, ours.numpy(), atol=1e-4)


@pytest.mark.parametrize("mirror", [False, True])
def test_an_exported_network_may_see_smaller_pictures_than_it_is_shown(tmp_path, mirror):
    import onnxruntime

    torch.manual_seed(0)
    more = {"row_layers": 0, "shown": 96, "mirror_average": mirror}
    recipe = KandulaRecipe(TrainConfig("kandula2020", network=NETWORK | more, data=DATA), CPU)
    network = recipe.build()
    network(torch.rand(4, 3, 64, 64))
    network.eval()
    picture = cv2.GaussianBlur(np.random.default_rng(0).random((96, 96, 3), np.float32), (0, 0), 4)
    rs = np.ascontiguousarray(picture.transpose(2, 0, 1)[None])
    small = cv2.resize(picture, (64, 64), interpolation=cv2.INTER_LINEAR)
    with torch.no_grad():
        tx, rz = network(torch.from_numpy(small.transpose(2, 0, 1)[None]))[0][0].numpy()
    recipe.export(network, tmp_path / "model.onnx")
    session = onnxruntime.InferenceSession(str(tmp_path / "model.onnx"), providers=["CPUExecutionProvider"])
    (motion,) = session.run(None, {"rs": rs})
    at = (np.arange(96) + 0.5) * 64 / 96 - 0.5  # of its rows among those of the small one
    np.testing.assert_allclose(motion[0, 0], np.interp(at, np.arange(64), tx) * 1.5, atol=1e-3)
    np.testing.assert_allclose(motion[0, 1], np.interp(at, np.arange(64), rz), atol=1e-5)
    by_opencv = cv2.dnn.readNetFromONNX(str(tmp_path / "model.onnx"))
    by_opencv.setInput(rs)
    np.testing.assert_allclose(by_opencv.forward(), motion, atol=1e-4)


def test_a_network_that_sees_smaller_pictures_starts_from_its_file(tmp_path):
    torch.manual_seed(0)
    more = {"row_layers": 0, "shown": 96, "mirror_average": True}
    recipe = KandulaRecipe(TrainConfig("kandula2020", network=NETWORK | more, data=DATA), CPU)
    network, other = recipe.build(), recipe.build()
    network(recipe.pictures(64, torch.Generator().manual_seed(0)))
    recipe.export(network.eval(), tmp_path / "model.onnx")
    rs = recipe.pictures(4, torch.Generator().manual_seed(1))
    with torch.no_grad():
        expected, before = network(rs)[0], other.eval()(rs)[0]
        recipe.start(other.train(), tmp_path / "model.onnx")
        after = other.eval()(rs)[0]
    assert (after - expected).abs().mean() < 0.1 * (before - expected).abs().mean()


def test_a_network_that_sees_smaller_pictures_has_no_row_block_and_looks_once():
    for more in ({"row_layers": 5}, {"row_layers": 0, "looks": 2}):
        with pytest.raises(UsageError, match="row_layers"):
            Kandula2020Config(shown=96, **more)


@pytest.mark.parametrize(
    ("network", "loss", "logged"),
    [
        ("", "regress_only = true", set()),
        ("", 'regress_steps = 4\nregress_norm = "distance"', set()),
        ("", "regress_steps = 0\nregenerated = 0\nregenerated_edges = 0", {"rectified", "rectified_edges"}),
        ("", "regress_steps = 0\nrectified_edges = 0\nregenerated_edges = 0", {"rectified", "regenerated"}),
        ("trajectory_degree = -1", "regress_steps = 0", set(PICTURE_LOSSES)),
        ("row_layers = 0", "regress_steps = 0", set(PICTURE_LOSSES)),
        ("row_layers = 3", "regress_steps = 0", set(PICTURE_LOSSES)),
    ],
)
def test_ablations_train_and_export(tmp_path, network, loss, logged):
    config = write_config(tmp_path / "ablation.toml", loss, network)
    folder = run(config, tmp_path, steps=2, device="cpu")
    last = read_log(folder)[-1]
    assert {name for name in PICTURE_LOSSES if last.get(name)} == logged
    assert (folder / "model.onnx").exists()


def test_size_of_data_and_network_must_agree():
    with pytest.raises(UsageError, match="must agree"):
        KandulaRecipe(TrainConfig("kandula2020", network=NETWORK), CPU)


# ---- configurations ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in shipped_configs() if "2" in name])
def test_shipped_configurations_can_be_built(name):
    config = load_config(name)
    none = {"folder": "", "validation_folder": "", "drawn": 3, "held_out": 1, "places": {}}
    config = replace(config, data={**config.data, **none})
    recipe = make_recipe(config, CPU)
    with torch.device("meta"):
        network = recipe.build() if config.model == "kandula2020" else None
    if network is not None:
        assert sum(w.numel() for w in network.parameters()) * 4 < 20e6
    assert rate_at(0, config) > 0


def test_the_paper_run_is_the_paper_run():
    config = load_config("kandula2020")
    assert (config.optimiser, config.learning_rate, config.momentum, config.beta2) == ("adam", 1e-3, 0.9, 0.99)
    assert config.data["photos"] == 400
    assert config.steps * config.batch % 80_000 == 0
    assert (config.loss["regress_photos"], config.loss["regress_steps"]) == (50, 50 * 200 * 5 // 64)
    defaults = LossConfig()
    assert [getattr(defaults, name) for name in PICTURE_LOSSES] == [1, 1, 0.5, 0.5]


@pytest.mark.parametrize(
    ("name", "difference"),
    [
        ("regressed", {"loss": {"regress_only": True}}),
        ("no-regeneration", {"loss": {"regenerated": 0, "regenerated_edges": 0}}),
        ("no-edges", {"loss": {"rectified_edges": 0, "regenerated_edges": 0}}),
        ("no-trajectory", {"network": {"trajectory_degree": -1}}),
        ("exact-inverse", {"network": {"row_layers": 0}}),
        ("row3", {"network": {"row_layers": 3}}),
    ],
)
def test_ablations_differ_in_one_thing(name, difference):
    base = asdict(load_config("kandula2020"))
    ablation = asdict(load_config(f"kandula2020-{name}"))
    for table, values in difference.items():
        base[table] = {**base[table], **values}
    assert ablation == base


def test_optimisers_and_schedules():
    config = TrainConfig("any", steps=100, warmup=10, learning_rate=0.5, momentum=0.8, beta2=0.97, weight_decay=0.25)
    network = nn.Linear(2, 2)
    adamw, adam, sgd = (make_optimiser(network, replace(config, optimiser=name)) for name in ("adamw", "adam", "sgd"))
    assert (type(adamw), type(adam), type(sgd)) == (torch.optim.AdamW, torch.optim.Adam, torch.optim.SGD)
    assert adam.defaults["betas"] == (0.8, 0.97) and sgd.defaults["momentum"] == 0.8
    assert {o.defaults["weight_decay"] for o in (adamw, adam, sgd)} == {0.25}
    assert TrainConfig("any").optimiser == "adamw" and (TrainConfig("any").momentum, TrainConfig("any").beta2) == (
        0.9,
        0.98,
    )
    assert rate_at(4, config) == pytest.approx(0.25, abs=0.005) and rate_at(50, config) == pytest.approx(0.25)
    assert rate_at(99, replace(config, schedule="constant")) == 0.5
    stairs = replace(config, schedule="stairs", stair=40)
    late = replace(config, schedule="late", tail=0.4)
    assert [rate_at(s, late) for s in (20, 60, 80, 100)] == pytest.approx([0.5, 0.5, 0.25, 0.0])
    with pytest.raises(UsageError, match="tail"):
        replace(config, tail=0.0)
    assert [rate_at(s, stairs) for s in (20, 39, 40, 80)] == pytest.approx([0.5, 0.5, 0.05, 0.005])
