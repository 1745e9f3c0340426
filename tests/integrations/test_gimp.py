"""The plug-in for GIMP 3, where GIMP is installed: run without a window."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from support.page_server import run_command
from unshutter.photo import Photo

PLUG_IN = Path(__file__).parents[2] / "integrations" / "gimp" / "unshutter"
LONG_S = 400  # its first start looks through all of its plug-ins
SCRIPT = """
from gi.repository import Gimp, Gio
file = lambda name: Gio.File.new_for_path(name)
quiet = Gimp.RunMode.NONINTERACTIVE
image = Gimp.file_load(quiet, file({photo!r}))
procedure = Gimp.get_pdb().lookup_procedure("plug-in-unshutter")
config = procedure.create_config()
config.set_property("run-mode", quiet)
config.set_property("image", image)
status = procedure.run(config).index(0).value_nick
layers = image.get_layers()
with open({folder!r} + "/told.txt", "w") as told:
    print(status, *[layer.get_name() for layer in layers], file=told)
for number, layer in enumerate(layers):
    for each in layers:
        each.set_visible(each == layer)
    Gimp.file_save(quiet, image, file({folder!r} + f"/layer{{number}}.png"), None)
image.delete()
"""


def console() -> str | None:
    """GIMP without a window, in version 3 or newer."""
    found = next(filter(None, map(shutil.which, ("gimp-console-3.0", "gimp-console-3", "gimp-console"))), None)
    if found is None:
        return None
    version = subprocess.run([found, "--version"], capture_output=True, text=True, check=False).stdout
    number = re.search(r"(\d+)\.\d+", version)
    return found if number is not None and int(number[1]) >= 3 else None


GIMP = console()
pytestmark = pytest.mark.skipif(GIMP is None, reason="GIMP 3 is not installed")


def straightened(photo: Path, folder: Path, command: Path) -> str:
    """Lets the plug-in straighten a photo, and writes each layer to the folder.

    Returns:
        Its status and the names of the layers, in a line, and GIMP's messages.
    """
    plug_ins = folder / "gimp" / "plug-ins"
    plug_ins.mkdir(parents=True)
    shutil.copytree(PLUG_IN, plug_ins / "unshutter")
    script = folder / "script.py"
    script.write_text(SCRIPT.format(photo=str(photo), folder=str(folder)))
    words = [str(GIMP), "--no-interface", "--no-data", "--quit", "--batch-interpreter", "python-fu-eval"]
    own = {"HOME": str(folder), "GIMP3_DIRECTORY": str(folder / "gimp"), "UNSHUTTER": str(command)}
    path = os.pathsep.join(["/usr/bin", os.environ.get("PATH", "")])  # GIMP's Python is the system's
    done = subprocess.run(
        [*words, "-b", f"exec(open({str(script)!r}).read())"],
        env=os.environ | own | {"PATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LONG_S,
        check=False,
    )
    return (folder / "told.txt").read_text() + done.stdout


@pytest.fixture
def command() -> Path:
    return Path(sys.executable).with_name("unshutter")


@pytest.fixture
def drawing(tmp_path: Path, rolling_facade: np.ndarray) -> Path:
    path = tmp_path / "street.png"
    Photo.from_array(rolling_facade).save(path)
    return path


def test_the_result_is_a_layer_above_the_photo(drawing: Path, tmp_path: Path, command: Path) -> None:
    before = drawing.read_bytes()
    run_command("rectify", drawing, "-o", tmp_path / "expected.png", "--edges", "fill")
    printed = straightened(drawing, tmp_path, command)
    assert printed.startswith("success straightened Background\n"), printed
    assert "The photo -> a new layer (" in printed
    top, photo = (Photo.open(tmp_path / f"layer{number}.png").to_array()[..., :3] for number in range(2))
    assert np.array_equal(top, Photo.open(tmp_path / "expected.png").to_array())
    assert np.array_equal(photo, Photo.open(drawing).to_array())
    assert drawing.read_bytes() == before


def test_a_photo_left_unchanged_gets_no_layer_and_a_reason(tmp_path: Path, command: Path) -> None:
    grey = tmp_path / "grey.png"
    Photo.from_array(np.full((300, 400, 3), 128, np.uint8)).save(grey)
    printed = straightened(grey, tmp_path, command)
    assert printed.startswith("success Background\n"), printed
    assert "The photo left unchanged (" in printed


def test_a_command_that_is_missing_is_named(drawing: Path, tmp_path: Path) -> None:
    printed = straightened(drawing, tmp_path, tmp_path / "nowhere")
    assert printed.startswith("execution-error Background\n"), printed
    assert f"The command {tmp_path / 'nowhere'} was not found" in printed
