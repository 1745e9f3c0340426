"""No option that names an output can touch what its command reads or another output, under whatever name.

The options are found by what their fields say that they name (options/fields.py). A new one fails here until it
stands in ``SCENES`` (support/outputs.py), and then until it is safe.
"""

import functools
import os
import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import combinations, product
from pathlib import Path

import pytest

from support.batches import make_motion, make_photos
from support.covering import covering
from support.outputs import NEEDS, SCENES, Scene, calibrate, train, video, video_by_motion
from unshutter.cli import command_named, main, summaries
from unshutter.options.fields import Option, options_of


@functools.cache
def options_of_commands() -> list[tuple[str, Option]]:
    """(command, option) of the options of all commands, but for what stands without a name."""
    found = ((command, each) for command in summaries() for each in options_of(command_named(command).arguments))
    return [(command, each) for command, each in found if not each.more.get("positional")]


def flags(*names: str) -> set[tuple[str, str]]:
    """(command, option) of the options of all commands that name inputs or outputs."""
    return {(command, f"--{each.name}") for command, each in options_of_commands() if each.more.get("names") in names}


def test_every_option_that_names_a_file_is_tried_here(tmp_path: Path) -> None:
    tried, wanted = set(), flags("input", "output", "results")
    for name, scenes in SCENES.items():
        for k, make in enumerate(scenes):
            if find_spec(NEEDS.get(make, "unshutter")):
                (tmp_path / f"{name}{k}").mkdir()
                scene = make(tmp_path / f"{name}{k}")
                tried |= {(name, word) for word in (*scene.outputs, *scene.words)} & wanted
            else:
                tried |= {each for each in wanted if each[0] == name}
    assert tried == wanted


def names_of(file: Path, folder: Path, endings: str) -> Iterator[object]:
    """Names that lead to a file: for each that it has, and with the endings that the command wants (none: a folder)."""
    yield file
    for ending in endings.split() or [file.suffix]:
        for kind, make in (("symbolic", Path.symlink_to), ("hard", Path.hardlink_to)):
            made = folder / f"{kind}{ending}"
            make(made, file)
            yield made
    if not endings:
        return
    yield os.path.relpath(file)
    yield file.parent / ".." / file.parent.name / file.name
    if (other_case := file.with_name(file.name.swapcase())).exists():
        yield other_case
    through = folder / "through"
    through.symlink_to(file.parent)
    yield through / file.name
    if find_spec("fsspec"):
        for url in ("local://{0}", "file://{0}", "simplecache::file://{0}", "dir://{0.name}::file://{0.parent}"):
            yield url.format(file)


def contents(files: list[Path]) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in files}


def run_with(scene: Scene, *more: object) -> int:
    needed = [word for needed in scene.needed.items() if needed[0] not in more for word in needed]
    return main(list(map(str, [*scene.words, *more, *needed, *scene.overwrite])))


ALL = [(name, make) for name, scenes in SCENES.items() for make in scenes if make is not train]
IDS = [f"{name}-{make.__name__}" for name, make in ALL]
posix = pytest.mark.skipif(os.name == "nt", reason="needs links")


