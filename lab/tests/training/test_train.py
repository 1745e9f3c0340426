import csv
import signal
import subprocess
import sys
from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from unshutter import UnshutterError, UsageError
from unshutter.photo import Photo
from unshutter.single.network import read_weights
from unshutter.single.register import load, method
from unshutter_lab.training import recipes
from unshutter_lab.training.config import TrainConfig, load_config, shipped_configs
from unshutter_lab.training.train import run
from unshutter_lab.training.weights import exported_weights

TINY = """
model = "segment-transformer"
steps = 6
batch = 4
log_every = 2
validate_every = 6
checkpoint_minutes = 0.0
[network]
width = 16
layers = 1
heads = 2
[data]
tokens = 16
drawn = 40
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return path


def log(folder: Path) -> list[dict[str, str]]:
    with (folder / "log.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def weights(folder: Path) -> dict[str, torch.Tensor]:
    return torch.load(folder / "checkpoint.pt", weights_only=True)["average"]


def test_a_run_leaves_a_model_a_log_and_a_checkpoint(config: Path, tmp_path: Path) -> None:
    folder = run(config, tmp_path / "runs")
    assert folder == tmp_path / "runs" / "tiny"
    rows = log(folder)
    assert [r["step"] for r in rows] == ["2", "4", "6"]
    assert float(rows[-1]["epe"]) > 0
    assert float(rows[-1]["val_epe_median"]) > 0
    assert read_weights(folder / "model.npz")["pooling.latents"].shape == (4, 16)


def test_validation_has_its_own_rhythm(config: Path, tmp_path: Path) -> None:
    config.write_text(
        TINY.replace("validate_every = 6", "validate_every = 3").replace("log_every = 2", "log_every = 4")
    )
    rows = log(run(config, tmp_path / "runs"))
    assert [(r["step"], bool(r["val_epe_median"])) for r in rows] == [("3", True), ("4", False), ("6", True)]


@pytest.mark.thorough
def test_training_lowers_the_loss(tmp_path: Path) -> None:
    path = tmp_path / "learn.toml"
    easy = "zero_motion = 0.0\nclutter_max = 0.0\nsideways = 0.0\n"
    longer = TINY.replace("steps = 6", "steps = 200\nlearning_rate = 3e-3").replace("batch = 4", "batch = 32")
    rarer = longer.replace("validate_every = 6", "validate_every = 200").replace("minutes = 0.0", "minutes = 60.0")
    path.write_text(rarer + easy)
    folder = run(path, tmp_path)
    rows = [float(r["epe"]) for r in log(folder)]
    assert sum(rows[-20:]) < 0.85 * sum(rows[:20])


def test_a_killed_run_resumes_to_the_same_weights(config: Path, tmp_path: Path) -> None:
    straight = weights(run(config, tmp_path / "straight"))
    # stopped after the first step, as a kill just after a checkpoint would
    folder = run(config, tmp_path / "resumed", minutes=0.0)
    assert torch.load(folder / "checkpoint.pt", weights_only=True)["step"] < 6 and (folder / "model.npz").exists()
    resumed = weights(run(config, tmp_path / "resumed"))
    for name, value in straight.items():
        torch.testing.assert_close(resumed[name], value, atol=1e-6, rtol=1e-5)
    steps = [r["step"] for r in log(folder)]
    assert steps == ["1", "2", "4", "6"]  # the first: before the stop


def test_a_folder_of_another_run_is_not_touched(config: Path, tmp_path: Path) -> None:
    run(config, tmp_path / "runs", minutes=0.0)
    config.write_text(TINY.replace("batch = 4", "batch = 5"))
    with pytest.raises(UsageError, match="another configuration"):
        run(config, tmp_path / "runs")


def test_a_second_phase_does_not_begin_without_the_first(config: Path, tmp_path: Path) -> None:
    second = tmp_path / "second.toml"
    second.write_text('base = "tiny.toml"\ncontinues = "tiny"\nsteps = 2\n')
    with pytest.raises(UsageError, match=r"continues a run of tiny: --start runs/tiny/checkpoint\.pt"):
        run(second, tmp_path / "runs")
    assert not (tmp_path / "runs" / "second").exists()
    first = run(config, tmp_path / "runs")
    begun = run(second, tmp_path / "runs", steps=1, start=first / "checkpoint.pt")
    assert log(run(second, tmp_path / "runs"))[-1]["step"] == "2"  # resumed: it has begun already
    assert begun == tmp_path / "runs" / "second"


def test_a_run_that_diverges_says_so(config: Path, tmp_path: Path) -> None:
    config.write_text(TINY.replace("steps = 6", "steps = 6\nlearning_rate = 1e30\nwarmup = 1"))
    with pytest.raises(UnshutterError, match=r"training diverged at step [2-6]: try a smaller learning rate"):
        run(config, tmp_path / "runs")
    assert not (tmp_path / "runs" / "tiny" / "model.npz").exists()


def test_a_seed_of_ones_own_gives_another_run(config: Path, tmp_path: Path) -> None:
    shipped, same, other = (weights(run(config, tmp_path / str(k), seed=k)) for k in (None, 0, 1))
    assert all(torch.equal(shipped[name], same[name]) for name in shipped)
    assert not all(torch.equal(shipped[name], other[name]) for name in shipped)
    with pytest.raises(UsageError, match="another configuration"):
        run(config, tmp_path / "1", seed=2)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("steps = 3", "model"),
        ('model = "x', "not TOML"),
        ('model = "segment-transformer"\nstep = 3', "unknown setting 'step'"),
        ('model = "segment-transformer"\nsteps = 3.5', "type int"),
        ('model = "segment-transformer"\nsteps = 0', "'steps' must be at least 1, got 0"),
        ('model = "segment-transformer"\nvalidate_every = 0', "'validate_every' must be at least 1"),
        ('model = "segment-transformer"\noptimiser = "lion"', "unknown optimiser 'lion'"),
        ('model = "segment-transformer"\nschedule = "sine"', "unknown schedule 'sine'"),
        ('model = "segment-transformer"\nschedule = "stairs"', "'stair'"),
    ],
)
def test_bad_configurations(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=says):
        load_config(path)


def test_unknown_names_inside_the_tables(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text(TINY.replace("width = 16", "wideness = 16"))
    with pytest.raises(UsageError, match="wideness"):
        run(path, tmp_path)
    path.write_text(TINY.replace("segment-transformer", "gpt"))
    with pytest.raises(UsageError, match="unknown model 'gpt'"):
        run(path, tmp_path)
    with pytest.raises(UsageError, match="cannot read"):
        load_config(tmp_path / "none.toml")


def test_a_base_says_what_the_file_does_not(config: Path, tmp_path: Path) -> None:
    (tmp_path / "more.toml").write_text('base = "tiny.toml"\nsteps = 7\n[network]\nlayers = 2\n')
    (tmp_path / "other.toml").write_text('model = "segment-transformer"\nbatch = 3\n[network]\nwidth = 8\nlayers = 9\n')
    more = load_config(tmp_path / "more.toml")
    assert (more.steps, more.batch) == (7, 4)
    assert more.network == {"width": 16, "layers": 2, "heads": 2}
    other = load_config(tmp_path / "more.toml", tmp_path / "other.toml")
    assert (other.steps, other.batch, other.network) == (7, 3, {"width": 8, "layers": 2})
    (tmp_path / "own.toml").write_text('base = "kandula2020-cpu-again"\nsteps = 7')  # the longest chain that ships
    assert load_config(tmp_path / "own.toml").steps == 7
    (tmp_path / "loop.toml").write_text('base = "loop.toml"')
    with pytest.raises(UsageError, match="too many files"):
        load_config(tmp_path / "loop.toml")
    (tmp_path / "odd.toml").write_text("base = 3")
    with pytest.raises(UsageError, match="'base' must be a TOML file or"):
        load_config(tmp_path / "odd.toml")


def test_a_run_starts_from_a_kept_checkpoint(config: Path, tmp_path: Path) -> None:
    config.write_text(TINY.replace("steps = 6", "steps = 6\nkeep_at = 4"))
    kept = run(config, tmp_path / "runs") / "checkpoint-4.pt"
    assert torch.load(kept, weights_only=True)["step"] == 4
    second = tmp_path / "second.toml"
    second.write_text('base = "tiny.toml"\nlearning_rate = 0.0\nsteps = 1')
    begun = weights(run(second, tmp_path / "runs", start=kept))
    given = torch.load(kept, weights_only=True)["average"]
    for name in given:
        if name.startswith("module.") and given[name].is_floating_point():
            torch.testing.assert_close(begun[name], given[name])
    wider = tmp_path / "wider.toml"
    wider.write_text('base = "tiny.toml"\n[network]\nwidth = 24\nheads = 2')
    with pytest.raises(UsageError, match="cannot start from"):
        run(wider, tmp_path / "runs", start=tmp_path / "none.pt")


def test_half_precision_learns_nearly_the_same_and_is_used_where_it_is_fast(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = log(run(config, tmp_path / "runs"))
    config.write_text("bfloat16 = true\n" + TINY)
    monkeypatch.setattr("torch.backends.cpu.get_cpu_capability", lambda: "AVX2")
    assert log(run(config, tmp_path / "slow"))[-1]["gradient"] == whole[-1]["gradient"]
    monkeypatch.setattr("torch.backends.cpu.get_cpu_capability", lambda: "AVX512")
    half = log(run(config, tmp_path / "half"))
    assert float(half[-1]["loss"]) == pytest.approx(float(whole[-1]["loss"]), rel=0.2)
    assert half[-1]["gradient"] != whole[-1]["gradient"]  # it is another arithmetic


def test_a_run_starts_from_stored_weights(config: Path, tmp_path: Path) -> None:
    """With a learning rate of zero, what it exports is what it began with."""
    stored = run(config, tmp_path / "runs") / "model.npz"
    second = tmp_path / "second.toml"
    second.write_text(f"steps = 1\nlearning_rate = 0.0\naverage = 0.0\nseed = 5\n{TINY.replace('steps = 6', '')}")
    begun = run(second, tmp_path / "runs", start=stored)
    assert (begun / "model.npz").read_bytes() == stored.read_bytes()

    wider = tmp_path / "wider.toml"
    wider.write_text(TINY.replace("layers = 1", "layers = 2"))
    with pytest.raises(UsageError, match="size of its network differs"):
        run(wider, tmp_path / "runs", start=stored)
    (tmp_path / "bad.npz").write_text("no weights")
    with pytest.raises(UnshutterError, match="damaged"):
        run(wider, tmp_path / "runs", start=tmp_path / "bad.npz")
    pixels = tmp_path / "pixels.toml"
    pixels.write_text('model = "kandula2020"\n[data]\ndrawn = 50\nheld_out = 2\n')
    with pytest.raises(UsageError, match=r"weights of kandula2020 are not stored as \.npz"):
        run(pixels, tmp_path / "runs", start=stored)


def test_photos_may_move_between_two_starts(tmp_path: Path) -> None:
    from unshutter_lab.training.pixels import draw_picture

    text = """
