"""The same batch on a Dask cluster of real worker processes, one of which is killed; needs the extra ``dask``."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from support.batches import leftovers, make_photos, rectify, results, start_rectify
from support.hand_held import clip, hand
from unshutter import Photo

distributed = pytest.importorskip("distributed", reason="needs unshutter[dask]")

PHOTOS = 60


@pytest.fixture(scope="module")
def cluster() -> Iterator:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as made:
        yield made


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    make_photos(tmp_path / "archive", [f"{k % 3}/{k:03}.jpg" for k in range(PHOTOS)])
    return tmp_path / "archive"


class Watch(threading.Thread):
    """Sees every file that ever lay under a result's name: its inode is new each time it is written."""

    def __init__(self, folder: Path):
        super().__init__(daemon=True)
        self.folder, self.seen, self._over = folder, {}, threading.Event()

    def run(self) -> None:
        while not self._over.is_set():
            self.look()
            time.sleep(0.01)

    def look(self) -> None:
        for path in list(self.folder.rglob("*.rectified.*")):
            status = path.stat()
            self.seen.setdefault(path.name, set()).add((status.st_ino, status.st_mtime_ns))

    def stop(self) -> dict[str, set]:
        self._over.set()
        self.join()
        self.look()
        return self.seen


def test_a_worker_is_killed_on_the_way(cluster, archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert rectify(archive, "-o", tmp_path / "straight", "--motion", motion) == 0
    with distributed.Client(cluster) as client:
        (victim, _) = client.run(os.getpid).values()
    watch = Watch(out)
    watch.start()

    def kill_one() -> None:
        while len(watch.seen) < PHOTOS // 4:
            time.sleep(0.002)
        os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    log = tmp_path / "log.jsonl"
    code = rectify(archive, "-o", out, "--motion", motion, "--scheduler", cluster.scheduler_address, "--json-log", log)
    killer.join()
    seen = watch.stop()
    assert code == 0, capsys.readouterr().err
    whole = {name: digest for name, digest in results(out).items() if ".unshutter-" not in name}
    assert whole == results(tmp_path / "straight")  # nothing lost
    assert {name: len(files) for name, files in seen.items()} == dict.fromkeys(seen, 1)  # nothing done twice
    events = [json.loads(line)["event"] for line in log.read_text().splitlines()]
    assert events == ["done"] * PHOTOS + ["end"]
    # what the killed worker left half-written goes with the next run, which has nothing else to do
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert leftovers(out) == []
    assert f"{PHOTOS} finished already" in capsys.readouterr().err


@pytest.mark.thorough
def test_the_scheduler_is_killed_on_the_way(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out, told = tmp_path / "out", tmp_path / "scheduler.json"
    words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", told]
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", *map(str, words)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as scheduler:
        while not told.exists() or not told.read_text():
            time.sleep(0.02)
        address = json.loads(told.read_text())["address"]
        words = [archive, "-o", out, "--motion", motion]
        with start_rectify(*words, "--scheduler", address) as process:
            while not (out / "unshutter-manifest.jsonl").exists():  # it has no workers, so nothing is ever done
                time.sleep(0.02)
            scheduler.kill()
            errors = process.communicate(timeout=60)[1]
    assert process.returncode == 1
    assert errors == "unshutter: the workers cannot be reached any more: run the same command again to continue\n"
    assert rectify(*words) == 0
    assert f"{PHOTOS} of {PHOTOS} photos done" in capsys.readouterr().err


def test_nobody_answers(archive: Path, tmp_path: Path, capsys) -> None:
    assert rectify(archive, "-o", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:1") == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "cannot reach the Dask scheduler" in message


def test_a_sequence_is_rectified_as_on_one_machine(cluster, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for k, frame in enumerate(clip(hand(4), 0.9, frames=6)[1]):
        Photo.from_array(frame).save(tmp_path / "in" / f"{k}.png")
    words = tmp_path / "in", "--sequence", "--readout-ratio", "0.9"
    assert rectify(*words, "-o", tmp_path / "here") == 0
    assert rectify(*words, "-o", tmp_path / "there", "--scheduler", cluster.scheduler_address) == 0
    assert results(tmp_path / "there") == results(tmp_path / "here")


def test_photos_replaced_between_two_runs_on_the_same_workers(cluster, motion: Path, tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    words = ["--motion", motion, "--scheduler", cluster.scheduler_address, "--edges", "keep"]
    for level in (40, 200):
        for k in range(6):
            picture = np.full((144, 192, 3), level + 5 * k, np.uint8)
            Photo.from_array(picture).save(photos / f"{k}.webp", overwrite=True)
        assert rectify(photos, "-o", tmp_path / "out", *words) == 0
        for k in range(6):
            file = (tmp_path / "out" / f"{k}.rectified.webp").read_bytes()
            assert abs(int(Photo.from_bytes(file).pixels[72, 96, 0]) - level - 5 * k) <= 2