@posix
@pytest.mark.parametrize(("command", "make"), ALL, ids=IDS)
def test_an_output_that_leads_to_an_input(command: str, make, tmp_path: Path, capsys, monkeypatch) -> None:
    pytest.importorskip(NEEDS.get(make, "unshutter"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    scene = make(tmp_path / "in")
    before = contents(scene.inputs)
    for option, endings in scene.outputs.items():
        for k, file in enumerate(scene.inputs):
            folder = tmp_path / f"{option}{k}"
            folder.mkdir()
            for name in names_of(file, folder, endings):
                refused(scene, [option, name], before, capsys)
            for ending in endings.split() if file in scene.any_name else ():
                renamed = file.with_name(f"renamed{ending}")
                words = [renamed if word == file else word for word in scene.words]
                other = Scene(words, [], scene.outputs, scene.needed)
                shutil.copyfile(file, renamed)
                refused(other, [option, renamed], {renamed: before[file]}, capsys)


def refused(scene: Scene, words: list[object], before: dict[Path, bytes], capsys) -> None:
    capsys.readouterr()
    code = run_with(scene, *words)
    told = capsys.readouterr().err.strip().splitlines()
    assert contents(list(before)) == before, words
    assert code in (1, 2), (words, told)
    assert "Traceback" not in "".join(told)
    endings, ending = scene.outputs[str(words[0])].split(), Path(str(words[1])).suffix
    if ending in endings and not Path(str(words[1])).is_symlink() and "://" not in str(words[1]):
        assert "original" in told[0], (words, told)


SEVERAL = [(name, make) for name, make in ALL if sum(each[0] == name for each in flags("output", "results")) > 1]


@posix
@pytest.mark.parametrize(("command", "make"), SEVERAL, ids=[make.__name__ for _, make in SEVERAL])
def test_two_outputs_are_never_one_file(command: str, make, tmp_path: Path, capsys, monkeypatch) -> None:
    pytest.importorskip(NEEDS.get(make, "unshutter"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    scene = make(tmp_path / "in")
    before = contents(scene.inputs)
    in_folder = {}
    for option in (option for option, endings in scene.outputs.items() if not endings):
        assert run_with(scene, option, tmp_path / option) == 0, capsys.readouterr().err
        in_folder[option] = [path.relative_to(tmp_path / option) for path in files_below(tmp_path / option)]
    # folders first
    for k, (a, b) in enumerate(combinations(sorted(scene.outputs, key=lambda option: scene.outputs[option] != ""), 2)):
        endings = scene.outputs[b].split()
        endings = [each for each in scene.outputs[a].split() if each in endings] or endings
        folder = tmp_path / str(k)
        if not endings:
            assert run_with(scene, a, folder, b, folder) == 0
            assert {path.relative_to(folder) for path in files_below(folder)} == {*in_folder[a], *in_folder[b]}
            continue
        if a in in_folder:
            names = [name for name in in_folder[a] if name.suffix in endings]
            pairs = [(folder, folder / name) for name in names] + [(folder, folder / f"another{endings[0]}")]
        else:
            pairs = one_file_twice(folder, endings[0])
        for one, other in pairs:
            other.parent.mkdir(parents=True, exist_ok=True)
            there = files_below(folder)
            code = run_with(scene, a, one, b, os.path.relpath(other))
            told = capsys.readouterr().err
            assert "Traceback" not in told and contents(scene.inputs) == before
            if a in in_folder and code == 0:  # each has a name of its own
                assert len(files_below(folder)) == len(in_folder[a]) + 1, (a, one, b, other, told)
                shutil.rmtree(folder)
            else:
                assert code in (1, 2) and files_below(folder) == there, (a, one, b, other, told)
                assert any(word in told for word in ("would be both", "a motion is")), (a, one, b, other, told)


def one_file_twice(folder: Path, ending: str) -> Iterator[tuple[Path, Path]]:
    """Pairs of names of one file, which exists or does not."""
    new, old = folder / f"new{ending}", folder / f"old{ending}"
    yield new, new
    yield new, folder / ".." / folder.name / new.name
    yield new, new.with_name(new.name.upper())
    old.write_text("old")
    for kind, make in (("symbolic", Path.symlink_to), ("hard", Path.hardlink_to)):
        make(folder / f"{kind}{ending}", old)
        yield old, folder / f"{kind}{ending}"


def files_below(folder: Path) -> dict[Path, bytes]:
    return contents(sorted(path for path in folder.rglob("*") if path.is_file()))


# a whole calibration takes seconds: lab/tests/calibration tries its folder
FOLDERS = [(name, make) for name, make in ALL if make not in (video, video_by_motion, calibrate)]


@posix
@pytest.mark.parametrize(("given", "kind"), covering(FOLDERS, ["symbolic", "hard"]))
def test_a_folder_of_links_to_inputs(given, kind: str, tmp_path: Path, capsys, monkeypatch) -> None:
    """Whatever a command writes into a folder: there are links to its inputs under all these names."""
    _, make = given
    pytest.importorskip(NEEDS.get(make, "unshutter"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    scene = make(tmp_path / "in")
    before = contents(scene.inputs)
    for option, endings in scene.outputs.items():
        if endings:
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


@posix
def test_a_folder_of_inputs_that_gets_the_results(tmp_path: Path, capsys) -> None:
    """With results that have the names of their photos."""
    make_photos(tmp_path / "in", ["a.jpg", "trip/b.jpg"])
    motion = make_motion(tmp_path / "m.json")
    (tmp_path / "link").symlink_to(tmp_path / "in")
    inputs = [tmp_path / "in" / "a.jpg", tmp_path / "in" / "trip" / "b.jpg"]
    before, folder = contents(inputs), tmp_path / "in"
    names = [folder, tmp_path / "link", tmp_path / "in" / "trip" / ".."]
    if find_spec("fsspec"):
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
    assert "not a record of a run" in capsys.readouterr().err
    assert theirs.read_text() == "somebody's\n"


@posix
def test_training_that_would_replace_what_it_reads(tmp_path: Path, capsys) -> None:
    pytest.importorskip("torch")
    from unshutter_lab.training.train import CHECKPOINT, LOG, MODELS

    (tmp_path / "in").mkdir()
    scene = train(tmp_path / "in")
    before = contents(scene.inputs)
    for k, (name, file) in enumerate(product((CHECKPOINT, LOG, *MODELS), scene.inputs)):
        folder = tmp_path / str(k) / "tiny"
        folder.mkdir(parents=True)
        (Path.hardlink_to if k % 2 else Path.symlink_to)(folder / name, file)
        assert run_with(scene, "--out", folder.parent) == 1
        assert "original" in capsys.readouterr().err
        assert contents(scene.inputs) == before


def test_an_archive_that_photos_lie_in_is_an_input(tmp_path: Path, capsys) -> None:
    pytest.importorskip("fsspec")
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
