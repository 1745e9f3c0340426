"""README.md's commands are those that a release is tried with."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def smoke() -> ModuleType:
    spec = spec_from_file_location("smoke", ROOT / ".ci" / "smoke.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_commands_of_shell_blocks_are_found(smoke: ModuleType) -> None:
    shell = "```sh\npip install unshutter\nunshutter rectify a.jpg  # why\n```\n"
    page = f"unshutter no\n{shell}```python\nunshutter = 1\n```\n"
    assert smoke.commands(page) == [["unshutter", "rectify", "a.jpg"]]
    assert smoke.first_python(page) == "unshutter = 1\n"


def test_the_readme_names_no_photo_that_the_check_does_not_lay_out(smoke: ModuleType, tmp_path: Path) -> None:
    smoke.lay_out(tmp_path, ROOT / "examples" / "demo.jpg")
    asked = smoke.commands((ROOT / "README.md").read_text(encoding="utf-8"))
    photos = [words for words in asked if words[1] in ("rectify", "estimate")]
    assert photos
    for _, _, photo, *_ in photos:
        assert (tmp_path / photo).exists(), photo


def test_a_command_that_fails_is_told(smoke: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="exit code 3"):
        smoke.try_out("it", [sys.executable, "-c", "raise SystemExit(3)"], ROOT / "examples" / "demo.jpg")
    with pytest.raises(SystemExit, match="changed a photo"):
        smoke.try_out("it", [sys.executable, "-c", "open('street.jpg', 'w')"], ROOT / "examples" / "demo.jpg")
