"""The script for darktable, where that is installed: run by darktable-cli, which has no window."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from support.page_server import run_command
from unshutter.photo import Photo

SCRIPT = Path(__file__).parents[2] / "integrations" / "darktable" / "unshutter.lua"
LONG_S = 400
DARKTABLE = shutil.which("darktable-cli")
pytestmark = pytest.mark.skipif(DARKTABLE is None, reason="darktable is not installed")

# what the export module does: it hands each exported picture to the storage
LUA = """
local dt = require "darktable"
local store = dofile("{script}")
local image = dt.database.import("{photo}")
store(nil, image, nil, "{exported}", 1, 1)
local names = {{}}
for _, each in ipairs(image:get_group_members()) do table.insert(names, each.filename) end
table.sort(names)
print("GROUP " .. table.concat(names, " "))
"""


def stored(photo: Path, tmp_path: Path, command: Path) -> str:
    """Gives the storage a photo as if it had been exported from itself; returns what darktable printed."""
    folder = tmp_path / "darktable"
    folder.mkdir()
    exported = folder / photo.name
    shutil.copy(photo, exported)
    other = folder / "other.jpg"  # which darktable-cli exports at the same time
    Photo.from_array(np.zeros((60, 80, 3), np.uint8)).save(other)
    script = folder / "test.lua"
    script.write_text(LUA.format(script=SCRIPT, photo=photo, exported=exported))
    core = ["--library", ":memory:", "--configdir", folder / "config", "--cachedir", folder / "cache"]
    done = subprocess.run(
        [
            str(DARKTABLE),
            other,
            folder / "out.jpg",
            "--core",
            *core,
            "--disable-opencl",
            "--luacmd",
            f'dofile("{script}")',
        ],
        env=os.environ | {"HOME": str(folder), "UNSHUTTER": str(command)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LONG_S,
        check=False,
    )
    assert not exported.exists(), "what was exported is of no use any more"
    return done.stdout


@pytest.fixture
def command() -> Path:
    return Path(sys.executable).with_name("unshutter")


@pytest.fixture
def holiday(tmp_path: Path) -> Path:
    folder = tmp_path / "it's a holiday"
    folder.mkdir()
    return folder


def names_in(folder: Path) -> list[str]:
    return sorted(each.name for each in folder.iterdir() if each.suffix != ".xmp")  # darktable's own files


def test_the_result_is_grouped_with_its_original(holiday: Path, photo: Path, tmp_path: Path, command: Path) -> None:
    street = holiday / "street.jpg"
    shutil.copy(photo, street)
    other = holiday / "street.rectified.jpg"
    other.write_bytes(b"somebody else's")
    run_command("rectify", street, "-o", tmp_path / "expected.jpg")
    printed = stored(street, tmp_path, command)
    assert "GROUP street.jpg street.rectified-2.jpg" in printed, printed
    assert (holiday / "street.rectified-2.jpg").read_bytes() == (tmp_path / "expected.jpg").read_bytes()
    assert street.read_bytes() == photo.read_bytes() and other.read_bytes() == b"somebody else's"


def test_a_photo_left_unchanged_gives_no_file_and_a_reason(holiday: Path, tmp_path: Path, command: Path) -> None:
    grey = holiday / "grey.jpg"
    Photo.from_array(np.full((300, 400, 3), 128, np.uint8)).save(grey)
    printed = stored(grey, tmp_path, command)
    assert "grey.jpg is left unchanged (" in printed and "GROUP grey.jpg\n" in printed, printed
    assert names_in(holiday) == ["grey.jpg"]


def test_a_command_that_is_missing_is_named(holiday: Path, photo: Path, tmp_path: Path) -> None:
    street = holiday / "street.jpg"
    shutil.copy(photo, street)
    printed = stored(street, tmp_path, tmp_path / "nowhere")
    assert "street.jpg: " in printed and "nowhere" in printed and "GROUP street.jpg\n" in printed, printed
    assert names_in(holiday) == ["street.jpg"]
