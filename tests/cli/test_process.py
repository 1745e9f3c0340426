"""The program as a process: what it imports and how it ends."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.covering import thorough
from unshutter.cli import main
from unshutter.photo import Photo


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert unshutter.__version__ in capsys.readouterr().out
    assert main(["rectify", "--help"]) == 0
    assert "--edges" in capsys.readouterr().out


def test_heavy_libraries_are_imported_only_when_needed() -> None:
    """What makes `unshutter --version` and `import unshutter` fast."""
    heavy = "{'numpy', 'cv2', 'onnxruntime', 'pyvips', 'torch', 'matplotlib', 'shtab'}"
    words = (["--version"], ["rectify", "--help"])
    for start in ("import unshutter", *(f"from unshutter.cli import main; main({each})" for each in words)):
        code = f"{start}\nimport sys\nprint(sorted({heavy} & set(sys.modules)))"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert done.stdout.splitlines()[-1] == "[]"


def test_the_program_ends_with_what_was_said_and_done(photo: Path) -> None:
    """It does so without the interpreter's tidying up: nothing may be left in a buffer."""
    program = [sys.executable, "-m", "unshutter"]
    done = subprocess.run([*program, "estimate", "--json", str(photo)], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["format"] == "unshutter-motion/1"
    done = subprocess.run([*program, "rectify", str(photo)], capture_output=True, text=True, check=True)
    told = re.escape(f"{photo} -> {photo.with_name('street.rectified.jpg')}")
    sure = r"confidence 0\.\d\d: \w+, typically off by [\d.]+ px(, please look)?"
    assert re.fullmatch(rf"{told} \(points moved by up to \d+ px, {sure}; cropped to \d\d %\)\n", done.stderr)
    assert subprocess.run([*program, "rectify", str(photo)], capture_output=True, check=False).returncode == 1
    assert subprocess.run([*program, "rectify"], capture_output=True, check=False).returncode == 2


def test_a_damaged_library_is_told_in_one_line(photo: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "cv2.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(broken), os.environ.get("PYTHONPATH", "")))}
    command = [sys.executable, "-m", "unshutter", "rectify", str(photo)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1 and "libGL.so.1" in done.stderr and "install it again" in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full is Linux's")
@pytest.mark.parametrize("command", [["models"], ["--version"], ["estimate"]])
def test_output_led_to_a_full_disc_fails_in_one_line(command: list[str], photo: Path) -> None:
    command = [*command, str(photo)] if command == ["estimate"] else command
    with open("/dev/full", "wb") as full:
        process = [sys.executable, "-m", "unshutter", *command]
        done = subprocess.run(process, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1 and "No space left" in done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="other systems' names are text")
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_names_that_the_output_cannot_show(photo: Path, encoding: str) -> None:
    for name in (os.fsdecode(b"b\xfcro.jpg"), "büro.jpg"):
        strange = photo.with_name(name)
        strange.write_bytes(photo.read_bytes())
        command = [sys.executable, "-m", "unshutter", "rectify", str(strange), "--dry-run"]
        done = subprocess.run(
            command, capture_output=True, env={**os.environ, "PYTHONIOENCODING": encoding}, check=False
        )
        assert done.returncode == 0, done.stderr
        assert b"ro.rectified.jpg" in done.stdout
        assert b"Traceback" not in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_an_estimate_onto_a_full_disc_is_told_in_one_line(tmp_path: Path, rolling_facade: np.ndarray) -> None:
    photo = tmp_path / "photo.png"
    Photo.from_array(np.kron(rolling_facade, np.ones((4, 1, 1), np.uint8))).save(photo)
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "unshutter", "estimate", str(photo), "--estimator", "none"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith("No space left on device") and "unexpected" not in done.stderr


@pytest.mark.skipif(os.name == "nt", reason="a shell that closes streams")
@pytest.mark.parametrize("closed", ["2>&-", thorough("1>&- 2>&-"), "0<&- 1>&- 2>&-"])
def test_photos_are_rectified_without_standard_streams(closed: str, photo: Path, tmp_path: Path) -> None:
    """As services start programs; what libraries print must not get into a file that takes the stream's number."""
    (tmp_path / "b.jpg").write_bytes(photo.read_bytes())
    command = (
        f'"{sys.executable}" -m unshutter rectify "{photo}" "{tmp_path / "b.jpg"}" -o "{tmp_path / "out"}" {closed}'
    )
    done = subprocess.run(["sh", "-c", command], stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0 and done.stdout == ""
    for name in ("street.rectified.jpg", "b.rectified.jpg"):
        assert Photo.open(tmp_path / "out" / name).to_array().size


@pytest.mark.skipif(os.name == "nt", reason="a shell that closes streams")
def test_messages_never_reach_standard_output(tmp_path: Path) -> None:
    plain = tmp_path / "plain.png"
    Photo.from_array(np.full((300, 400, 3), 90, np.uint8)).save(plain)
    command = f'"{sys.executable}" -m unshutter estimate --json "{plain}" 2>&-'
    done = subprocess.run(["sh", "-c", command], stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0 and json.loads(done.stdout)["format"] == "unshutter-motion/1"


def test_main_needs_no_standard_error(
    photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As in a program without a window, which calls `main` itself."""
    monkeypatch.setattr(sys, "stderr", None)
    (tmp_path / "b.jpg").write_bytes(photo.read_bytes())
    assert main(["rectify", str(photo), str(tmp_path / "b.jpg"), "-o", str(tmp_path / "out")]) == 0
    assert main(["rectify", str(photo), "-o", str(tmp_path / "out" / "street.rectified.jpg")]) == 1
    assert capsys.readouterr().out == ""
