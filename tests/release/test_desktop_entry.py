""" "Open with" in file managers: the entry is valid, and what it runs does what it says."""

import shlex
import shutil
import subprocess
from configparser import ConfigParser
from pathlib import Path

import pytest

from unshutter.cli import main

ENTRY = Path(__file__).parents[2] / "desktop" / "unshutter.desktop"


@pytest.fixture
def entry() -> dict[str, str]:
    parser = ConfigParser(interpolation=None)
    parser.optionxform = str  # names are told by capitals, too
    parser.read(ENTRY, encoding="utf-8")
    return dict(parser["Desktop Entry"])


def test_it_is_valid() -> None:
    validator = shutil.which("desktop-file-validate")
    if validator is None:
        pytest.skip("needs desktop-file-validate (Debian: desktop-file-utils)")
    done = subprocess.run([validator, ENTRY], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


def test_opening_a_photo_straightens_it(entry: dict[str, str], photo: Path) -> None:
    program, *words = shlex.split(entry["Exec"])
    assert program == "unshutter"
    assert main([word.replace("%F", str(photo)) for word in words]) == 0
    assert photo.with_name("street.rectified.jpg").exists()
