"""What no batch may do to a photographer's archive, whatever happens to it."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from support.batches import leftovers, make_photos, rectify, results, start_rectify
from support.covering import thorough
from unshutter.photo import Photo

MANIFEST = "unshutter-manifest.jsonl"
posix = pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals, limits and users")


def finished(folder: Path) -> list[str]:
    """Targets of the records that say so, in order; each as often as it was done."""
    path = folder / MANIFEST
    text = path.read_text() if path.exists() else ""
    records = [json.loads(line) for line in text.splitlines() if line.endswith("}")]
    return [record["target"] for record in records if record["state"] == "done"]


def run_until(process: subprocess.Popen, enough) -> None:
    """Waits until enough was done, or the process ended."""
    while process.poll() is None and not enough():
        time.sleep(0.005)


@posix
@pytest.mark.parametrize(
    ("count", "jobs", "least_kills"), [(12, ["--jobs", 2], 1), thorough(40, [], 3), thorough(40, ["--jobs", 2], 3)]
)
def test_killed_again_and_again(count: int, jobs: list, least_kills: int, motion: Path, tmp_path: Path) -> None:
    """kill -9 during a batch, in a loop: in the end all results are whole and right, all originals as before."""
    archive, out, straight = tmp_path / "archive", tmp_path / "out", tmp_path / "straight"
    endings = (".jpg", ".png", ".webp", ".tif")
    make_photos(archive, [f"{k % 7}/{k:03}{endings[k % 4]}" for k in range(count)])
    originals = results(archive)
    assert rectify(archive, "-o", straight, "--motion", motion) == 0
    chance = random.Random(1)
    kills = 0
    for _ in range(40):
        process = start_rectify(archive, "-o", out, "--motion", motion, *jobs)
        before, wanted = len(finished(out)), chance.randint(1, count // 3)
        run_until(process, lambda: len(finished(out)) >= before + wanted)  # noqa: B023
        time.sleep(chance.random() * 0.02)  # anywhere between two results
        process.kill()
        _, errors = process.communicate()
        kills += process.returncode == -signal.SIGKILL
        assert results(archive) == originals
        for name in finished(out):  # what the manifest calls finished is whole
            Photo.open(out / name).to_array()
        if process.returncode == 0:
            break
    assert process.returncode == 0, errors
    assert kills >= least_kills
    assert results(out) == results(straight)
    assert leftovers(out) == []
    assert len(finished(out)) < count + 10 * kills  # what was finished was not done again
    assert results(archive) == originals


@posix
def test_workers_end_when_their_parent_is_killed(motion: Path, tmp_path: Path) -> None:
    make_photos(tmp_path / "archive", [f"{k:03}.png" for k in range(300)])
    process = start_rectify(tmp_path / "archive", "-o", tmp_path / "out", "--motion", motion, "--jobs", 2)
    run_until(process, lambda: len(finished(tmp_path / "out")) > 3)
    process.kill()
    process.communicate(timeout=30)  # returns when nobody holds the pipes any more, the workers among them


@posix
def test_two_runs_on_one_folder(motion: Path, tmp_path: Path) -> None:
    archive, out = tmp_path / "archive", tmp_path / "out"
    make_photos(archive, [f"{k:03}.jpg" for k in range(80)])
    assert rectify(archive, "-o", tmp_path / "straight", "--motion", motion) == 0
    both = [start_rectify(archive, "-o", out, "--motion", motion) for _ in range(2)]
    told = sorted((process.communicate(timeout=120)[1], process.returncode) for process in both)
    lines = [errors for errors, code in told if code]
    assert [code for _, code in told if not code] == [0]
    assert len(lines) == 1 and "another run is writing to" in lines[0] and "Traceback" not in lines[0]
    assert results(out) == results(tmp_path / "straight")
    assert leftovers(out) == []
    assert sorted(finished(out)) == sorted(results(out))


@posix
def test_a_second_run_is_refused_and_a_killed_one_blocks_nobody(motion: Path, tmp_path: Path, capsys) -> None:
    archive, out = tmp_path / "archive", tmp_path / "out"
    make_photos(archive, [f"{k:03}.png" for k in range(60)])
    process = start_rectify(archive, "-o", out, "--motion", motion)
    run_until(process, lambda: len(finished(out)) > 3)
    process.send_signal(signal.SIGSTOP)  # in the middle, for as long as it is looked at
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and f"another run is writing to {out}" in told
    assert rectify(archive, "-o", out, "--motion", motion, "--dry-run") == 0  # which writes nothing
    process.kill()
    process.communicate()
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert len(results(out)) == 60


@posix
def test_files_that_may_not_grow(motion: Path, tmp_path: Path) -> None:
    """The limit for the size of a file stands for a disc that is full in the middle of a picture."""
    archive, out = tmp_path / "archive", tmp_path / "out"
    make_photos(archive, ["a.png", "b.png"])
    (archive / "big.tif").write_bytes(b"")
    Photo.from_array(noise(400, 600)).save(archive / "big.tif", overwrite=True)

    def limit() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))

    process = start_rectify(archive, "-o", out, "--motion", motion, "--estimator", "none", preexec_fn=limit)
    _, errors = process.communicate(timeout=60)
    check_refusal(process.returncode, errors)
    assert "big.tif" in errors
    assert "1 of 3 photos failed" in errors
    assert sorted(results(out)) == ["a.rectified.png", "b.rectified.png"]


def noise(height: int, width: int):
    import numpy as np

    return np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)


def check_refusal(code: int, errors: str) -> None:
    assert code == 1, errors
    assert "Traceback" not in errors
    assert "please report" not in errors


def can_mount() -> bool:
    if sys.platform != "linux" or shutil.which("unshare") is None:
        return False
    command = ["unshare", "-rm", "sh", "-c", "mount -t tmpfs -o size=64k none /mnt"]
    return subprocess.run(command, capture_output=True).returncode == 0


@pytest.mark.skipif(not can_mount(), reason="needs the right to mount a small disc of one's own")
def test_a_full_disc(motion: Path, tmp_path: Path) -> None:
    """Results go to a disc of 300 kB; then to the same one when there is room: the batch goes on."""
    archive, disc = tmp_path / "archive", tmp_path / "disc"
    make_photos(archive, [f"{k:03}.png" for k in range(60)])
    originals = results(archive)
    disc.mkdir()
    rectify_command = f'"{sys.executable}" -m unshutter rectify "{archive}" -o "{disc}/out" --motion "{motion}"'
    script = f"""
        mount -t tmpfs -o size=300k none "{disc}"
        {rectify_command}; echo code $? >&2
        find "{disc}" -name ".unshutter-*" >&2
        mount -o remount,size=30m "{disc}"
        {rectify_command}; echo code $? >&2
        cp -r "{disc}/out" "{tmp_path}/kept"
    """
    done = subprocess.run(["unshare", "-rm", "sh", "-c", script], capture_output=True, text=True, timeout=120)
    full, went_on = done.stderr.split("code 1\n")
    assert "No space left on device" in full
    assert "Traceback" not in done.stderr
    assert ".unshutter-" not in went_on
    assert went_on.endswith("code 0\n"), went_on
    assert rectify(archive, "-o", tmp_path / "straight", "--motion", motion) == 0
    assert results(tmp_path / "kept") == results(tmp_path / "straight")
    assert results(archive) == originals


@posix
def test_a_folder_that_cannot_be_written_to(motion: Path, tmp_path: Path) -> None:
    archive, out = tmp_path / "archive", tmp_path / "out"
    make_photos(archive, ["a.png", "b.png"])
    out.mkdir(0o555)
    command = [sys.executable, "-m", "unshutter", "rectify", str(archive), "-o", str(out), "--motion", str(motion)]
    if os.geteuid() == 0:  # whom permissions do not stop
        if not can_mount():
            pytest.skip("needs a user who is not the superuser, or the right to mount")
        script = f'mount -t tmpfs -o ro none "{out}"; exec "$@"'
        command = ["unshare", "-rm", "sh", "-c", script, "sh", *command]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    check_refusal(done.returncode, done.stderr)
    assert "Permission denied" in done.stderr or "Read-only file system" in done.stderr
    assert list(out.iterdir()) == []
