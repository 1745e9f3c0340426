"""No option that names an output can touch what its command reads, under whatever name.

The options are found by what their fields say that they name (options/description.py). A new one fails here until it
stands in ``SCENES``, and then until it is safe.
"""

import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support import clips
from support.batches import make_motion, make_photos
from unshutter.cli import command_named, main, summaries
from unshutter.cli.arguments import outputs

WEIGHTS = Path(unshutter.__file__).parent / "weights" / "segment-transformer.npz"


@dataclass
class Scene:
    """A command with files to read.

    Attributes:
        words: the command and its inputs.
        inputs: all files that it then reads.
        outputs: option -> ending of the files that it writes.
        needed: options that cannot be left out -> where they may go.
        code: with which it ends where all goes well.
    """

    words: list[object]
    inputs: list[Path]
    outputs: dict[str, str]
    needed: dict[str, Path] = field(default_factory=dict)
    overwrite: tuple[str, ...] = ("--overwrite",)


def _photo(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg"])
    motion = make_motion(folder / "m.json")
    words = ["rectify", folder / "a.jpg", "--motion", motion]
    ends = {"--output": ".jpg", "--save-motion": ".json", "--masks": "", "--json-log": ".jsonl", "--preview": ".png"}
    return Scene(words, [folder / "a.jpg", motion], ends)


def _photos(folder: Path) -> Scene:
    """A folder, and weights of one's own."""
    make_photos(folder, ["in/a.jpg", "in/b.png"])
    weights = shutil.copyfile(WEIGHTS, folder / "w.npz")
    inputs = [*sorted((folder / "in").iterdir()), weights]
    words = ["rectify", folder / "in", "--estimator", f"segment-transformer@{weights}", "--keep-names"]
    ends = {"--output": "", "--save-motion": "", "--masks": "", "--json-log": ".jsonl", "--preview": ".png"}
    return Scene(words, inputs, ends | {"--manifest": ""}, {"--output": folder / "out"})


def _neighbours(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg", "b.jpg", "c.jpg"])
    words = ["rectify", folder / "b.jpg", "--before", folder / "a.jpg", "--after", folder / "c.jpg"]
    ends = {"--output": ".jpg", "--save-motion": ".json", "--masks": "", "--json-log": ".jsonl", "--preview": ".png"}
    return Scene([*words, "--readout-ratio", "0.5"], sorted(folder.glob("*.jpg")), ends)


def _estimate(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg"])
    weights = shutil.copyfile(WEIGHTS, folder / "w.npz")
    words = ["estimate", folder / "a.jpg", "--estimator", f"segment-transformer@{weights}"]
    return Scene(words, [folder / "a.jpg", weights], {"--output": ".json", "--plot": ".png"})


def _map(folder: Path) -> Scene:
    make_photos(folder, ["a.tif"])
    weights = shutil.copyfile(WEIGHTS, folder / "w.npz")
    words = ["map", folder / "a.tif", "--estimator", f"segment-transformer@{weights}"]
    return Scene(words, [folder / "a.tif", weights], {"--output": ".tif"})


def _points(folder: Path) -> Scene:
    motion, table = make_motion(folder / "m.json"), folder / "t.csv"
    table.write_text("x,y\n1,2\n")
    return Scene(["points", motion, table], [motion, table], {"--output": ".csv"})


VIDEO = {"--output": ".mp4", "--save-motion": ".json", "--preview": ".png", "--plot": ".png", "--json-log": ".jsonl"}


def _film(folder: Path) -> Scene:
    film = clips.write(folder / "a.mp4", clips.moving(6)[1])
    words = ["video", film, "--readout-ratio", "0.6"]
    return Scene(words, [film], VIDEO, {"--output": folder / "out.mp4"})


def _film_by_motion(folder: Path) -> Scene:
    scene = _film(folder)
    motion = folder / "m.json"
    assert main([*map(str, scene.words), "-o", str(folder / "first.mp4"), "--save-motion", str(motion)]) == 0
    words = ["video", *scene.inputs, "--motion", motion]
    return Scene(words, [*scene.inputs, motion], VIDEO, scene.needed)


def _frames(folder: Path, pattern: str = "") -> Scene:
    (folder / "in").mkdir()
    made = clips.write(folder / "a.mp4", clips.moving(6)[1])
    assert main(["video", str(made), "-o", str(folder / "in" / "%05d.png"), "--readout-ratio", "0.6"]) == 0
    words = ["video", folder / "in" / pattern, "--readout-ratio", "0.6"]
    ends = {**VIDEO, "--output": ".png"}
    return Scene(words, sorted((folder / "in").iterdir()), ends, {"--output": folder / "out"})


def _pattern(folder: Path) -> Scene:
    return _frames(folder, "%05d.png")


def _evaluate(folder: Path) -> Scene:
    make_photos(folder, ["in/a.jpg"])
    words = ["evaluate", "--data", folder / "in", "--estimators", "none", "--photos", 1, "--per-photo", 1]
    return Scene([*words, "--jobs", 1], [folder / "in" / "a.jpg"], {"--output": ""})


def _synthesize(folder: Path) -> Scene:
    make_photos(folder, ["in/a.jpg"])
    words = ["synthesize", folder / "in", "--size", 64, "--canvas", 70]
    return Scene(words, [folder / "in" / "a.jpg"], {"--output": ""}, overwrite=())


TINY = """
model = "segment-transformer"
steps = 1
batch = 2
[network]
width = 16
layers = 1
heads = 2
[data]
tokens = 16
drawn = 4
"""


def _train(folder: Path) -> Scene:
    (folder / "tiny.toml").write_text(TINY)
    return Scene(["train", "--config", folder / "tiny.toml"], [folder / "tiny.toml"], {"--out": ""}, overwrite=())


def _calibrate(folder: Path) -> Scene:
    make_photos(folder, [f"{name}/{name}.jpg" for name in ("val", "train", "ordinary")])
    log = folder / "trajectories" / "log.npz"
    log.parent.mkdir()
    np.savez(log, t_s=np.arange(300) / 100, gyro_rad_s=np.zeros((300, 3)))
    inputs = [*sorted(folder.rglob("*.jpg")), log]
    return Scene(["calibrate", folder, "--jobs", 1], inputs, {"--output": ""})


SCENES: dict[str, list[Callable[[Path], Scene]]] = {
    "rectify": [_photo, _photos, _neighbours],
    "estimate": [_estimate],
    "map": [_map],
    "points": [_points],
    "video": [_film, _film_by_motion, _frames, _pattern],
    "evaluate": [_evaluate],
    "synthesize": [_synthesize],
    "train": [_train],
    "calibrate": [_calibrate],
}
ELSEWHERE = {("serve", "--folder")}  # test_the_page_never_takes_a_name_that_is_there
NEEDS = {_film: "av", _film_by_motion: "av", _frames: "av", _pattern: "av", _evaluate: "matplotlib", _train: "torch"}
NEEDS |= {_calibrate: "sklearn"}


def all_outputs() -> set[tuple[str, str]]:
    return {(name, option) for name in summaries() for option in outputs(command_named(name).arguments)}


def test_every_option_that_names_an_output_is_tried_here(tmp_path: Path) -> None:
    tried = set(ELSEWHERE)
    for name, scenes in SCENES.items():
        for k, make in enumerate(scenes):
            if find_spec(NEEDS.get(make, "unshutter")):
                (tmp_path / f"{name}{k}").mkdir()
                tried |= {(name, option) for option in make(tmp_path / f"{name}{k}").outputs}
            else:
                tried |= {each for each in all_outputs() if each[0] == name}
    assert tried == all_outputs()


def names_of(file: Path, folder: Path, ending: str) -> Iterator[object]:
    """Names that lead to a file: for each that it has, and with the ending that the command wants."""
    yield file
    yield os.path.relpath(file)
    yield file.parent / ".." / file.parent.name / file.name
    through = folder / "through"
    through.symlink_to(file.parent)
    yield through / file.name
    for kind, make in (("symbolic", Path.symlink_to), ("hard", Path.hardlink_to)):
        made = folder / f"{kind}{ending or file.suffix}"
        make(made, file)
        yield made
    if find_spec("upath"):
        for url in ("local://{0}", "file://{0}", "simplecache::file://{0}", "dir://{0.name}::file://{0.parent}"):
            yield url.format(file)


def contents(files: list[Path]) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in files}


def run_with(scene: Scene, option: str, name: object, inputs: list[object] | None = None) -> int:
    needed = [word for needed in scene.needed.items() if needed[0] != option for word in needed]
    return main(list(map(str, [*(inputs or scene.words), option, name, *needed, *scene.overwrite])))


ALL = [(name, make) for name, scenes in SCENES.items() for make in scenes]


@pytest.mark.skipif(os.name == "nt", reason="needs links")
@pytest.mark.parametrize(("command", "make"), ALL, ids=[f"{name}-{make.__name__.strip('_')}" for name, make in ALL])
def test_an_output_that_leads_to_an_input(command: str, make, tmp_path: Path, capsys, monkeypatch) -> None:
    pytest.importorskip(NEEDS.get(make, "unshutter"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    scene = make(tmp_path / "in")
    before = contents(scene.inputs)
    for option, ending in scene.outputs.items():
        for k, file in enumerate(scene.inputs):
            folder = tmp_path / f"{option}{k}"
            folder.mkdir()
            for name in names_of(file, folder, ending):
                capsys.readouterr()
                code = run_with(scene, option, name)
                told = capsys.readouterr().err.strip().splitlines()
                assert contents(scene.inputs) == before, (option, name)
                assert code in (1, 2), (option, name, told)
                assert "Traceback" not in "".join(told)
                if ending == Path(str(name)).suffix == file.suffix and "://" not in str(name):
                    assert "original" in told[0] or "twice" in told[0], (option, name, told)


# a whole calibration takes seconds: lab/tests/calibration tries its folder
FOLDERS = [(name, make) for name, make in ALL if make not in (_film, _film_by_motion, _calibrate)]


@pytest.mark.skipif(os.name == "nt", reason="needs links")
@pytest.mark.parametrize(
    ("command", "make"), FOLDERS, ids=[f"{name}-{make.__name__.strip('_')}" for name, make in FOLDERS]
)
@pytest.mark.parametrize("kind", ["symbolic", "hard"])
def test_a_folder_of_links_to_inputs(command: str, make, kind: str, tmp_path: Path, capsys, monkeypatch) -> None:
    """Whatever a command writes into a folder: there are links to its inputs under all these names."""
    pytest.importorskip(NEEDS.get(make, "unshutter"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    scene = make(tmp_path / "in")
    before = contents(scene.inputs)
    for option, ending in scene.outputs.items():
        if ending:
            continue
        out = tmp_path / option
        assert run_with(scene, option, out) == 0, capsys.readouterr().err
        written = [path for path in out.rglob("*") if path.is_file()]
        assert written
        for file in scene.inputs:
            for path in written:
                path.unlink(missing_ok=True)
                (path.symlink_to if kind == "symbolic" else path.hardlink_to)(file)
            run_with(scene, option, out)
            assert "Traceback" not in capsys.readouterr().err
            assert contents(scene.inputs) == before, (option, file)


@pytest.mark.skipif(os.name == "nt", reason="needs links")
def test_a_folder_of_inputs_that_gets_the_results(tmp_path: Path, capsys) -> None:
    """With results that have the names of their photos."""
    make_photos(tmp_path / "in", ["a.jpg", "trip/b.jpg"])
    motion = make_motion(tmp_path / "m.json")
    (tmp_path / "link").symlink_to(tmp_path / "in")
    inputs = [tmp_path / "in" / "a.jpg", tmp_path / "in" / "trip" / "b.jpg"]
    before, folder = contents(inputs), tmp_path / "in"
    names = [folder, tmp_path / "link", tmp_path / "in" / "trip" / ".."]
    if find_spec("upath"):
        names += [
            f"local://{folder}",
            f"file://{folder}",
            f"simplecache::file://{folder}",
            f"dir://in::file://{tmp_path}",
        ]
    for source in names:
        for target in names:
            words = ["rectify", source, "-o", target, "--keep-names", "--motion", motion, "--overwrite"]
            assert main(list(map(str, words))) == 1
            assert "2 of 2 photos failed" in capsys.readouterr().err
            assert contents(inputs) == before


def test_results_of_an_evaluation_among_its_photos(tmp_path: Path, capsys) -> None:
    pytest.importorskip("matplotlib")
    make_photos(tmp_path, ["a.jpg", "sheet_1.jpg"])
    before = contents([tmp_path / "sheet_1.jpg"])
    words = ["evaluate", "--data", tmp_path, "--estimators", "none", "--jobs", 1, "--per-photo", 1, "-o", tmp_path]
    assert main(list(map(str, words))) == 1
    assert "is an input of this run" in capsys.readouterr().err
    assert contents([tmp_path / "sheet_1.jpg"]) == before
    assert not (tmp_path / "records.jsonl").exists()


def test_records_that_are_none_are_kept(tmp_path: Path, capsys) -> None:
    pytest.importorskip("matplotlib")
    make_photos(tmp_path / "in", ["a.jpg"])
    (tmp_path / "out").mkdir()
    theirs = tmp_path / "out" / "records.jsonl"
    theirs.write_text("somebody's\n")
    words = ["evaluate", "--data", tmp_path / "in", "--estimators", "none", "--jobs", 1, "-o", tmp_path / "out"]
    assert main(list(map(str, words))) == 2
    assert "not the record of a run" in capsys.readouterr().err
    assert theirs.read_text() == "somebody's\n"


def test_training_that_would_replace_what_it_begins_with(tmp_path: Path, capsys) -> None:
    pytest.importorskip("torch")
    (tmp_path / "tiny.toml").write_text(TINY)
    words = ["train", "--config", tmp_path / "tiny.toml", "--out", tmp_path]
    assert main(list(map(str, words))) == 0
    checkpoint = tmp_path / "tiny" / "checkpoint.pt"
    before = contents([checkpoint])
    assert main(list(map(str, [*words, "--start", checkpoint, "--steps", 2]))) == 1
    assert "original" in capsys.readouterr().err
    assert contents([checkpoint]) == before


def test_an_archive_that_photos_lie_in_is_an_input(tmp_path: Path, capsys) -> None:
    pytest.importorskip("upath")
    make_photos(tmp_path, ["a.jpg"])
    archive = Path(shutil.make_archive(str(tmp_path / "photos"), "zip", tmp_path, "a.jpg"))
    before = contents([archive])
    for url in (f"zip://a.jpg::file://{archive}", f"simplecache::zip://a.jpg::{archive}"):
        for option in ("--save-motion", "--output"):
            target = tmp_path / "link.json"
            target.unlink(missing_ok=True)
            target.hardlink_to(archive)
            motion = make_motion(tmp_path / "m.json")
            words = ["rectify", url, "--motion", motion, "-o", tmp_path / "o.jpg", option, target, "--overwrite"]
            assert main(list(map(str, words))) == 1
            assert contents([archive]) == before
    assert "original" in capsys.readouterr().err


def test_the_page_never_takes_a_name_that_is_there(tmp_path: Path) -> None:
    """The photos that it reads are copies of its own; what it saves gets a name of its own."""
    pytest.importorskip("starlette")
    from unshutter.serve.names import free_name

    (tmp_path / "a.jpg").write_bytes(b"somebody's")
    (tmp_path / "a (2).jpg").symlink_to(tmp_path / "nowhere")
    (tmp_path / "a-2.jpg").symlink_to(tmp_path / "nowhere")
    assert not os.path.lexists(free_name(tmp_path, "a.jpg"))
