"""The check of what a release's wheels hold, tried on wheels that are made here."""

import zipfile
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
PRODUCT = {
    "unshutter/__init__.py": "import numpy\n",
    "unshutter-1.0.dist-info/METADATA": "License-Expression: Apache-2.0\nLicense-File: LICENSE\n\n",
    "unshutter-1.0.dist-info/licenses/LICENSE": "terms",
}
LAB = {
    "unshutter_lab/weights/net.onnx": "",
    "unshutter_lab/weights/net.md": "trained so",
    "unshutter_lab/places/CREDITS.md": "| name | author |\n| yard | nobody |\n",
    "unshutter_lab/places/yard/posx.jpg": "",
    "unshutter_lab-1.0.dist-info/METADATA": (
        "License-Expression: Apache-2.0 AND CC0-1.0 AND LicenseRef-unshutter-research-weights\n"
        "License-File: LICENSE\nLicense-File: src/unshutter_lab/weights/LICENSE.md\n\n"
    ),
    "unshutter_lab-1.0.dist-info/licenses/LICENSE": "terms",
    "unshutter_lab-1.0.dist-info/licenses/src/unshutter_lab/weights/LICENSE.md": "net.onnx: research",
}


@pytest.fixture(scope="module")
def distributions() -> ModuleType:
    spec = spec_from_file_location("distributions", ROOT / ".ci" / "distributions.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def wheel(path: Path, files: dict[str, str]) -> zipfile.ZipFile:
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return zipfile.ZipFile(path)


def product(distributions: ModuleType, path: Path, **more: str) -> list[str]:
    weights = {f"unshutter/weights/{name}": "" for name in distributions.WEIGHTS}
    return distributions.product_problems(wheel(path, PRODUCT | weights | more))


def test_a_wheel_as_it_should_be_passes(distributions: ModuleType, tmp_path: Path) -> None:
    assert product(distributions, tmp_path / "a.whl") == []
    assert distributions.lab_problems(wheel(tmp_path / "b.whl", LAB)) == []


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("unshutter/weights/kandula2020-research.onnx", "", "unexpected weights"),
        ("unshutter/serve/own.npz", "", "a network"),
        ("unshutter/frames/a.py", "def f():\n    from torch import nn\n", "imports torch"),
        ("unshutter/frames/a.py", "import unshutter_lab.synthesis\n", "imports unshutter_lab"),
        ("unshutter_lab/__init__.py", "", "not of the product"),
        ("unshutter_lab/places/yard/posx.jpg", "", "not of the product"),
        ("tests/test_a.py", "", "not of the product"),
    ],
)
def test_research_in_the_products_wheel_is_found(
    name: str, text: str, problem: str, distributions: ModuleType, tmp_path: Path
) -> None:
    problems = product(distributions, tmp_path / "a.whl", **{name: text})
    assert any(problem in each for each in problems), problems


def test_the_weights_that_may_ship_are_those_of_the_repository(distributions: ModuleType) -> None:
    folder = ROOT / "src" / "unshutter" / "weights"
    assert {path.name for path in folder.iterdir()} == distributions.WEIGHTS


@pytest.mark.parametrize("name", [name for name in LAB if "METADATA" not in name and name != next(iter(LAB))])
def test_a_card_or_licence_that_is_missing_is_found(name: str, distributions: ModuleType, tmp_path: Path) -> None:
    files = {each: text for each, text in LAB.items() if each != name}
    assert distributions.lab_problems(wheel(tmp_path / "a.whl", files))


def test_a_network_without_terms_is_found(distributions: ModuleType, tmp_path: Path) -> None:
    files = LAB | {"unshutter_lab/weights/other.onnx": "", "unshutter_lab/weights/other.md": ""}
    assert distributions.lab_problems(wheel(tmp_path / "a.whl", files)) == ["no terms for other.onnx"]


def test_places_without_credits_or_of_too_many_bytes_are_found(
    distributions: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = LAB | {"unshutter_lab/places/street/posx.jpg": "1234567890"}
    assert distributions.lab_problems(wheel(tmp_path / "a.whl", files)) == ["no credits for the place street"]
    monkeypatch.setattr(distributions, "LARGEST_PLACES", 9)
    assert distributions.lab_problems(wheel(tmp_path / "b.whl", files))[1:] == ["places of 10 bytes"]


def test_sources_without_a_licence_or_with_the_laboratory_are_found(distributions: ModuleType) -> None:
    assert distributions.source_problems(["LICENSE", "src/unshutter/__init__.py"], is_product=True) == []
    assert distributions.source_problems(["src/unshutter/__init__.py"], is_product=True) == ["no LICENSE"]
    assert distributions.source_problems(["LICENSE", "lab/LICENSE"], is_product=True)
    assert distributions.source_problems(["LICENSE"], is_product=False) == ["no terms of the networks"]
