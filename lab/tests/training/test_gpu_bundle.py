"""lab/benchmarks/gpu: training on a bare machine that is lent for minutes, tried here on a tiny budget."""

import csv
import json
import os
import runpy
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from support.drawn_places import save_place, streets
from support.small_kandula2020 import DATA, NETWORK
from unshutter_lab.training.pixels import draw_picture
from unshutter_lab.training.train import run

GPU = Path(__file__).parents[2] / "benchmarks" / "gpu"
# what the machine does not have, though this one may
_LACKING = ["onnx", "onnxruntime", "onnxscript", "pyvips", "rich", "scipy", "jaxtyping", "beartype", "PIL", "av"]
_BARE = f"""
import json, runpy, sys
sys.modules |= dict.fromkeys({_LACKING})  # each import of them fails
sys.path.insert(0, {str(GPU)!r})
for sys.argv in json.loads(sys.argv[1]):
    runpy.run_path(sys.argv[0], run_name="__main__")
import unshutter.motion.geometry, unshutter_lab, array_api_compat
for module in (unshutter, unshutter_lab, array_api_compat):
    assert "packages" in module.__file__, module.__file__
"""
# fewer drawings than a machine of many processors makes in the first minute
_FEW = f"""
import json, sys
sys.path[:0] = json.loads(sys.argv[1])[0][1] + "/packages", {str(GPU)!r}
import drawing
drawing._CORNERS, drawing._PLACES = (20, 40), 4
"""


