"""Every public function's docstring has an example, and each example does what it shows."""

import doctest
import inspect
import json
import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import unshutter
from support.clips import moving, shaken, write
from unshutter.photo import Photo
from unshutter_lab.synthesis.sequences import RotatingCamera

ROOT = Path(__file__).parents[2]
ORIGINAL = ROOT / "examples" / "original" / "basilica.webp"
SURFACE = json.loads((ROOT / "tests" / "house" / "api_surface.json").read_text(encoding="utf-8"))
FUNCTIONS = [
    path for path, form in SURFACE.items() if form.startswith("(") and not any(p[:1].isupper() for p in path.split("."))
]


def function(path: str) -> Any:
    module, _, name = path.rpartition(".")
    return getattr(import_module(module), name)


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What examples may name: a distorted photo, one that is not, three frames, and a clip."""
    folder = tmp_path_factory.mktemp("material")
    shutil.copy(ROOT / "examples" / "demo.jpg", folder / "street.jpg")
    Photo.open(ORIGINAL).save(folder / "house.jpg")
    camera = RotatingCamera(shaken(), 0.05, 3, 30.0, 0.7, 360, 480, 420.0)
    for name, frame in zip("abc", camera.rendered(Photo.open(ORIGINAL).to_array(), noise=2.0), strict=True):
        Photo.from_array(frame).save(folder / f"{name}.jpg", quality=92)
    write(folder / "walk.mp4", moving(16)[1])
    return folder


@pytest.mark.parametrize("path", FUNCTIONS)
def test_the_example_of_a_function_runs(
    path: str, material: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = function(path)
    text = inspect.getdoc(there) or ""
    names = {**vars(import_module(there.__module__)), "unshutter": unshutter, "np": np, "json": json, "Path": Path}
    test = doctest.DocTestParser().get_doctest(text, names, path, there.__module__, 0)
    assert test.examples, "its docstring has no example"
    folder = tmp_path / "work"
    shutil.copytree(material, folder)
    monkeypatch.chdir(folder)
    printed: list[str] = []
    flags = doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL
    assert doctest.DocTestRunner(optionflags=flags).run(test, out=printed.append).failed == 0, "".join(printed)
