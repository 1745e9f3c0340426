"""However a run is told to end, it leaves nothing half-written, and the next one removes what a kill left."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from support.batches import leave_some_undone, leftovers, make_photos, rectify, results, start_rectify
from support.covering import thorough
from unshutter.photo import Photo
from unshutter.storage.files import written_whole

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals")
MANIFEST = "unshutter-manifest.jsonl"


@pytest.fixture(scope="module")
def noise(tmp_path_factory: pytest.TempPathFactory) -> Path:
    noise = np.random.default_rng(0).integers(0, 255, (2100, 2800, 3), np.uint8)
    path = tmp_path_factory.mktemp("noise") / "large.png"
    Photo.from_array(noise).save(path)
    return path


@pytest.fixture
def photo(noise: Path, tmp_path: Path) -> Path:
    """A photo that takes a while to be written."""
    return shutil.copy(noise, tmp_path / "large.png")


def wait_for(found, process: subprocess.Popen, seconds: float = 60) -> None:
    until = time.monotonic() + seconds
    while not found():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until, "nothing happened"
        time.sleep(0.002)


def finished(folder: Path) -> set[str]:
    path = folder / MANIFEST
    lines = path.read_text().splitlines(keepends=True) if path.exists() else []
    records = [json.loads(line) for line in lines if line.endswith("\n")]
    return {record["target"] for record in records if record["state"] == "done"}


def check_stopped(process: subprocess.Popen, code: int) -> str:
    _, errors = process.communicate(timeout=60)
    assert process.returncode == code, errors
    assert "Traceback" not in errors
    return errors


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), thorough(signal.SIGHUP, 129), (signal.SIGINT, 130)]
)
def test_in_the_middle_of_a_picture(number: int, code: int, photo: Path, motion: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    process = start_rectify(photo, "-o", out, "--motion", motion)  # a photo left unchanged is copied too quickly
    wait_for(lambda: leftovers(tmp_path), process)
    process.send_signal(number)
    assert check_stopped(process, code) == "unshutter: stopped; finished results are kept\n"
    assert leftovers(tmp_path) == []
    assert not out.exists()


@pytest.mark.parametrize(
    ("number", "code", "jobs", "whole_group"),
    [
        pytest.param(signal.SIGTERM, 143, [], False, id="one process"),
        pytest.param(signal.SIGHUP, 129, [], True, id="one process, by the terminal"),
        pytest.param(signal.SIGINT, 130, [], False, id="one process, by Ctrl-C", marks=pytest.mark.thorough),
        pytest.param(signal.SIGHUP, 129, ["--jobs", 2], False, id="two processes", marks=pytest.mark.thorough),
        pytest.param(signal.SIGINT, 130, ["--jobs", 2], False, id="two processes, by Ctrl-C"),
        pytest.param(signal.SIGTERM, 143, ["--jobs", 2], True, id="two processes, and its workers, too"),
    ],
)
def test_in_the_middle_of_a_batch(
    number: int, code: int, jobs: list, whole_group: bool, motion: Path, tmp_path: Path
) -> None:
    make_photos(tmp_path / "many", [f"{k:03}.jpg" for k in range(200)])
    out = tmp_path / "out"
    process = start_rectify(tmp_path / "many", "-o", out, "--motion", motion, *jobs, start_new_session=True)
    wait_for(lambda: finished(out), process)
    (os.killpg if whole_group else os.kill)(process.pid, number)
    check_stopped(process, code)
    assert leftovers(out) == []
    kept = results(out)
    done, there = finished(out), set(kept)
    assert 0 < len(done) < 200
    assert done <= there
    most = 1 if number == signal.SIGINT else 2  # a signal may come between a picture and its record
    assert len(there - done) <= most
    left = leave_some_undone(tmp_path / "many", there)
    assert rectify(tmp_path / "many", "-o", out, "--motion", motion, *jobs) == 0  # the same command goes on
    assert len(results(out)) == left and kept.items() <= results(out).items()


def test_a_run_under_nohup_goes_on(motion: Path, tmp_path: Path) -> None:
    make_photos(tmp_path / "many", [f"{k:03}.jpg" for k in range(60)])
    out = tmp_path / "out"

    def ignore() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    process = start_rectify(tmp_path / "many", "-o", out, "--motion", motion, "--jobs", 2, preexec_fn=ignore)
    wait_for(lambda: finished(out), process)
    process.send_signal(signal.SIGHUP)
    check_stopped(process, 0)
    assert len(results(out)) == 60


def test_a_killed_run_leaves_no_pictures_in_the_temporary_folder(photo: Path, motion: Path, tmp_path: Path) -> None:
    """Those that are too large for memory lie in files there, which have no names."""
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    code = (
        "import sys, tempfile\ntempfile.gettempdir()\n"  # Python tries the folder with a file that a kill may leave
        "from unshutter.storage import files\nfiles.SPILL_BYTES = 1000\n"
        "from unshutter.cli import main\nsys.exit(main(sys.argv[1:]))"
    )
    words = ["rectify", photo, "-o", tmp_path / "out.png", "--motion", motion]
    command = [sys.executable, "-c", code, *map(str, words)]
    process = subprocess.Popen(command, env={**os.environ, "TMPDIR": str(temporary)})
    wait_for(lambda: leftovers(tmp_path), process)  # decoded, straightened, and now being written
    process.kill()
    process.wait()
    assert list(temporary.iterdir()) == []
    assert len(leftovers(tmp_path)) == 1
    small = tmp_path / "small.png"
    make_photos(tmp_path, ["small.png"])
    with written_whole(tmp_path / "another.png") as held:  # by a run at work
        assert rectify(small, "--estimator", "none") == 0  # the next run tidies up, one photo or many
        assert leftovers(tmp_path) == [held.name]
        held.write_bytes(b"whole")