@pytest.fixture(scope="module")
def bundle(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("gpu")
    (folder / "photos").mkdir()
    for number in range(4):
        picture = draw_picture(120, number).transpose(1, 2, 0)[..., ::-1]
        cv2.imwrite(str(folder / "photos" / f"{number}.png"), picture)
    command = [sys.executable, GPU / "bundle.py", folder / "photos", folder / "bundle"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=_environment())
    assert "4 photos" in done.stdout
    return folder / "bundle"


@pytest.fixture
def config(tmp_path) -> Path:
    tables = {"network": NETWORK, "data": {**DATA, "folder": "photos"}, "loss": {"regress_steps": 4}}
    path = tmp_path / "small.toml"
    path.write_text(_text(tables))
    return path


def _text(tables: dict[str, dict]) -> str:
    """A configuration."""
    text = 'model = "kandula2020"\nsteps = 6\nbatch = 2\nwarmup = 1\nlog_every = 1\n'
    for name, table in tables.items():
        text += "\n".join([f"[{name}]", *(f"{key} = {json.dumps(value)}" for key, value in table.items()), ""])
    return text


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def train(bundle: Path, config: Path | str, *runs: list[object], before: str = "") -> str:
    """Trains once for each list of words, in one process, after other code: torch takes seconds to be imported."""
    words = [[str(word) for word in (GPU / "train.py", bundle, *run, "--configs", config)] for run in runs]
    done = subprocess.run([sys.executable, "-c", before + _BARE, json.dumps(words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.thorough
def test_a_run_goes_on_from_the_parcels_of_the_run_before(bundle, config, tmp_path, monkeypatch):
    first, second, runs = tmp_path / "first", tmp_path / "second", tmp_path / "runs"
    told = train(bundle, config, [first, "--steps", "3"], [second, "--from", first])  # which takes the other three
    assert told.count("small: 3 steps") == 2
    assert [part.name for part in first.iterdir()] == ["small.0"]
    monkeypatch.syspath_prepend(str(GPU))
    monkeypatch.setattr(sys, "argv", ["unpack", str(second), str(runs)])
    runpy.run_path(str(GPU / "unpack.py"), run_name="__main__")
    folder = run(config, runs, device="cpu", photos=bundle / "photos")  # writes the network
    assert (folder / "model.onnx").exists()
    log = list(csv.DictReader((folder / "log.csv").read_text().splitlines()))
    assert [row["step"] for row in log] == list("123456")


@pytest.mark.thorough
def test_a_network_that_is_given_minutes_sees_places_and_corners_drawn_meanwhile(tmp_path, monkeypatch, capsys):
    save_place(tmp_path / "places" / "yard", streets(1, 64))
    for folder, count in (("photos", 4), ("val", 2)):
        (tmp_path / folder).mkdir()
        for number in range(count):
            picture = draw_picture(120, number).transpose(1, 2, 0)[..., ::-1]
            cv2.imwrite(str(tmp_path / folder / f"{number}.png"), picture)
    words = [
        tmp_path / "photos",
        tmp_path / "bundle",
        "--validation",
        tmp_path / "val",
        "--places",
        tmp_path / "places",
    ]
    subprocess.run([sys.executable, GPU / "bundle.py", *words], check=True, env=_environment())
    data = {**DATA, "folder": "photos", "validation_folder": "val", "drawn_kind": "facades", "drawn_share": 0.5}
    places = {"folder": "panoramas", "share": 0.3, "drawn": 2, "drawn_share": 0.3, "drawn_side": 32}
    tables = {"network": NETWORK, "data": data, "data.places": places, "loss": {"regress_only": True}}
    config = tmp_path / "small.toml"
    config.write_text(_text(tables))
    told = train(tmp_path / "bundle", f"{config}:0.03", [tmp_path / "parcels", "--minutes", "5"], before=_FEW)
    assert "corners and towns drawn" in told and (tmp_path / "parcels" / "small.0").exists()
    steps = int(told.split("small: ")[-1].split()[0])
    assert f"{steps}/{steps}" in told  # with its rate at zero
    monkeypatch.syspath_prepend(str(GPU))
    monkeypatch.setattr(sys, "argv", ["unpack", str(tmp_path / "parcels"), str(tmp_path / "runs")])
    runpy.run_path(str(GPU / "unpack.py"), run_name="__main__")
    assert f"{steps} steps" in capsys.readouterr().out
    (tmp_path / "places").rename(tmp_path / "panoramas")
    monkeypatch.chdir(tmp_path)
    folder = run(config, tmp_path / "runs", steps, "cpu", photos=tmp_path / "photos")  # at home, with other folders
    assert (folder / "model.onnx").exists()
    assert len((folder / "log.csv").read_text().splitlines()) == steps + 1  # not a step more


def test_parcels_hold_what_a_run_needs(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(GPU))
    import parcels

    wide = torch.randn(1500, 8, generator=torch.Generator().manual_seed(0)) @ torch.randn(8, 3000)
    network = {"wide": wide, "kernel": torch.rand(4, 3, 3, 3), "mean": torch.rand(4), "count": torch.tensor(7)}
    optimiser = {"state": {0: {"exp_avg": torch.full((2, 2), 1e-9)}}, "param_groups": [{"lr": 0.1}]}
    state = {"config": {"model": "any"}, "step": 5, "seconds": 1.0, "network": network, "optimiser": optimiser}
    state["average"] = {"n_averaged": torch.tensor(5), **{f"module.{name}": value for name, value in network.items()}}
    run_folder, back = tmp_path / "net", tmp_path / "back"
    run_folder.mkdir()
    torch.save(state, run_folder / "checkpoint.pt")
    (run_folder / "log.csv").write_text("step\n5\n")
    assert not parcels.pack(run_folder, tmp_path / "parcels", finished=False)  # too large before it is finished
    monkeypatch.setattr(parcels, "PART", 1_000_000)
    assert parcels.pack(run_folder, tmp_path / "parcels", finished=True)
    assert len(list((tmp_path / "parcels").iterdir())) > 1 and parcels.names(tmp_path / "parcels") == ["net"]
    assert parcels.unpack("net", tmp_path / "parcels", back)
    again = torch.load(back / "net" / "checkpoint.pt", weights_only=True)
    assert again["step"] == 5 and (back / "net" / "log.csv").read_text() == "step\n5\n"
    for name, value in network.items():
        torch.testing.assert_close(again["network"][name], value, rtol=2e-3, atol=0.03)
        torch.testing.assert_close(again["average"][f"module.{name}"], value, rtol=2e-3, atol=0.03)
    assert np.isclose(again["optimiser"]["param_groups"][0]["lr"], 0.1) and not again["optimiser"]["state"]
    assert not parcels.unpack("other", tmp_path / "parcels", back)
