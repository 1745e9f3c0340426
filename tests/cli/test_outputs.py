"""No option that names an output can touch what its command reads, under whatever name.

The options are found by what their fields say that they name (options/description.py). A new one fails here until it
stands in ``SCENES`` (support/outputs.py), and then until it is safe.
"""

import os
import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from support.batches import make_motion, make_photos
from support.outputs import ELSEWHERE, NEEDS, SCENES, TINY, Scene, calibrate, film, film_by_motion
from unshutter.cli import command_named, main, summaries
from unshutter.cli.arguments import outputs


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
@pytest.mark.parametrize(("command", "make"), ALL, ids=[f"{name}-{make.__name__}" for name, make in ALL])
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
FOLDERS = [(name, make) for name, make in ALL if make not in (film, film_by_motion, calibrate)]


@pytest.mark.skipif(os.name == "nt", reason="needs links")
@pytest.mark.parametrize(("command", "make"), FOLDERS, ids=[f"{name}-{make.__name__}" for name, make in FOLDERS])
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