model = "kandula2020"
steps = 1
batch = 2
[network]
width = 4
hidden = 8
row_width = 4
[data]
folder = "nowhere"
held_out = 1
"""
    path = tmp_path / "photos.toml"
    path.write_text(text)
    for place in ("here", "there"):
        folder = tmp_path / place
        folder.mkdir()
        for i in range(2):
            Photo.from_array(draw_picture(356, i).transpose(1, 2, 0)).save(folder / f"{i}.png")
    with pytest.raises(UsageError, match="nowhere"):
        run(path, tmp_path / "runs")
    run(path, tmp_path / "runs", photos=tmp_path / "here")
    again = run(path, tmp_path / "runs", steps=2, photos=tmp_path / "there")
    assert log(again)[-1]["step"] == "2"


# ---- configurations that come with the package --------------------------------------------------------------


def test_the_shipped_configurations_are_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert {"segment-transformer", "kandula2020", "rengarajan2017-vanilla-bn-cpu"} <= set(shipped_configs())
    for name in shipped_configs():
        assert isinstance(load_config(name), TrainConfig)
    short = load_config("kandula2020-no-edges", base="kandula2020-cpu-long-pictures")
    assert (short.steps, short.network["width"], short.loss["rectified_edges"]) == (150, 16, 0)


def test_unknown_configurations_get_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, says in (
        ("segment", "unknown configuration 'segment': .* kandula2020, .*, segment-transformer"),
        ("mine.toml", "cannot read mine.toml: No such file"),
        ("configs/kandula2020.toml", "the one that comes with unshutter is called 'kandula2020'"),
    ):
        with pytest.raises(UsageError, match=says) as caught:
            load_config(name)
        assert "\n" not in str(caught.value)


def test_the_command_line_trains_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from unshutter.cli import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(TINY)
    assert main(["train", "--config", "tiny.toml", "--steps", "1"]) == 0
    assert (tmp_path / "runs" / "tiny" / "model.npz").exists()
    assert f"model: {Path('runs/tiny/model.npz')}" in capsys.readouterr().out
    assert main(["train", "--config", "tiny.toml", "--photos", "."]) == 2
    assert "drawn scenes, not from photos: leave out --photos" in capsys.readouterr().err
    assert main(["train", "--config", "no-such-thing"]) == 2
    assert "segment-transformer" in capsys.readouterr().err
    assert main(["train", "--config", "kandula2020"]) == 2
    assert "there is no folder photos; training needs at least 41 (40 held out" in capsys.readouterr().err
    assert not (tmp_path / "runs" / "kandula2020").exists()


@pytest.mark.thorough
def test_ctrl_c_leaves_a_checkpoint_from_which_the_run_goes_on(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config.write_text(TINY.replace("steps = 6", "steps = 1000000").replace("minutes = 0.0", "minutes = 60.0"))
    command = [sys.executable, "-m", "unshutter_lab.training.train", "--config", config, "--out", tmp_path]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        assert "a new run" in process.stdout.readline()
        assert process.stdout.readline().startswith("step 1 of 1000000 took")
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
    assert process.returncode != 0
    step = torch.load(tmp_path / "tiny" / "checkpoint.pt", weights_only=True)["step"]
    run(config, tmp_path, steps=step + 2)
    again = capsys.readouterr().out
    assert "the run continues" in again
    assert f"step {step + 1} of {step + 2} took" in again
    assert (tmp_path / "tiny" / "model.npz").exists()


@pytest.mark.thorough
def test_own_photos_begin_with_the_shipped_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnx")
    monkeypatch.setattr(recipes, "_START_PICTURES", 4)  # of which the normalisations take their spread, not the biases
    (tmp_path / "photos").mkdir()
    for k, noise in enumerate(torch.randint(0, 256, (2, 64, 64, 3), dtype=torch.uint8).numpy()):
        Photo.from_array(noise).save(tmp_path / "photos" / f"{k}.png")
    config = tmp_path / "few.toml"
    config.write_text('base = "own-photos"\nsteps = 1\nbatch = 1\n[data]\ndrawn = 1\nheld_out = 1\n')
    folder = run(config, tmp_path, photos=tmp_path / "photos")
    assert load(f"kandula2020@{folder / 'model.onnx'}").name == "kandula2020"
    start = method("kandula2020").weights
    assert start is not None
    shipped = exported_weights(start)
    biases = {name: value for name, value in shipped.items() if name.endswith(".bias")}
    begun = weights(tmp_path / "few")
    near = [
        torch.allclose(begun[f"module.{name}"], torch.tensor(value).float(), atol=1e-3)
        for name, value in biases.items()
        if f"module.{name}" in begun and begun[f"module.{name}"].shape == value.shape
    ]
    assert near.count(True) > len(near) / 3  # others are those of convolutions, whose normalisation was split off
